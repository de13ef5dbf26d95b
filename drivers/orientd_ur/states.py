"""What a controller says of itself, and what of it keeps an arm from following."""

from __future__ import annotations

from enum import IntEnum


class RuntimeState(IntEnum):
    """What the program is doing."""

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
    """Return why the arm may not move, in words for a user; nothing where it may."""
    if safety_mode in _SAFETY:
        return _SAFETY[safety_mode]
    if robot_mode != RUNNING:
        mode = _ROBOT_MODES.get(robot_mode, str(robot_mode))
        return f"the arm is not running (robot mode: {mode}); power it on and release its brakes"
    return ""


def interruption(runtime_state: int) -> str:
    """Return why the control program does not follow; nothing while it plays."""
    if runtime_state == RuntimeState.PLAYING:
        return ""
    if runtime_state in (RuntimeState.PAUSED, RuntimeState.PAUSING):
        return "the control program is paused on the pendant; reset to start it again"
    return "the control program was stopped; reset to start it again"
