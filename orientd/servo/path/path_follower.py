"""Follow the path: the current position on it, and how much path is left.

Path time is counted in records: ``index + fraction``.  A motion as planned moves by exactly one
record a cycle, so its setpoints *are* the records.  Between two records a
:class:`~orientd.servo.path.segment.Segment` interpolates.

The path consists of parts, one for each motion.  A motion that replaces or continues another one is
spliced onto it.  Its first record lies further on in the ring, and is the same point as the record
at which the servo leaves the previous part.  The parts are joined in path time, so the rate of the
time scaling does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf

from orientd.driver import IDENTITY, ZERO, Joints, Vector3
from orientd.errors import OrientdError
from orientd.floats import difference, norm, plus
from orientd.servo.keep_out_cones import MOST_DRIFT, SLACK, KeepOutCones
from orientd.servo.path.segment import PathPoint, Segment, point_of
from orientd.stream.records import FINAL_WORD, NO_Q, TAIL_WORD, UNKNOWN, ServoLimits
from orientd.stream.ring import HEAD, RecordRing
from orientd.tolerances import NORM_TOLERANCE

MOST_LEGS = 16
"""Most parts ahead of the current one."""

_SAME_Q = 1e-9  # rad
_SAME_RATE = 1e-6  # of 1 + the rate itself; rad/s and rad/s^2
_SAME_POSITION = 1e-9  # m
_SAME_JOINTS = 1e-8  # rad: close to a pole rounding is more than elsewhere


class StarvedError(OrientdError):
    """The next record is not in the ring."""


@dataclass(frozen=True, slots=True, eq=False)
class PathPart:
    """One motion's part of the path.

    Attributes:
        number: of the motion.
        first: index of its first record.
        servo_limits: limits that the motion keeps.
        leave: index of the record at which the servo leaves the previous part for this one.
        final: index of its last record, if that is known already.
    """

    number: int
    first: int
    servo_limits: ServoLimits
    leave: int = UNKNOWN
    final: int = UNKNOWN


class PathFollower:
    """A position on the path ring.

    Attributes:
        index: the record at or before the setpoint.
        fraction: distance beyond it, in records, in [0, 1).
        q: orientation of the path there; NaN before the first motion.
        part: the motion that it belongs to.
        is_at_end: whether this is the last record of all.
        revision: number of changes of the path ahead.
    """

    def __init__(self, ring: RecordRing, period: float, servo_limits: ServoLimits) -> None:
        """Follow *ring*, whose records are *period* seconds of path time apart."""
        self.index = 0
        self.fraction = 0.0
        self.q = NO_Q
        self.part = PathPart(0, 0, servo_limits)
        self.is_at_end = False
        self.revision = 0
        self._ahead: list[PathPart] = []
        self._ring = ring
        self._period = period
        self._loaded = UNKNOWN
        self._point = PathPoint(IDENTITY, ZERO, ZERO, ZERO, ZERO)
        self._segment: Segment | None = None

    def peek(self, index: int) -> PathPoint | None:
        """Return record *index*, or ``None`` if it is not in the ring."""
        ring = self._ring
        if not 0 <= index < ring.words[HEAD]:
            return None
        # A record being published is there a microsecond later.
        fields = ring.read(index) or ring.read(index) or ring.read(index)
        return None if fields is None else point_of(fields)

    def begin(self, part: PathPart) -> None:
        """Move to the first record of *part*, which is in the ring."""
        self.part = part
        self.revision += 1
        self._ahead.clear()
        self.index, self.fraction, self.is_at_end = part.first, 0.0, False
        self._load(part.first)
        self.q = self._point.q
        self._ring.words[TAIL_WORD] = part.first

    def splice(self, part: PathPart) -> str:
        """Continue with *part* from its record ``leave``; drop the previous continuation.

        Returns:
            An empty string, or the reason why it is impossible; then nothing has changed.
        """
        if part.leave < self.index + bool(self.fraction):
            return f"the path has passed record {part.leave}, it is at {self.index}"
        parts = [self.part, *self._ahead]
        place = max(k for k, other in enumerate(parts) if other.first <= part.leave)
        if place + 1 < len(parts) and part.leave > parts[place + 1].leave:
            return f"record {part.leave} is not on the path any more"
        if place >= MOST_LEGS:
            return f"there are {place} motions ahead already"
        old, new = self.peek(part.leave), self.peek(part.first)
        if old is None or new is None:
            missing = part.leave if old is None else part.first
            return f"path record {missing} is not in the ring"
        problem = _differ(old, new)
        if problem:
            return problem
        self._ahead = [*parts[1 : place + 1], part]
        self.revision += 1
        return ""

    @property
    def slowest_brake_rate(self) -> float:
        """The least brake rate of all parts from here on, 1/s."""
        return min(part.servo_limits.brake_rate for part in (self.part, *self._ahead))

    @property
    def fastest(self) -> float:
        """The largest velocity limit of all parts from here on, rad/s."""
        return max(part.servo_limits.velocity for part in (self.part, *self._ahead))

    @property
    def _final(self) -> int:
        """Index of the last part's last record, or :data:`UNKNOWN`."""
        part = self._ahead[-1] if self._ahead else self.part
        final = max(self._ring.words[FINAL_WORD] - 1, part.final)
        return final if final >= part.first else UNKNOWN

    def _walk(self, records: int) -> tuple[int, PathPart]:
        """Return the index of the record at a distance beyond :attr:`index`, and its part."""
        index, part = self.index + records, self.part
        for following in self._ahead:
            if index < following.leave:
                break
            index, part = following.first + index - following.leave, following
        return index, part

    def reaches(self, records: int) -> bool:
        """Whether the ring has the motion's end, or at least a number of further records."""
        last = self._ring.head - 1
        # Behind the end may be records that the servo does not know yet.
        return self._walk(records)[0] <= last or UNKNOWN != self._final <= last

    def records_left(self) -> float:
        """Return the number of records to the end of the last part; infinity if unknown."""
        final = self._final
        if self._ahead or final == UNKNOWN:
            return inf
        return final - self.index - self.fraction

    def peek_ahead(self, records: int) -> PathPoint | None:
        """Return the record at a distance beyond :attr:`index`, or ``None``.

        It is also ``None`` beyond a splice to a part with other servo limits.
        """
        part = self._walk(records)[1]
        if part is not self.part and not part.servo_limits.has_limits_of(self.part.servo_limits):
            return None
        return self.record_ahead(records)

    def record_ahead(self, records: int) -> PathPoint | None:
        """Return the record at a distance beyond :attr:`index`, whatever the servo limits there.

        ``None`` beyond the end, or if it is not in the ring yet.
        """
        index, part = self._walk(records)
        is_last = part is (self._ahead[-1] if self._ahead else self.part)
        if is_last and index > self._final != UNKNOWN:
            return None
        return self.peek(index)

    def advance(self, records: float) -> PathPoint:
        """Move by a number of records, at most beyond the next one, and return the point there.

        The servo never passes the last record of a motion, unless another part begins there.

        Raises:
            StarvedError: the path ends before that without being at rest; nothing has moved.
        """
        index, fraction, part, following = self.index, self.fraction + records, self.part, None
        if self._ahead:
            following = self._ahead[0]
            if index == following.leave:
                part, index = following, following.first
        if fraction >= 1.0:
            index, fraction = index + 1, fraction - 1.0
            if following is not None and part is not following and index == following.leave:
                part, index = following, following.first
        is_end = False
        if part is (self._ahead[-1] if self._ahead else self.part):
            final = self._final
            if index >= final != UNKNOWN:
                index, fraction, is_end = final, 0.0, True
        if index != self._loaded:
            self._load(index)
        point = self._point
        if fraction != 0.0:
            if self._segment is None:  # else kept from the last time
                end = self.peek(index + 1)
                if end is None:
                    raise StarvedError(f"path record {index + 1} is not in the ring")
                self._segment = Segment(point, end, self._period)
            point = self._segment.at(fraction)
        self.index, self.fraction, self.is_at_end = index, fraction, is_end
        self.q = point.q
        if part is not self.part:
            self.part = part
            del self._ahead[0]
        self._ring.words[TAIL_WORD] = index
        return point

    def _load(self, index: int) -> None:
        point = self.peek(index)
        if point is None:
            raise StarvedError(f"path record {index} is not in the ring")
        w, x, y, z = point.q
        if abs(w * w + x * x + y * y + z * z - 1.0) > NORM_TOLERANCE:  # no number: the guard's
            raise StarvedError(f"path record {index} is not an orientation")
        self._loaded = index
        self._point = point
        self._segment = None


def _differ(old: PathPoint, new: PathPoint) -> str:
    """Return by how much two points differ, or an empty string."""
    for name, gap, tolerance, unit in (
        ("orientation", norm(difference(old.q, new.q)), _SAME_Q, "rad"),
        ("angular velocity", *_gap(old.omega_body, new.omega_body), "rad/s"),
        ("angular acceleration", *_gap(old.alpha_body, new.alpha_body), "rad/s^2"),
        ("position", norm(plus(old.position, new.position, -1.0)), _SAME_POSITION, "m"),
        ("velocity", *_gap(old.velocity, new.velocity), "m/s"),
        ("angle of an axis", joint_gap(old.joints, new.joints), _SAME_JOINTS, "rad"),
        ("velocity of an axis", *_joint_rate_gap(old, new), "rad/s"),
    ):
        if not gap <= tolerance:
            return f"the {name} of the two paths differs by {gap:.3g} {unit}"
    return ""


def joint_gap(old: Joints, new: Joints) -> float:
    """Return the largest difference of an axis' angle, rad; infinity for different axes."""
    if len(old) != len(new):
        return inf
    return max([abs(a - b) for a, b in zip(old, new, strict=True)], default=0.0)


def _joint_rate_gap(old: PathPoint, new: PathPoint) -> tuple[float, float]:
    gap = joint_gap(old.joint_velocities, new.joint_velocities)
    return gap, _SAME_RATE * (1.0 + max(map(abs, old.joint_velocities), default=0.0))


def _gap(a: Vector3, b: Vector3) -> tuple[float, float]:
    return norm(plus(a, b, -1.0)), _SAME_RATE * (1.0 + norm(a))


MOST_RECORDS = 16
"""Records that are looked at in one cycle."""


class KeepOutAhead:
    """The records ahead that are known to be outside of every cone.

    The planner has certified the path.  But the clock may have been set since, and a cone has moved
    with it.  If the path then leads into a cone, the device stops on the path, outside.

    Args:
        cones: the cones.
        follower: position on the path.
        period: cycle period, s.
    """

    def __init__(self, cones: KeepOutCones, follower: PathFollower, period: float) -> None:
        self._cones, self._follower, self._period = cones, follower, period
        self._clear, self._revision, self._turned = 0, -1, 0.0

    def intrusion(self, records: int) -> str:
        """Return into which cone the next records lead; empty if into none.

        Call it once a cycle while the path is followed.

        Args:
            records: number of records that a stop from here may use.
        """
        cones, follower = self._cones, self._follower
        self._clear -= 1
        if follower.revision != self._revision or cones.turned - self._turned > SLACK:
            self._clear, self._revision, self._turned = 0, follower.revision, cones.turned
        # Until the device is there, the cones turn on.
        drift = records * self._period * cones.rate
        step = self._period * (follower.fastest + MOST_DRIFT)
        for _ in range(MOST_RECORDS):
            if self._clear > records:
                break
            self._clear = max(self._clear, 0)
            point = follower.record_ahead(self._clear)
            if point is None:
                break
            least = min(cones.clearances(point.q)) - drift
            if least < -SLACK:
                before = follower.record_ahead(max(self._clear - 1, 0)) or point
                problem = cones.intrusion(before.q, point.q, slack=SLACK - drift)
                if problem:
                    return problem
            # The records between are nearer by at most this way.
            self._clear += max(1, int(least / step))
        return ""
