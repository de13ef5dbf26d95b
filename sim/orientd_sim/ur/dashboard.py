"""The dashboard server's language: a line in, a line out; no sockets here."""

from __future__ import annotations

from collections.abc import Callable

from orientd_sim.ur.controller import Controller, RefusedError
from orientd_sim.ur.variables import ProgramState

WELCOME = "Connected: Universal Robots Dashboard Server"
GOODBYE = "Disconnected"

# First version of CB3 and of all others; None where CB3 never knew it.
_SINCE: dict[str, tuple[tuple[int, ...] | None, tuple[int, ...]]] = {
    "is in remote control": (None, (5, 6)),
    "get serial number": ((3, 12), (5, 6)),
    "get robot model": ((3, 12), (5, 6)),
}


def reply(robot: Controller, line: str) -> str:
    """Carry out one line from a client and return the answer, without the line's end."""
    command = line.strip()
    lowered = command.lower()
    for start, action in _WITH_ARGUMENT.items():
        if lowered.startswith(start):
            return action(robot, command[len(start) :].strip())
    if lowered not in _COMMANDS or not _is_known(lowered, robot.behaviour.version):
        return f"could not understand: {command}"
    if lowered in _NEEDS_REMOTE and not robot.is_remote:
        return "Command is not allowed due to safety reasons"
    try:
        return _COMMANDS[lowered](robot)
    except RefusedError as refused:
        return str(refused)


def _is_known(command: str, version: tuple[int, ...]) -> bool:
    first = _SINCE.get(command, ((0,), (0,)))[version[0] >= 5]
    return first is not None and version >= first


def _version(robot: Controller) -> str:
    major, minor, bugfix, build = robot.behaviour.version
    return f"URSoftware {major}.{minor}.{bugfix}.{build} (Oct 13 2022)"


def _program_state(robot: Controller) -> str:
    states = {ProgramState.PLAYING: "PLAYING", ProgramState.PAUSED: "PAUSED"}
    name = robot.loaded_program or "<unnamed>"
    return f"{states.get(robot.runtime_state, 'STOPPED')} {name}"


def _after(action: Callable[[Controller], None], answer: str) -> Callable[[Controller], str]:
    def carry_out(robot: Controller) -> str:
        action(robot)
        return answer

    return carry_out


def _load(robot: Controller, name: str) -> str:
    if not name:
        return "Error while loading program: "
    robot.loaded_program = name
    return f"Loading program: {name}"


def _log(robot: Controller, text: str) -> str:
    robot.say(text)
    return "Added log message"


_WITH_ARGUMENT: dict[str, Callable[[Controller, str], str]] = {
    "load ": _load,
    "addtolog ": _log,
    "popup ": lambda _robot, _text: "showing popup",
    "setuserrole ": lambda _robot, role: f"Setting user role: {role}",
}

_NEEDS_REMOTE = frozenset(
    {"play", "power on", "power off", "brake release", "unlock protective stop"}
)

_COMMANDS: dict[str, Callable[[Controller], str]] = {
    "polyscopeversion": _version,
    "get serial number": lambda robot: robot.behaviour.serial,
    "get robot model": lambda robot: robot.behaviour.model.dashboard_name,
    "stop": _after(Controller.stop, "Stopped"),
    "play": _after(Controller.play, "Starting program"),
    "pause": _after(Controller.pause, "Pausing program"),
    "running": lambda robot: (
        f"Program running: {str(robot.runtime_state is ProgramState.PLAYING).lower()}"
    ),
    "robotmode": lambda robot: f"Robotmode: {robot.robot_mode.name}",
    "safetymode": lambda robot: f"Safetymode: {robot.safety_mode.name}",
    "safetystatus": lambda robot: f"Safetystatus: {robot.safety_mode.name}",
    "programstate": _program_state,
    "get loaded program": lambda robot: (
        f"Loaded program: {robot.loaded_program}" if robot.loaded_program else "No program loaded"
    ),
    "issaved": lambda _robot: "true <unnamed>",
    "isprogramsaved": lambda _robot: "true <unnamed>",
    "is in remote control": lambda robot: str(robot.is_remote).lower(),
    "unlock protective stop": _after(
        Controller.unlock_protective_stop, "Protective stop releasing"
    ),
    "restart safety": _after(Controller.restart_safety, "Restarting safety"),
    "power on": _after(Controller.power_on, "Powering on"),
    "power off": _after(Controller.power_off, "Powering off"),
    "brake release": _after(Controller.release_brakes, "Brake releasing"),
    "close popup": lambda _robot: "closing popup",
    "close safety popup": lambda _robot: "closing safety popup",
    "quit": lambda _robot: GOODBYE,
    "shutdown": lambda _robot: "Shutting down",
}
