"""Describe the events of a device, such as the start of a motion or a fault."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from orientd.daemon.device.queued_motion import Ended, QueuedMotion
from orientd.daemon.leases import Lease


class EventKind(Enum):
    """Name the events that the daemon reports for a device."""

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


@dataclass(frozen=True, slots=True)
class DeviceEvent:
    """Something that happened to a device.

    Attributes:
        device: its name.
        kind: of the event.
        text: in words.
        time_ns: when the daemon saw it, monotonic clock.
        queued: the motion that it happened to; ``None`` if it happened to none.
        ended: how that motion has ended and why; ``None`` if it continues.
        lease: the lease under which it was started.
    """

    device: str
    kind: EventKind
    text: str
    time_ns: int
    queued: QueuedMotion | None = None
    ended: Ended | None = None
    lease: Lease | None = None

    @property
    def motion_number(self) -> int:
        """Number of the motion that it happened to; 0 for none."""
        return 0 if self.queued is None else self.queued.number
