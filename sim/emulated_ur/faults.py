"""The control channel: a line requests a fault or a state, a line answers.

No real robot has it.  The server always answers it, even with a frozen controller.  ``help``
answers with every verb and its arguments.
"""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from emulated_ur.controller import RefusedError
from emulated_ur.variables import SafetyMode

if TYPE_CHECKING:
    from emulated_ur.server import Server

_FAILURES = (RefusedError, ValueError, OverflowError, IndexError, TypeError, OSError)

_SAFETY = {
    "protective_stop": SafetyMode.PROTECTIVE_STOP,
    "emergency_stop": SafetyMode.ROBOT_EMERGENCY_STOP,
    "system_emergency_stop": SafetyMode.SYSTEM_EMERGENCY_STOP,
    "violation": SafetyMode.VIOLATION,
    "fault": SafetyMode.FAULT,
    "safeguard": SafetyMode.SAFEGUARD_STOP,
    "automatic_safeguard": SafetyMode.AUTOMATIC_MODE_SAFEGUARD_STOP,
    "three_position": SafetyMode.SYSTEM_THREE_POSITION_ENABLING_STOP,
    "reduced": SafetyMode.REDUCED,
    "recovery": SafetyMode.RECOVERY,
}


def carry_out(server: Server, line: str) -> str:
    """Execute *line*; return the answer, ``ok`` by default."""
    verb, *words = line.split() or [""]
    if verb not in _VERBS:
        return f"error: unknown: {line.strip()!r}; known: {', '.join(_VERBS)}"
    try:
        return _VERBS[verb][1](server, words) or "ok"
    except _FAILURES as error:
        return f"error: {error}"


def _enter(mode: SafetyMode) -> Callable[[Server, Sequence[str]], None]:
    def ask(server: Server, words: Sequence[str]) -> None:
        robot = server.robot
        if words:
            robot.later(float(words[0]), lambda: robot.enter(mode, "asked for"))
        else:
            robot.enter(mode, "asked for")

    return ask


def _input(server: Server, words: Sequence[str]) -> None:
    kind, number, value = words[0], int(words[1]), float(words[2])
    if kind not in ("digital", "analog") or not 0 <= number < (18 if kind == "digital" else 4):
        raise ValueError(f"expected digital 0 to 17 or analog 0 to 3, got {kind} {number}")
    if kind == "digital":
        bit = 1 << number
        server.robot.set_bits("actual_digital_input_bits", bit, bit if value else 0)
    else:
        place = "standard" if number < 2 else "tool"
        server.robot.variables[f"{place}_analog_input{number % 2}"] = value


def _joint(word: str) -> int:
    joint = int(word)
    if not 1 <= joint <= 6:
        raise ValueError(f"joint must be 1 to 6, got {joint}")
    return joint - 1


def _block(server: Server, words: Sequence[str]) -> None:
    joint, *away = words
    arm, place = server.robot.arm, _joint(joint)
    arm.blocked[place] = arm.actual_q[place] + (float(away[0]) if away else 0.0)


def _unblock(server: Server, words: Sequence[str]) -> None:
    server.robot.arm.blocked.pop(_joint(words[0]), None)


def _limit(server: Server, words: Sequence[str]) -> None:
    server.robot.arm.speed_limits[_joint(words[0])] = float(words[1])


def _push(server: Server, words: Sequence[str]) -> None:
    *angles, seconds = map(float, words if len(words) > 6 else [*words, "0"])
    if len(angles) != 6:
        raise ValueError(f"expected 6 angles and a time, got {len(words)} numbers")
    server.robot.push(angles, seconds)


def _limiter(server: Server, words: Sequence[str]) -> None:
    server.robot.speed_limiter = max(0.0, min(1.0, float(words[0])))


def _delay(server: Server, words: Sequence[str]) -> None:
    going, coming = (round(float(word) * 1e9) for word in (*words, "0")[:2])
    for kind, delays in server.delays.items():
        if kind != "faults":
            delays.going_ns, delays.coming_ns = going, coming


def _pace_dashboard(server: Server, words: Sequence[str]) -> None:
    server.delays["dashboard"].byte_ns = round(float(words[0]) * 1e9)


def _record(server: Server, words: Sequence[str]) -> None:
    if words[:1] == ["write"] and len(words) == 2:
        server.recording.write(Path(words[1]))
    elif words in (["on"], ["off"]):
        server.recording.is_on = words == ["on"]
    elif words == ["clear"]:
        server.recording.clear()
    else:
        raise ValueError(f"record must be on, off, clear or write STEM, got {words}")


def _state(server: Server, words: Sequence[str]) -> str:  # noqa: ARG001
    robot, arm, recording = server.robot, server.robot.arm, server.recording
    return json.dumps(
        {
            "ticks": robot.ticks, "timestamp": robot.timestamp,
            "robot_mode": robot.robot_mode.name, "safety_mode": robot.safety_mode.name,
            "safety_status": robot.safety_status.name, "popup": robot.popup,
            "digital_outputs": robot.variables["actual_digital_output_bits"],
            "runtime_state": robot.runtime_state.name, "is_remote": robot.is_remote,
            "speed_slider": robot.speed_slider, "speed_scaling": robot.speed_scaling,
            "actual_q": arm.actual_q, "target_q": arm.target_q,
            "actual_pose": robot.tool.pose("actual_TCP_pose"), "tcp_offset": robot.tool.offset,
            "payload": robot.variables["payload"], "payload_cog": robot.variables["payload_cog"],
            "servoing": arm.servoing, "is_still": arm.is_still, "setpoints": recording.setpoints,
            "overwritten": recording.overwritten, "stalls": server.stalls,
            "malformed": sum(session.malformed for session in server.sessions),
            "rtde_clients": len(server.sessions), "log": robot.log[-20:],
            "told": list(robot.told)[-20:],
        }
    )  # fmt: skip


_VERBS: dict[str, tuple[str, Callable[[Server, Sequence[str]], str | None]]] = {
    **{verb: ("[SECONDS]: enter that safety state, now or later", _enter(mode))
       for verb, mode in _SAFETY.items()},
    "release": (": let go of the button, the safeguard or the mode",
                lambda server, _words: server.robot.release()),
    "stop": (": press the pendant's button", lambda server, _words: server.robot.stop()),
    "pause": (": press it", lambda server, _words: server.robot.pause()),
    "play": (": press it", lambda server, _words: server.robot.play()),
    "slider": ("FRACTION: move the speed slider",
               lambda server, words: server.robot.set_slider(float(words[0]))),
    "limiter": ("FRACTION: slow programs down, as the controller's own limiter does", _limiter),
    "local": (": leave remote control",
              lambda server, _words: setattr(server.robot, "is_remote", False)),
    "remote": (": enter remote control",
               lambda server, _words: setattr(server.robot, "is_remote", True)),
    "freeze": ("[SECONDS]: stop the controller's clock and serve nobody, for a time or until thaw",
               lambda server, words: server.freeze(*map(float, words))),
    "thaw": (": go on", lambda server, _words: server.thaw()),
    "silence": (": answer RTDE requests but send no data",
                lambda server, _words: setattr(server, "is_silent", True)),
    "speak": (": send data again", lambda server, _words: setattr(server, "is_silent", False)),
    "delay": ("OUT [IN]: hold back what goes to clients and what comes from them, s", _delay),
    "dashboard": ("PACE: take so many s for each byte of an answer", _pace_dashboard),
    "drop": ("WHAT: close connections of rtde, control, receive, dashboard, script, primary, all",
             lambda server, words: f"ok {server.drop(words[0])}"),
    "garbage": ("COUNT [BYTE]: send bytes that are no package to every RTDE client",
                lambda server, words: server.send_garbage(*map(int, words))),
    "die": (": end at once, as a process that was killed",
            lambda _server, _words: os.kill(os.getpid(), signal.SIGKILL)),
    "block": ("JOINT [ANGLE]: let joint 1 to 6 be stuck, or push it by an angle (rad) first",
              _block),
    "unblock": ("JOINT: free it", _unblock),
    "limit": ("JOINT SPEED: lower the speed limit of joint 1 to 6, rad/s", _limit),
    "push": ("Q1 .. Q6 [SECONDS]: move the joints by hand to angles (rad), if the arm gives way",
             _push),
    "contact": ("on|off: let the tool touch something, or nothing any more",
                lambda server, words: setattr(server.robot, "is_touching", words == ["on"])),
    "input": ("digital|analog NUMBER VALUE: set an input; digital 8 to 15 are configurable, 16 and "
              "17 the tool's, as are analog 2 and 3", _input),
    "missing": ("FILE: let no such program or installation be there",
                lambda server, words: server.robot.missing_files.add(" ".join(words))),
    "record": ("on|off|clear|write STEM: keep servo commands and cycles, and write them to files",
               _record),
    "state": (": answer with all that is worth knowing, as JSON", _state),
    "help": (": answer with these", lambda _server, _words: " | ".join(
        f"{verb}{'' if use.startswith(':') else ' '}{use}" for verb, (use, _) in _VERBS.items())),
}  # fmt: skip
"""By verb: its arguments, its purpose, and its action."""
