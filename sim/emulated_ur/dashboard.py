"""The dashboard server's language: a line in, a line out; no sockets here."""

from __future__ import annotations

from collections.abc import Callable

from emulated_ur.controller import Controller, RefusedError
from emulated_ur.variables import ProgramState

WELCOME = "Connected: Universal Robots Dashboard Server"
GOODBYE = "Disconnected"

# First version of CB3 and of all others; None where CB3 never knew it.
_SINCE: dict[str, tuple[tuple[int, ...] | None, tuple[int, ...]]] = {
    "is in remote control": (None, (5, 6)),
    "get serial number": ((3, 12), (5, 6)),
    "get robot model": ((3, 12), (5, 6)),
    "get operational mode": (None, (5, 6)),
    "set operational mode ": (None, (5, 0)),
    "clear operational mode": (None, (5, 0)),
    "generate flight report ": ((3, 13), (5, 8)),
    "generate support file ": ((3, 13), (5, 8)),
    "setuserrole ": ((1,), (99,)),
    "getuserrole": ((1,), (99,)),
    "safetystatus": ((3, 11), (5, 4)),
}


def reply(robot: Controller, line: str) -> str:
    """Carry out one line from a client and return the answer, without the line's end."""
    command = line.strip()
    lowered = command.lower()
    for start, action in _WITH_ARGUMENT.items():
        if f"{lowered} ".startswith(start) and _is_known(start, robot.behaviour.version):
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
    if name in robot.missing_files:
        return f"File not found: {name}"
    robot.loaded_program = name
    return f"Loading program: {name}"


def _load_installation(robot: Controller, name: str) -> str:
    if not name or name in robot.missing_files:
        return f"File not found: {name}"
    return f"Loading installation: {name}"


def _set_mode(robot: Controller, mode: str) -> str:
    if mode.lower() not in ("manual", "automatic"):
        return f"Failed setting operational mode: {mode}"
    robot.operational_mode = mode.upper()
    return f"Setting operational mode: {mode}"


def _clear_mode(robot: Controller) -> str:
    now, robot.operational_mode = robot.operational_mode, "NONE"
    return f"No longer controlling the operational mode. Current operational mode: '{now}'."


def _set_role(robot: Controller, role: str) -> str:
    if role.lower() not in ("programmer", "operator", "none", "locked", "restricted"):
        return f"Failed setting user role: {role}"
    robot.user_role = role.upper()
    return f"Setting user role: {role}"


def _popup(robot: Controller, text: str) -> str:
    robot.open_popup(text, "Popup", warning=False, error=False, blocking=False)
    return "showing popup"


def _report(robot: Controller, kind: str) -> str:
    if kind.lower() not in ("controller", "software", "system"):
        return f"Error: unknown report type {kind!r}, expected controller, software or system"
    return f"Flight Report generated with id: {robot.ticks}"


def _log(robot: Controller, text: str) -> str:
    robot.say(text)
    return "Added log message"


_WITH_ARGUMENT: dict[str, Callable[[Controller, str], str]] = {
    "load installation ": _load_installation,
    "load ": _load,
    "addtolog ": _log,
    "popup ": _popup,
    "setuserrole ": _set_role,
    "set operational mode ": _set_mode,
    "generate flight report ": _report,
    "generate support file ": lambda _robot, place: (
        f"Completed successfully: {place}/ur_support_file.zip" if place else "Error: no directory"
    ),
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
    "safetystatus": lambda robot: f"Safetystatus: {robot.safety_status.name}",
    "version": lambda robot: ".".join(map(str, robot.behaviour.version)),
    "get operational mode": lambda robot: robot.operational_mode,
    "clear operational mode": _clear_mode,
    "getuserrole": lambda robot: robot.user_role,
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
    "close popup": _after(Controller.close_popup, "closing popup"),
    "close safety popup": lambda _robot: "closing safety popup",
    "quit": lambda _robot: GOODBYE,
    "shutdown": _after(Controller.power_off, "Shutting down"),
}
