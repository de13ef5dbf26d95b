"""The servo's states and what leads from one to another: one table, one function that advances.

``STOPPING`` ends in ``HOLDING`` after a stop that was asked for and in ``FAULT`` after one that a
fault made necessary.  A fault of the device itself leads to ``FAULT`` at once.
"""

from __future__ import annotations

from enum import Enum

from orientd.errors import StateError
from orientd.stream import State


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


TRANSITIONS: dict[tuple[State, Event], State] = {
    (State.IDLE, Event.ENABLE): State.HOLDING,
    (State.HOLDING, Event.ENABLE): State.HOLDING,
    (State.IDLE, Event.DISABLE): State.IDLE,
    (State.HOLDING, Event.DISABLE): State.IDLE,
    (State.HOLDING, Event.START): State.STREAMING,
    (State.HOLDING, Event.TUNE): State.HOLDING,
    (State.STREAMING, Event.SPEED): State.STREAMING,
    (State.STREAMING, Event.SPLICE): State.STREAMING,
    (State.STREAMING, Event.FINISH): State.HOLDING,
    (State.STREAMING, Event.STOP): State.STOPPING,
    (State.STOPPING, Event.STOP): State.STOPPING,
    (State.HOLDING, Event.STOP): State.HOLDING,
    (State.IDLE, Event.STOP): State.IDLE,
    (State.HOLDING, Event.TRACK): State.TRACKING,
    (State.TRACKING, Event.TRACK): State.TRACKING,
    (State.STREAMING, Event.TRACK): State.TRACKING,
    (State.TRACKING, Event.STOP): State.STOPPING,
    (State.TRACKING, Event.HALT): State.STOPPING,
    (State.TRACKING, Event.BRAKE): State.STOPPING,
    (State.TRACKING, Event.FAIL): State.FAULT,
    (State.STREAMING, Event.HALT): State.STOPPING,
    (State.STOPPING, Event.HALT): State.STOPPING,
    (State.HOLDING, Event.HALT): State.HOLDING,
    (State.IDLE, Event.HALT): State.IDLE,
    (State.FAULT, Event.HALT): State.FAULT,
    (State.STREAMING, Event.BRAKE): State.STOPPING,
    (State.STOPPING, Event.BRAKE): State.STOPPING,
    (State.STOPPING, Event.REST): State.HOLDING,
    (State.IDLE, Event.FAIL): State.FAULT,
    (State.HOLDING, Event.FAIL): State.FAULT,
    (State.STREAMING, Event.FAIL): State.FAULT,
    (State.STOPPING, Event.FAIL): State.FAULT,
    (State.FAULT, Event.FAIL): State.FAULT,
    (State.FAULT, Event.STOP): State.FAULT,
    (State.FAULT, Event.RESET): State.IDLE,
    (State.IDLE, Event.RESET): State.IDLE,
}


def advance(state: State, event: Event) -> State:
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
