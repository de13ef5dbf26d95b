"""The state of a controller in words: its software, its modes, its program.

Versions are tuples that begin with major and minor: 3 is CB3, 5 the e-Series, 10 PolyScope X.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum

# Feature: the first version with it, of CB3, of the e-Series, of PolyScope X; None for none.
# Sources: the client library's registers and script; `dashboard_client.cpp` of
# Universal_Robots_Client_Library for remote control.
_SINCE: dict[str, dict[int, tuple[int, ...] | None]] = {
    "the client library": {3: (3, 4), 5: (5, 4), 10: (10, 10)},
    "a dashboard server": {3: (3,), 5: (5,), 10: None},
    "is in remote control": {3: None, 5: (5, 6), 10: None},
}

NO_DASHBOARD = (
    "PolyScope X has no dashboard server: unlock protective stops, power the arm and release its "
    "brakes on the pendant; whether it is in remote control, as it must be, is not known"
)


def software(version: Sequence[int]) -> str:
    """Return the name of the software."""
    return "PolyScope " + ".".join(str(part) for part in version[:3])


def has(feature: str, version: Sequence[int]) -> bool:
    """Return whether a robot with this *version* has *feature*."""
    first = _first(feature, version)
    return first is not None and tuple(version) >= first


def version_problem(version: Sequence[int]) -> str:
    """Return why the client library cannot drive this version, or an empty string."""
    if has("the client library", version):
        return ""
    needed = ".".join(map(str, _first("the client library", version) or ()))
    return f"{software(version)} is too old for the client library; {needed} or newer is needed"


def tick_ns(version: Sequence[int]) -> int:
    """Return the cycle of a controller with the software *version*, ns; CB3 robots have 8 ms."""
    return 8_000_000 if version[0] < 5 else 2_000_000


def rate_problem(version: Sequence[int], period_ns: int) -> str:
    """Return why a robot cannot take a setpoint every *period_ns*, or an empty string."""
    cycle_ns = tick_ns(version)
    if period_ns >= cycle_ns:
        return ""
    return (
        f"takes a setpoint every {cycle_ns * 1e-6:g} ms: `rate_hz` must be {1e9 / cycle_ns:g} at "
        "the most"
    )


def _first(feature: str, version: Sequence[int]) -> tuple[int, ...] | None:
    """Return the first version of the robot's series with *feature*; ``None`` if none has it."""
    return _SINCE[feature][3 if version[0] < 5 else 5 if version[0] < 10 else 10]


class RuntimeState(IntEnum):
    """State of the program."""

    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


RUNNING = 7
"""The robot mode in which the arm has power and its brakes are off."""

_ROBOT_MODES = {
    -1: "no controller",
    0: "disconnected",
    1: "confirm safety",
    2: "booting",
    3: "power off",
    4: "power on",
    5: "idle",
    6: "backdrive",
    8: "updating firmware",
}

PROTECTIVE_STOP = 3

_SAFETY = {
    3: "protective stop: look for its cause on the pendant, then reset",
    4: "recovery mode: move the arm back into its limits by the pendant, then reset",
    5: "safeguard stop: close the safeguard, then reset",
    6: "system emergency stop: release it, then reset",
    7: "emergency stop: release the button, then reset",
    8: "safety violation: restart the safety system on the pendant, then reset",
    9: "safety fault: restart the safety system on the pendant, then reset",
    10: "validating joints",
    11: "undefined safety mode",
    12: "automatic mode safeguard stop: close the safeguard, then reset",
    13: "three-position enabling stop: hold the switch in its middle, then reset",
}


def obstacle(robot_mode: int, safety_mode: int) -> str:
    """Return why the arm may not move, for users, or an empty string."""
    if safety_mode in _SAFETY:
        return _SAFETY[safety_mode]
    if robot_mode != RUNNING:
        mode = _ROBOT_MODES.get(robot_mode, str(robot_mode))
        return f"the arm is not running (robot mode: {mode}); power it on and release its brakes"
    return ""


def interruption(runtime_state: int) -> str:
    """Return why the control program does not follow setpoints, or an empty string."""
    if runtime_state == RuntimeState.PLAYING:
        return ""
    if runtime_state in (RuntimeState.PAUSED, RuntimeState.PAUSING):
        return "the control program is paused on the pendant; reset to start it again"
    return "the control program was stopped; reset to start it again"
