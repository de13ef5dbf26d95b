"""What the daemon knows of a device: how it is now, and what has happened to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING

from orientd.driver import PartHealth
from orientd.errors import Fault
from orientd.stream import Cycle, ServoState

if TYPE_CHECKING:
    from orientd.daemon.planners import PlannedMotion


STOPPED = "stopped on its path"
"""Text of a motion that was stopped, where there is no more to say of it than why."""


class EventKind(Enum):
    """What the daemon reports of a device."""

    READY = "ready"
    MOTION_STARTED = "motion started"
    MOTION_DONE = "motion done"
    MOTION_PASSED = "motion passed"
    MOTION_STOPPED = "motion stopped"
    MOTION_REPLACED = "motion replaced"
    MOTION_UNSETTLED = "motion unsettled"
    ON_TARGET = "on target"
    FAULT = "fault"
    SERVO_DIED = "servo died"
    RECORDED = "recorded"
    RECORDING_FAILED = "recording failed"
    WARNING = "warning"
    STOP = "stop"
    """A servo was stopped without the daemon; the text says by whom."""


@dataclass(frozen=True, slots=True)
class DeviceEvent:
    """Something that happened to a device.

    Attributes:
        device: its name.
        kind: what happened.
        motion_number: the motion it happened to, 0 for none.
        text: in words.
        time_ns: when the daemon saw it, monotonic clock.
        motion: what has started.
        path_index: of its first record, where that is known.
    """

    device: str
    kind: EventKind
    motion_number: int
    text: str
    time_ns: int
    motion: PlannedMotion | None = None
    path_index: int | None = None


@dataclass(frozen=True, slots=True)
class DeviceSnapshot:
    """A device as it is now.

    Attributes:
        cycle: the newest cycle, ``None`` before the first.
        state: the servo's state; ``FAULT`` where there is no servo.
        fault: why it is in a fault.
        fault_text: in words.
        is_paused: whether a motion stands on its path, to be resumed.
        speed: the speed that motions run at, or are resumed at.
        motion: the motion last started.
        motion_number: its number, 0 before the first.
        path_time: time within that motion, s; for a device that is led, where the device is to be,
            not what is being sent.
        tracking_error: angle between the feedback and where the device is to be, rad; ``None``
            without feedback.
        servo_pid: process id of the servo, ``None`` where there is none.
        scheduling: what scheduling the servo has got.
        memory_locked: whether its memory is locked.
        health: how the device's parts are, as last measured.
        longest_calls: how long the driver's longest ``read`` and ``write`` took, s.
    """

    cycle: Cycle | None
    state: ServoState
    fault: Fault
    fault_text: str
    is_paused: bool
    speed: float
    motion: PlannedMotion | None
    motion_number: int
    path_time: float
    tracking_error: float | None
    servo_pid: int | None
    scheduling: str
    memory_locked: bool
    health: tuple[PartHealth, ...] = ()
    longest_calls: Mapping[str, float] = field(default_factory=dict)
