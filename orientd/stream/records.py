"""The records between daemon and servo: path, cycles, commands, and their bytes.

Every record carries its own index and a CRC-32.  A reader accepts a record only if both agree, so
it never accepts a slot that is being overwritten, even on machines with weakly ordered memory.  The
layouts are native: both processes run on one machine, from one installation.
"""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Any, NamedTuple

from orientd.driver import MOST_JOINTS, Quaternion, Vector3


class ServoState(IntEnum):
    """The servo's states; ``servo/state_table.py`` has the transitions.

    Their numbers are those of ``State`` in the protocol.

    >>> print(ServoState.HOLDING)
    HOLDING
    """

    IDLE = 1
    HOLDING = 2
    STREAMING = 3
    STOPPING = 4
    FAULT = 5
    TRACKING = 6

    def __str__(self) -> str:
        return self.name


MOVING = (ServoState.STREAMING, ServoState.STOPPING)
"""States in which the setpoints are those of a motion."""


class Command(IntEnum):
    """The commands of the daemon to the servo."""

    ENABLE = 1
    DISABLE = 2
    START = 3
    STOP = 4
    SPEED = 5
    RESET = 6
    SHUTDOWN = 7
    SPLICE = 8
    HALT = 9
    TRACK = 10
    TUNE = 11
    FREE = 12


class Answer(IntEnum):
    """The servo's answer to a command."""

    DONE = 0
    WRONG_STATE = 1
    REFUSED = 2
    FAILED = 3
    NOT_YET = 4
    """The speed is changing."""


JOINTS = MOST_JOINTS
"""Axes of a device for which a path record and a cycle record have space."""
NO_JOINTS = (math.nan,) * JOINTS
NO_Q: Quaternion = (math.nan, math.nan, math.nan, math.nan)
"""Planned orientation of a cycle that no motion with a path has."""

# index | q(4) omega(3) alpha(3) position(3) velocity(3) joints(8) their velocities(8)
PATH_FLOATS = 16 + 2 * JOINTS
PATH_RECORD = struct.Struct(f"@Q{PATH_FLOATS}d")

FINAL_WORD = 1
"""Word of the path ring: one more than the index of the newest motion's last record.

It is 0, or that of a previous motion, until that record is written.
"""

TAIL_WORD = 2
"""Word of the path ring: index of the oldest record that the servo still needs."""

# index, deadline_ns, lateness_ns, work_ns, feedback_time_ns, path_index |
# state, fault, motion, flags, overruns, missed |
# path_fraction, speed, q(4) omega(3) alpha(3) position(3), feedback q(4) omega(3) position(3),
# joints(8) sent joints(8), planned q(4)
CYCLE_RECORD = struct.Struct("@QqqqqQ6I45d")

# index, code, motion, path_index, leave_index, final_index, start_ns | speed, limits
LIMIT_FLOATS = 16
COMMAND_RECORD = struct.Struct(f"@QIIQqqq{1 + LIMIT_FLOATS}d")
UNKNOWN = -1
"""Index of a record that is not yet known."""

# index, time_ns, expires_ns | q(4), omega_body(3), position(3)
TARGET_RECORD = struct.Struct("@Qqq10d")
NOT_GIVEN: Vector3 = (math.nan, math.nan, math.nan)
"""Velocity or position of a target that has none."""

LEFT_OUT_WORD = 1
"""Word of the ring of targets: number of skipped targets."""

HELD_WORD = 2
"""Word of the ring of targets: one more than the place of the keep-out cone that holds the target
at its edge; 0 for none."""

DEVIATION_WORD, LARGEST_DEVIATION_WORD = 3, 4
"""Words of the ring of targets: distance of an arm's tool from its straight line to a target at
rest, nm, and the largest so far."""

CHUNK_POSES = 256
"""Poses of a chunk, at most."""

KNOT_FLOATS = 19
# index, observed_ns, poses, whether they have positions | times_ns, of each q(4) omega(3) alpha(3)
# position(3) velocity(3) acceleration(3)
CHUNK_RECORD = struct.Struct(f"@QqI?{CHUNK_POSES}q{CHUNK_POSES * KNOT_FLOATS}d")

# index, command index, kind, code, length of the text, text
NOTE_TEXT_BYTES = 400
NOTE_RECORD = struct.Struct(f"@QQIII{NOTE_TEXT_BYTES}s")


# index, length of the text, text
TUNING_TEXT_BYTES = 400
TUNING_RECORD = struct.Struct(f"@QI{TUNING_TEXT_BYTES}s")


# index, length of the text, text
HEALTH_TEXT_BYTES = 2000
HEALTH_RECORD = struct.Struct(f"@QI{HEALTH_TEXT_BYTES}s")

STOP_RECORD = struct.Struct("@Q?III")
"""A :class:`Stop`."""


class Sample(NamedTuple):
    """One pose of a chunk.

    Attributes:
        time_ns: when the device should be there, monotonic clock.
        q: orientation ``(w, x, y, z)``; its sign does not matter.
        omega: angular velocity in the body frame, rad/s; all samples of a chunk have one, or none.
        position: m; all samples of a chunk have one, or none.
    """

    time_ns: int
    q: Quaternion
    omega: Vector3 | None = None
    position: Vector3 | None = None


class NoteKind(IntEnum):
    """The subject of a note of the servo."""

    READY = 1
    """The driver is open; the text describes the scheduling of the process."""
    ANSWER = 2
    """Answer to a command: the code is an :class:`Answer`."""
    FAULT = 3
    """The device is in a fault: the code is a :class:`~orientd.errors.Fault`."""
    ENDING = 4
    """The process ends: the text has the reason."""
    NOTICE = 5
    """The driver has a message about its device, which is now open."""


class CycleFlag(IntEnum):
    """Bits of a cycle record's flags."""

    FEEDBACK = 1
    """The cycle has feedback."""
    WRITTEN = 2
    """The servo wrote a setpoint in this cycle."""
    FROM_REST = 4
    """Motion resumes from rest: the process was stalled for so long that the device had stopped."""
    ARRIVING = 8
    """The servo has sent the last setpoint of the motion, and the axes have not arrived yet."""


NO_AXES: Vector3 = (math.inf, math.inf, math.inf)
"""Component limits if only the norm is limited."""


@dataclass(frozen=True, slots=True)
class ServoLimits:
    """The limits of a motion, and how fast the servo may stop it on its path.

    Attributes:
        velocity: largest angular velocity, rad/s.
        acceleration: largest angular acceleration, rad/s^2.
        jerk: largest angular jerk, rad/s^3.
        linear_velocity: largest velocity of the position, m/s.
        linear_acceleration: its largest acceleration, m/s^2.
        brake_rate: a stop from full speed takes ``1 / brake_rate`` seconds; 1/s.
        axis_velocity: largest components of the angular velocity in the body frame, rad/s.
        axis_acceleration: largest components of the angular acceleration, rad/s^2.
        axis_jerk: largest components of the angular jerk, rad/s^3.
        path_tolerance: how far an arm's tool may leave the straight line to a target at rest, m.
        has_axes: whether any single component is limited.
    """

    velocity: float
    acceleration: float
    jerk: float
    linear_velocity: float
    linear_acceleration: float
    brake_rate: float
    axis_velocity: Vector3 = NO_AXES
    axis_acceleration: Vector3 = NO_AXES
    axis_jerk: Vector3 = NO_AXES
    path_tolerance: float = math.inf
    has_axes: bool = field(init=False, repr=False)

    def __post_init__(self) -> None:
        axes = (*self.axis_velocity, *self.axis_acceleration, *self.axis_jerk)
        # Only the constructor of the frozen class may set attributes.
        object.__setattr__(self, "has_axes", min(axes) < math.inf)

    def has_limits_of(self, other: ServoLimits) -> bool:
        """Return whether the limits are equal, apart from the brake rate."""
        return replace(self, brake_rate=other.brake_rate) == other

    def floats(self) -> tuple[float, ...]:
        """Return the :data:`LIMIT_FLOATS` numbers that represent limits in a command record."""
        return (
            self.velocity,
            self.acceleration,
            self.jerk,
            self.linear_velocity,
            self.linear_acceleration,
            self.brake_rate,
            *self.axis_velocity,
            *self.axis_acceleration,
            *self.axis_jerk,
            self.path_tolerance,
        )

    @classmethod
    def from_floats(cls, floats: Sequence[float]) -> ServoLimits:
        """Return the limits that :meth:`floats` encoded."""
        f = tuple(floats)
        fields: list[Any] = [*f[:6], f[6:9], f[9:12], f[12:15], f[15]]
        return cls(*fields)


def records_to_stop(brake_rate: float, period: float) -> int:
    """Return how many path records a stop from any rate may still use.

    Args:
        brake_rate: of the motion, 1/s.
        period: of the cycles, s.
    """
    return math.ceil(1.0 / (brake_rate * period)) + 2


class Stop(NamedTuple):
    """A stop that the servo received on its own socket.

    Attributes:
        number: number of the stop.
        is_quickest: whether it is a halt.
        pid: process that sent it.
        uid: user of that process.
        gid: group of that process; the one that admits it if the user alone does not.
    """

    number: int
    is_quickest: bool
    pid: int
    uid: int
    gid: int


@dataclass(frozen=True, slots=True)
class Note:
    """A message from the servo.

    Attributes:
        index: number of the note.
        command: index of the command that it answers.
        kind: its subject.
        code: an :class:`Answer` or a :class:`~orientd.errors.Fault`.
        text: the message.
    """

    index: int
    command: int
    kind: NoteKind
    code: int
    text: str


@dataclass(frozen=True, slots=True)
class Cycle:
    """One cycle of the servo, as published to the daemon.

    Attributes:
        index: number of the cycle since the servo started.
        deadline_ns: its deadline, monotonic clock.
        lateness_ns: time from the deadline to the start of the cycle.
        work_ns: duration of the *previous* cycle, from waking to having published.
        feedback_time_ns: time of the feedback's measurement; 0 without feedback.
        path_index: the path record at or before the setpoint.
        state: the servo's state.
        fault: reason of the fault state, as a :class:`~orientd.errors.Fault`.
        motion: number of the motion that the setpoint belongs to; 0 before the first.
        flags: :class:`CycleFlag` bits.
        overruns: number of cycles so far that began more than half a period late.
        missed: number of deadlines so far that the servo skipped.
        path_fraction: position between two path records, in [0, 1).
        speed: rate of the time scaling; 1 is as planned.
        q: commanded orientation, ``(w, x, y, z)``.
        omega_body: commanded angular velocity, rad/s.
        alpha_body: commanded angular acceleration, rad/s^2.
        position: commanded position, m.
        feedback_q: measured orientation.
        feedback_omega_body: measured angular velocity, rad/s.
        feedback_position: measured position, m.
        joints: measured axis angles, rad; empty if the device has no axes.
        sent_joints: commanded axis angles, rad; empty if the driver takes none.
        planned_q: orientation of the motion's path at its place; ``None`` without a path.
    """

    index: int
    deadline_ns: int
    lateness_ns: int
    work_ns: int
    feedback_time_ns: int
    path_index: int
    state: ServoState
    fault: int
    motion: int
    flags: int
    overruns: int
    missed: int
    path_fraction: float
    speed: float
    q: Quaternion
    omega_body: Vector3
    alpha_body: Vector3
    position: Vector3
    feedback_q: Quaternion
    feedback_omega_body: Vector3
    feedback_position: Vector3
    joints: tuple[float, ...] = ()
    sent_joints: tuple[float, ...] = ()
    planned_q: Quaternion | None = None

    @property
    def has_feedback(self) -> bool:
        """Whether the device has sent any feedback yet."""
        return bool(self.flags & CycleFlag.FEEDBACK)

    @property
    def feedback_age_ns(self) -> int:
        """Age of the feedback at the deadline, ns; -1 without feedback."""
        return self.deadline_ns - self.feedback_time_ns if self.has_feedback else -1


def pack_note(
    command: int, kind: NoteKind, code: int, text: str
) -> tuple[int, int, int, int, bytes]:
    """Return the fields of a note record after its index; a long text is cut."""
    encoded = text.encode(errors="replace")[:NOTE_TEXT_BYTES]
    return command, kind, code, len(encoded), encoded


def unpack_note(record: bytes) -> Note:
    """Decode one note record."""
    index, command, kind, code, length, text = NOTE_RECORD.unpack(record)
    return Note(index, command, NoteKind(kind), code, text[:length].decode(errors="replace"))


def record_index(record: bytes) -> int:
    """Return the index of a record, whatever its layout."""
    return int.from_bytes(record[:8], sys.byteorder)


def unpack_cycle(buffer: memoryview | bytes, offset: int = 0) -> Cycle:
    """Decode one cycle record.

    Args:
        buffer: bytes that hold a record.
        offset: where it begins.
    """
    f = CYCLE_RECORD.unpack_from(buffer, offset)
    sent = f[14:18], f[18:21], f[21:24], f[24:27]
    measured = f[27:31], f[31:34], f[34:37]
    joints = f[37 : 37 + JOINTS], f[37 + JOINTS : 37 + 2 * JOINTS]
    angles = (tuple(angle for angle in each if not math.isnan(angle)) for each in joints)
    planned_q = None if math.isnan(f[-1]) else f[-4:]
    fields: list[Any] = [*f[:6], ServoState(f[6]), *f[7:14], *sent, *measured, *angles, planned_q]
    return Cycle(*fields)
