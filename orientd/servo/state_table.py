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


TRANSITIONS: dict[tuple[ServoState, Event], ServoState] = {
    (ServoState.IDLE, Event.ENABLE): ServoState.HOLDING,
    (ServoState.HOLDING, Event.ENABLE): ServoState.HOLDING,
    (ServoState.IDLE, Event.DISABLE): ServoState.IDLE,
    (ServoState.HOLDING, Event.DISABLE): ServoState.IDLE,
    (ServoState.HOLDING, Event.START): ServoState.STREAMING,
    (ServoState.HOLDING, Event.TUNE): ServoState.HOLDING,
    (ServoState.STREAMING, Event.SPEED): ServoState.STREAMING,
    (ServoState.STREAMING, Event.SPLICE): ServoState.STREAMING,
    (ServoState.STREAMING, Event.FINISH): ServoState.HOLDING,
    (ServoState.STREAMING, Event.STOP): ServoState.STOPPING,
    (ServoState.STOPPING, Event.STOP): ServoState.STOPPING,
    (ServoState.HOLDING, Event.STOP): ServoState.HOLDING,
    (ServoState.IDLE, Event.STOP): ServoState.IDLE,
    (ServoState.HOLDING, Event.TRACK): ServoState.TRACKING,
    (ServoState.TRACKING, Event.TRACK): ServoState.TRACKING,
    (ServoState.STREAMING, Event.TRACK): ServoState.TRACKING,
    (ServoState.TRACKING, Event.STOP): ServoState.STOPPING,
    (ServoState.TRACKING, Event.HALT): ServoState.STOPPING,
    (ServoState.TRACKING, Event.BRAKE): ServoState.STOPPING,
    (ServoState.TRACKING, Event.FAIL): ServoState.FAULT,
    (ServoState.STREAMING, Event.HALT): ServoState.STOPPING,
    (ServoState.STOPPING, Event.HALT): ServoState.STOPPING,
    (ServoState.HOLDING, Event.HALT): ServoState.HOLDING,
    (ServoState.IDLE, Event.HALT): ServoState.IDLE,
    (ServoState.FAULT, Event.HALT): ServoState.FAULT,
    (ServoState.STREAMING, Event.BRAKE): ServoState.STOPPING,
    (ServoState.STOPPING, Event.BRAKE): ServoState.STOPPING,
    (ServoState.STOPPING, Event.REST): ServoState.HOLDING,
    (ServoState.IDLE, Event.FAIL): ServoState.FAULT,
    (ServoState.HOLDING, Event.FAIL): ServoState.FAULT,
    (ServoState.STREAMING, Event.FAIL): ServoState.FAULT,
    (ServoState.STOPPING, Event.FAIL): ServoState.FAULT,
    (ServoState.FAULT, Event.FAIL): ServoState.FAULT,
    (ServoState.FAULT, Event.STOP): ServoState.FAULT,
    (ServoState.FAULT, Event.RESET): ServoState.IDLE,
    (ServoState.IDLE, Event.RESET): ServoState.IDLE,
}


def advance(state: ServoState, event: Event) -> ServoState:
    """Return the state that *event* leads to.

    Raises:
        StateError: the event is not possible in *state*; the message says in which it is.
    """
    following = TRANSITIONS.get((state, event))
    if following is None:
        possible = sorted(s.name.lower() for s, e in TRANSITIONS if e is event)
        raise StateError(
            f"{event.value} is not possible while {state.name.lower()}, only while "
            f"{' or '.join(possible)}"
        )
    return following
