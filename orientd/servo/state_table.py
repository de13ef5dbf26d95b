"""The servo's states: one table of transitions and one function that looks up the next state.

``STOPPING`` ends in ``HOLDING`` after a requested stop, and in ``FAULT`` after a stop caused by a
fault.  A fault of the device itself leads to ``FAULT`` at once.
"""

from __future__ import annotations

from enum import Enum

from orientd.errors import StateError
from orientd.stream.records import Command, ServoState


class Event(Enum):
    """Events of a servo that are not commands."""

    REST = "rest"
    FAIL = "fail"


IDLE, HOLDING, STREAMING, STOPPING, FAULT, TRACKING = ServoState

_TO_REST = {
    IDLE: IDLE, HOLDING: HOLDING, FAULT: FAULT,
    STREAMING: STOPPING, STOPPING: STOPPING, TRACKING: STOPPING,
}  # fmt: skip

TRANSITIONS: dict[Command | Event, dict[ServoState, ServoState]] = {
    Command.ENABLE: {IDLE: HOLDING, HOLDING: HOLDING},
    Command.DISABLE: {IDLE: IDLE, HOLDING: IDLE, FAULT: FAULT},
    Command.FREE: {IDLE: IDLE, HOLDING: IDLE},
    Command.START: {HOLDING: STREAMING},
    Command.TUNE: {HOLDING: HOLDING},
    Command.SPEED: {STREAMING: STREAMING},
    Command.SPLICE: {STREAMING: STREAMING},
    Command.STOP: _TO_REST,
    Command.HALT: _TO_REST,
    Command.TRACK: dict.fromkeys((HOLDING, TRACKING, STREAMING), TRACKING),
    Command.RESET: {FAULT: IDLE, IDLE: IDLE},
    Event.REST: {STREAMING: HOLDING, STOPPING: HOLDING},
    Event.FAIL: dict.fromkeys(ServoState, FAULT),
}
"""The next state for each command or event, from each state in which it is possible."""


def advance(state: ServoState, event: Command | Event) -> ServoState:
    """Return the next state for *event*.

    Raises:
        StateError: the event is not possible in *state*; the message names the possible states.
    """
    following = TRANSITIONS[event].get(state)
    if following is None:
        possible = sorted(one.name.lower() for one in TRANSITIONS[event])
        raise StateError(
            f"{event.name.lower()} is not possible while {state.name.lower()}, only while "
            f"{' or '.join(possible)}"
        )
    return following
