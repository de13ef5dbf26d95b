"""The control channel: a line of words asks for a fault or a state, a line answers.

Not part of any real robot.  The server answers it at all times, a frozen controller included.

=========================  =========================================================================
``freeze [SECONDS]``       stop the controller's clock, serve nobody; go on after the time or `thaw`
``thaw``                   go on
``drop WHAT``              close connections: ``rtde``, ``control``, ``receive``, ``dashboard``,
                           ``all``
``silence`` / ``speak``    answer requests but send no data packages / send them again
``delay OUT IN``           hold packages back, s: to clients, from clients
``die``                    kill the process, without any farewell
``protective_stop``, ``emergency_stop``, ``system_emergency_stop``, ``safeguard``,
``automatic_safeguard``, ``three_position``, ``violation``, ``fault``, ``reduced``, ``recovery``
                           the stop or the mode, now or, with a number, some seconds from now
``release``                let go of the button, the safeguard or the mode
``input KIND NUMBER VALUE``  set an input: ``digital`` 0 to 17 (8 on: configurable, 16 on: tool),
                           ``analog`` 0 to 3 (2 on: tool)
``missing FILE``           `load` of this program or installation finds no file
``stop``, ``pause``, ``play``  the buttons of the pendant
``slider FRACTION``        the speed slider
``limiter FRACTION``       slow programs down as the controller's own limiter does
``dashboard PACE``         the dashboard server takes PACE s for each byte of an answer
``contact on|off``         the tool touches something, or nothing any more
``garbage COUNT [BYTE]``   send COUNT bytes (0) that are no package to every RTDE client
``local`` / ``remote``     local or remote control
``limit JOINT SPEED``      lower the speed limit of joint 1 to 6, rad/s
``block JOINT`` / ``unblock JOINT``
                           joint 1 to 6 is stuck where it is, whatever is commanded / is free again
``push Q1 .. Q6 [SECONDS]``
                           move the joints by hand to these angles (rad), in so long, while the arm
                           gives way: in freedrive or teach mode, or stopped or paused and still
``record on|off|clear``, ``record write STEM``  see `emulated_ur.recording`
``state``                  everything worth knowing, as JSON
=========================  =========================================================================
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from emulated_ur.controller import Controller, RefusedError
from emulated_ur.variables import SafetyMode

if TYPE_CHECKING:
    from emulated_ur.server import Server


class UnknownFaultError(Exception):
    """A line that the control channel does not know."""


def carry_out(server: Server, line: str) -> str:
    """Do what *line* asks; return the answer, ``ok`` where there is nothing to say."""
    words = line.split()
    try:
        if not words or words[0] not in _VERBS:
            raise UnknownFaultError(f"unknown: {line.strip()!r}; known: {', '.join(_VERBS)}")
        return _VERBS[words[0]](server, words[1:]) or "ok"
    except (
        UnknownFaultError,
        RefusedError,
        ValueError,
        OverflowError,
        IndexError,
        OSError,
    ) as error:
        return f"error: {error}"


def _stop_robot(action: Callable[[Controller], None]) -> Callable[[Server, Sequence[str]], None]:
    def ask(server: Server, words: Sequence[str]) -> None:
        robot = server.robot
        if words:
            robot.later(float(words[0]), lambda: action(robot))
        else:
            action(robot)

    return ask


def _enter(
    action: Callable[[Controller, SafetyMode], None], mode: SafetyMode
) -> Callable[[Server, Sequence[str]], None]:
    return _stop_robot(lambda robot: action(robot, mode))


def _input(server: Server, words: Sequence[str]) -> None:
    kind, number, value = words[0], int(words[1]), float(words[2])
    if kind not in ("digital", "analog") or not 0 <= number < (18 if kind == "digital" else 4):
        raise ValueError(f"expected digital 0 to 17 or analog 0 to 3, got {kind} {number}")
    if kind == "analog":
        server.robot.analog_inputs[number] = value
    else:
        rest = server.robot.digital_inputs & ~(1 << number)
        server.robot.digital_inputs = rest | bool(value) << number


def _joint(word: str) -> int:
    joint = int(word)
    if not 1 <= joint <= 6:
        raise ValueError(f"joint must be 1 to 6, got {joint}")
    return joint - 1


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
    server.delay_out_ns = round(float(words[0]) * 1e9)
    server.delay_in_ns = round(float(words[1]) * 1e9) if len(words) > 1 else 0


def _pace_dashboard(server: Server, words: Sequence[str]) -> None:
    server.dashboard_pace_ns = round(float(words[0]) * 1e9)


_VERBS: dict[str, Callable[[Server, Sequence[str]], str | None]] = {
    "freeze": lambda server, words: server.freeze(float(words[0]) if words else None),
    "thaw": lambda server, _words: server.thaw(),
    "drop": lambda server, words: f"ok {server.drop(words[0])}",
    "silence": lambda server, _words: setattr(server, "is_silent", True),
    "speak": lambda server, _words: setattr(server, "is_silent", False),
    "delay": _delay,
    "die": lambda server, _words: server.die(),
    "protective_stop": _stop_robot(Controller.protective_stop),
    "emergency_stop": _stop_robot(Controller.emergency_stop),
    "system_emergency_stop": _enter(Controller.emergency_stop, SafetyMode.SYSTEM_EMERGENCY_STOP),
    "violation": _enter(Controller.emergency_stop, SafetyMode.VIOLATION),
    "fault": _enter(Controller.emergency_stop, SafetyMode.FAULT),
    "safeguard": _stop_robot(Controller.safeguard_stop),
    "automatic_safeguard": _enter(
        Controller.safeguard_stop, SafetyMode.AUTOMATIC_MODE_SAFEGUARD_STOP
    ),
    "three_position": _enter(
        Controller.safeguard_stop, SafetyMode.SYSTEM_THREE_POSITION_ENABLING_STOP
    ),
    "reduced": _stop_robot(Controller.reduce),
    "recovery": _enter(Controller.reduce, SafetyMode.RECOVERY),
    "input": _input,
    "missing": lambda server, words: server.robot.missing_files.add(" ".join(words)),
    "release": lambda server, _words: server.robot.release(),
    "stop": lambda server, _words: server.robot.stop(),
    "pause": lambda server, _words: server.robot.pause(),
    "play": lambda server, _words: server.robot.play(),
    "slider": lambda server, words: server.robot.set_slider(float(words[0])),
    "limiter": _limiter,
    "dashboard": _pace_dashboard,
    "contact": lambda server, words: setattr(server.robot, "is_touching", words == ["on"]),
    "garbage": lambda server, words: server.send_garbage(*map(int, words)),
    "local": lambda server, _words: setattr(server.robot, "is_remote", False),
    "remote": lambda server, _words: setattr(server.robot, "is_remote", True),
    "limit": _limit,
    "push": _push,
    "block": lambda server, words: server.robot.arm.blocked.add(_joint(words[0])),
    "unblock": lambda server, words: server.robot.arm.blocked.discard(_joint(words[0])),
    "record": lambda server, words: server.record(words),
    "state": lambda server, _words: server.describe(),
    "help": lambda _server, _words: " | ".join(_VERBS),
}
