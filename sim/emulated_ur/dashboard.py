"""The dashboard server's protocol: a line in, a line out; no sockets here."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from emulated_ur.controller import Controller, RefusedError
from emulated_ur.variables import ProgramState, Since

WELCOME = "Connected: Universal Robots Dashboard Server"
GOODBYE = "Disconnected"

_USER_ROLES = ("programmer", "operator", "none", "locked", "restricted")


class Command(NamedTuple):
    """One command with its action and its answer.

    Attributes:
        answer: its text; braces stand for the robot.
        do: the action before the answer.
        reply: action and answer of a command with an argument or two answers.
        needs_remote: whether local control forbids it.
        since: the first software with it.
    """

    answer: str = ""
    do: Callable[[Controller], None] | None = None
    reply: Callable[[Controller, str], str] | None = None
    needs_remote: bool = False
    since: Since = Since()


def reply(robot: Controller, line: str) -> str:
    """Execute one line from a client and return the answer, without the line's end."""
    asked = line.strip()
    name = next((one for one in _COMMANDS if f"{asked.lower()} ".startswith(f"{one} ")), "")
    command, argument = _COMMANDS.get(name), asked[len(name) :].strip()
    is_known = command is not None and command.since.includes(robot.behaviour.version)
    if command is None or not is_known or (argument and not command.reply):
        return f"could not understand: {asked}"
    if command.needs_remote and not robot.is_remote:
        return "Command is not allowed due to safety reasons"
    try:
        if command.reply:
            return command.reply(robot, argument)
        if command.do:
            command.do(robot)
    except RefusedError as refused:
        return str(refused)
    return command.answer.format(robot)


def _program_state(robot: Controller, _: str) -> str:
    states = {ProgramState.PLAYING: "PLAYING", ProgramState.PAUSED: "PAUSED"}
    name = robot.loaded_program or "<unnamed>"
    return f"{states.get(robot.runtime_state, 'STOPPED')} {name}"


def _loaded(robot: Controller, _: str) -> str:
    name = robot.loaded_program
    return f"Loaded program: {name}" if name else "No program loaded"


def _is_running(robot: Controller, _: str) -> str:
    return f"Program running: {str(robot.runtime_state is ProgramState.PLAYING).lower()}"


def _is_remote(robot: Controller, _: str) -> str:
    return str(robot.is_remote).lower()


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


def _clear_mode(robot: Controller, _: str) -> str:
    now, robot.operational_mode = robot.operational_mode, "NONE"
    return f"No longer controlling the operational mode. Current operational mode: '{now}'."


def _set_role(robot: Controller, role: str) -> str:
    if role.lower() not in _USER_ROLES:
        return f"Failed setting user role: {role}"
    robot.user_role = role.upper()
    return f"Setting user role: {role}"


def _popup(robot: Controller, text: str) -> str:
    robot.open_popup(text, "Popup", False, False, False)
    return "showing popup"


def _report(robot: Controller, kind: str) -> str:
    if kind.lower() not in ("controller", "software", "system"):
        return f"Error: unknown report type {kind!r}, expected controller, software or system"
    return f"Flight Report generated with id: {robot.ticks}"


def _support_file(_: Controller, place: str) -> str:
    return (
        f"Completed successfully: {place}/ur_support_file.zip" if place else "Error: no directory"
    )


def _log(robot: Controller, text: str) -> str:
    robot.say(text)
    return "Added log message"


_CB3 = Since((1,), None)
_E_SERIES = Since(None)
_IDENTITY = Since((3, 12), (5, 6))
_REPORT = Since((3, 13), (5, 8))

_COMMANDS = {
    "polyscopeversion": Command("URSoftware {0.behaviour.software} (Oct 13 2022)"),
    "version": Command("{0.behaviour.software}"),
    "get serial number": Command("{0.behaviour.serial}", since=_IDENTITY),
    "get robot model": Command("{0.behaviour.model.dashboard_name}", since=_IDENTITY),
    "stop": Command("Stopped", Controller.stop),
    "play": Command("Starting program", Controller.play, needs_remote=True),
    "pause": Command("Pausing program", Controller.pause),
    "running": Command(reply=_is_running),
    "robotmode": Command("Robotmode: {0.robot_mode.name}"),
    "safetymode": Command("Safetymode: {0.safety_mode.name}"),
    "safetystatus": Command("Safetystatus: {0.safety_status.name}", since=Since((3, 11), (5, 4))),
    "programstate": Command(reply=_program_state),
    "get loaded program": Command(reply=_loaded),
    "load installation": Command(reply=_load_installation),
    "load": Command(reply=_load),
    "issaved": Command("true <unnamed>"),
    "isprogramsaved": Command("true <unnamed>"),
    "is in remote control": Command(reply=_is_remote, since=Since(None, (5, 6))),
    "get operational mode": Command("{0.operational_mode}", since=Since(None, (5, 6))),
    "set operational mode": Command(reply=_set_mode, since=_E_SERIES),
    "clear operational mode": Command(reply=_clear_mode, since=_E_SERIES),
    "getuserrole": Command("{0.user_role}", since=_CB3),
    "setuserrole": Command(reply=_set_role, since=_CB3),
    "unlock protective stop": Command(
        "Protective stop releasing", Controller.unlock_protective_stop, needs_remote=True
    ),
    "restart safety": Command("Restarting safety", Controller.restart_safety),
    "power on": Command("Powering on", Controller.power_on, needs_remote=True),
    "power off": Command("Powering off", Controller.power_off, needs_remote=True),
    "brake release": Command("Brake releasing", Controller.release_brakes, needs_remote=True),
    "popup": Command(reply=_popup),
    "close popup": Command("closing popup", Controller.close_popup),
    "close safety popup": Command("closing safety popup"),
    "addtolog": Command(reply=_log),
    "generate flight report": Command(reply=_report, since=_REPORT),
    "generate support file": Command(reply=_support_file, since=_REPORT),
    "quit": Command(GOODBYE),
    "shutdown": Command("Shutting down", Controller.power_off),
}
"""Longer names with the same beginning come first."""
