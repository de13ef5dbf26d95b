"""What a device reports: what has happened to it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from orientd.protocol import control_pb2 as pb

if TYPE_CHECKING:
    from orientd.daemon.planners import PlannedMotion


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


@dataclass(frozen=True, slots=True)
class DeviceEvent:
    """Something that happened to a device.

    Attributes:
        device: its name.
        kind: what happened.
        motion_number: the motion it happened to, 0 for none.
        text: in words.
        time_ns: when the daemon saw it, monotonic clock.
        motion: the motion that has started.
        path_index: of its first record, if that is known.
        motion_id, motion_name: of the motion it happened to; empty for targets.
        outcome: how that motion has ended; ``None`` if it goes on.
        reason: why it has ended.
        commander, identity: who has started it, for people and as the daemon knows them.
    """

    device: str
    kind: EventKind
    motion_number: int
    text: str
    time_ns: int
    motion: PlannedMotion | None = None
    path_index: int | None = None
    motion_id: str = ""
    motion_name: str = ""
    outcome: pb.Outcome | None = None
    reason: str = ""
    commander: str = ""
    identity: str = ""
