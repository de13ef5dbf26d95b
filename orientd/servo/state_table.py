"""The servo's states and what leads from one to another: one table, one function that advances.

``STOPPING`` ends in ``HOLDING`` after a stop that was asked for and in ``FAULT`` after one that a
fault made necessary.  A fault of the device itself leads to ``FAULT`` at once.
"""

from __future__ import annotations

from enum import Enum

from orientd.errors import StateError
from orientd.stream import ServoState


class Event(Enum):
    """What can happen to a servo."""

    ENABLE = "enable"
    DISABLE = "disable"
    FREE = "free"
    START = "start"
    TUNE = "tune"
    SPEED = "speed"
    FINISH = "finish"
    SPLICE = "splice"
    STOP = "stop"
    HALT = "halt"
    TRACK = "track"
    BRAKE = "brake"
    REST = "rest"
    FAIL = "fail"
    RESET = "reset"


IDLE, HOLDING, STREAMING, STOPPING, FAULT, TRACKING = ServoState

_TO_REST = {
    IDLE: IDLE, HOLDING: HOLDING, FAULT: FAULT,
    STREAMING: STOPPING, STOPPING: STOPPING, TRACKING: STOPPING,
}  # fmt: skip

TRANSITIONS: dict[Event, dict[ServoState, ServoState]] = {
    Event.ENABLE: {IDLE: HOLDING, HOLDING: HOLDING},
    Event.DISABLE: {IDLE: IDLE, HOLDING: IDLE, FAULT: FAULT},
    Event.FREE: {IDLE: IDLE, HOLDING: IDLE},
    Event.START: {HOLDING: STREAMING},
    Event.TUNE: {HOLDING: HOLDING},
    Event.SPEED: {STREAMING: STREAMING},
    Event.FINISH: {STREAMING: HOLDING},
    Event.SPLICE: {STREAMING: STREAMING},
    Event.STOP: _TO_REST,
    Event.HALT: _TO_REST,
    Event.TRACK: dict.fromkeys((HOLDING, TRACKING, STREAMING), TRACKING),
    Event.BRAKE: dict.fromkeys((STREAMING, STOPPING, TRACKING), STOPPING),
    Event.REST: {STOPPING: HOLDING},
    Event.FAIL: dict.fromkeys(ServoState, FAULT),
    Event.RESET: {FAULT: IDLE, IDLE: IDLE},
}
"""Where each event leads from the states in which it is possible."""


def advance(state: ServoState, event: Event) -> ServoState:
    """Return the state that *event* leads to.

    Raises:
        StateError: the event is not possible in *state*; the message says in which it is.
    """
    following = TRANSITIONS[event].get(state)
    if following is None:
        possible = sorted(one.name.lower() for one in TRANSITIONS[event])
        raise StateError(
            f"{event.value} is not possible while {state.name.lower()}, only while "
            f"{' or '.join(possible)}"
        )
    return following
