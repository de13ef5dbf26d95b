"""Follow targets: from the ring where they arrive to the setpoint of the cycle.

The position follows its target by the law of the orientation, with the linear limits.

An arm follows with its joints instead (:class:`.JointTracker`).
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from math import dist, inf

from orientd.driver import ZERO, Joints, Vector3
from orientd.floats import combine, norm, plus
from orientd.mechanism.mechanism import Mechanism
from orientd.servo.guard import Guard
from orientd.servo.keep_out_cones import KeepOutCones
from orientd.servo.tracking.chunks import Chunk, read_chunk
from orientd.servo.tracking.joint_tracker import JointTracker
from orientd.servo.tracking.law import NO_LIMITS, SLACK, Course, Law
from orientd.servo.tracking.preview import Motion, Place
from orientd.servo.tracking.reference import Target
from orientd.servo.tracking.tracker import Tracker, TrackPoint
from orientd.stream.records import (
    DEVIATION_WORD,
    HELD_WORD,
    LARGEST_DEVIATION_WORD,
    LEFT_OUT_WORD,
    ServoLimits,
)
from orientd.stream.ring import RecordRing

TARGETS_PER_CYCLE = 8
"""Targets accepted in one cycle; the others wait."""

TARGETS_READ = 20_000
"""Targets read in a second.  If they come faster than one a cycle, the servo skips those that a
newer one replaces within a period: otherwise the device would follow targets ever older."""

_MOST_COUNTED = 2**63
"""Largest count, which fits the word for it even if the ring is damaged."""

AHEAD_NS = 500_000_000
"""How long before its first pose a chunk is taken; until then the poses before it count."""

MOST_WAITING = 16
"""Chunks that wait for their time; one more replaces the last of them."""


class TargetFollower:
    """Follow targets and chunks as they arrive.

    Attributes:
        is_on: whether targets are followed, or their following is coming to rest.
        hindrance: why the device's axes cannot come closer to the targets; empty if they can.
        tracker: follows the current target with the tool.
        joint_tracker: follows it with the axes; ``None`` if the device has none that it can know.
        limits: limits in force.
    """

    def __init__(
        self,
        ring: RecordRing,
        chunks: RecordRing,
        guard: Guard,
        cones: KeepOutCones | None = None,
    ) -> None:
        """Create it following nothing yet.

        Args:
            ring: the targets.
            chunks: the chunks.
            guard: the last written setpoints.
            cones: keep-out cones of the device.
        """
        self.is_on = self._is_of_joints = False
        self.tracker = Tracker(guard.period, cones)
        self._ring, self._chunks = ring, chunks
        self._guard, self._cones = guard, cones
        self.joint_tracker: JointTracker | None = None
        self.limits = NO_LIMITS
        self._next, self._next_chunk = ring.head, chunks.head
        self._waiting: list[Chunk] = []
        self._left_out = 0
        self._taken_ns = 0
        self._period_ns = round(guard.period * 1e9)
        self._most_read = max(TARGETS_PER_CYCLE, round(TARGETS_READ * guard.period))
        self._landing: Target | None = None
        self._linear = Law(guard.period)

    @property
    def hindrance(self) -> str:
        """Why the device's axes cannot come closer to the targets; empty if they can."""
        joints = self._by_joints
        return "" if joints is None or not self.is_on else joints.hindrance

    @property
    def is_at_rest(self) -> bool:
        """Whether nothing turns, no target lives and none waits for its time."""
        return (self._by_joints or self.tracker).is_at_rest

    @property
    def _by_joints(self) -> JointTracker | None:
        return self.joint_tracker if self._is_of_joints else None

    def make_joint_tracker(
        self, mechanism: Mechanism, chain: array[float], *, takes_joints: bool
    ) -> None:
        """Follow targets with the axes of *mechanism* from now on, see :class:`.JointTracker`."""
        self.joint_tracker = JointTracker(
            mechanism,
            chain,
            self._guard,
            self.tracker.guidance,
            self._cones,
            takes_joints=takes_joints,
        )

    def begin(self, servo_limits: ServoLimits, joints: Joints = ()) -> None:
        """Begin from the last written setpoint; earlier targets do not count.

        *joints* are close to the axes, rad.  A stop off the path needs none: the tool stops by
        itself.

        Raises:
            NotYetError: the axes have no stop from here that keeps every limit.
        """
        guard = self._guard
        is_of_joints = False
        if self.joint_tracker is not None and joints:
            continues = self.is_on and self._is_of_joints
            self.joint_tracker.begin(servo_limits, self.limits, joints, continues=continues)
            is_of_joints = True
        self._is_of_joints = is_of_joints
        self.limits = servo_limits
        self._ring.words[DEVIATION_WORD] = self._ring.words[LARGEST_DEVIATION_WORD] = 0
        self.tracker.begin(guard.q, guard.omega, guard.alpha, servo_limits)
        self._linear.limit_position(servo_limits)
        self._next, self._next_chunk = self._ring.head, self._chunks.head
        self._waiting.clear()
        self.tracker.guidance.statistics.write(self._chunks)
        self.is_on = True

    def stop_joints(self, servo_limits: ServoLimits) -> None:
        """Have the axes come to rest together, if they have a stop from the last setpoint."""
        joints, tracker = self._guard.joints, self.joint_tracker
        if tracker is not None and joints:
            self._is_of_joints = tracker.begin_to_stop(servo_limits, joints)

    def cease(self) -> None:
        """Forget every target, and come to rest."""
        self.tracker.cease()
        self._waiting.clear()
        if self.joint_tracker is not None:
            self.joint_tracker.hindrance = ""

    def rest(self) -> None:
        """Continue from rest at the last written setpoint."""
        guard = self._guard
        self.tracker.rest(guard.q)
        if self._by_joints is not None:
            self._by_joints.rest()

    def end(self) -> None:
        """Stop following."""
        self.is_on = False
        self._ring.words[HELD_WORD] = 0

    def step(
        self, now_ns: int, servo_limits: ServoLimits, *, is_stopping: bool
    ) -> tuple[TrackPoint, Vector3, Joints]:
        """Return the setpoint of the cycle with deadline *now_ns*, its position, m, and its joints.

        With *is_stopping* it comes to rest, whatever targets arrive.  Without an arm the setpoint
        has no joints.
        """
        guard, by_joints = self._guard, self._by_joints
        if not is_stopping:
            self._take_targets(now_ns)
            self._take_chunks(now_ns)
        joints: Joints = ()
        if by_joints is None:
            point, held = self.tracker.step(now_ns), self.tracker.held
            position = self._position() or guard.braked_position(servo_limits)
        else:
            q, position, joints = by_joints.step(now_ns, is_stopping=is_stopping)
            omega, _ = guard.rates(q, position)
            alpha = combine(omega, 1.0 / guard.period, guard.omega, -1.0 / guard.period)
            point, held = TrackPoint(q, omega, alpha), by_joints.held
            self.limits, line = by_joints.limits, by_joints.line
            self._ring.words[DEVIATION_WORD] = round(1e9 * line.deviation)
            self._ring.words[LARGEST_DEVIATION_WORD] = round(1e9 * line.largest)
        if self._ring.words[HELD_WORD] != held + 1:
            self._ring.words[HELD_WORD] = held + 1
        self._note_position_gap()
        self.tracker.guidance.statistics.write(self._chunks)
        return point, position, joints

    def _position(self) -> Vector3 | None:
        """Return the next position, m; ``None`` if it must come to rest anywhere."""
        guidance = self.tracker.guidance
        place = guidance.place
        if place is None:
            return None
        guard, law, h = self._guard, self._linear, self._guard.period
        if guidance.end is not None and guidance.end[0].position is not None:
            target, left = guidance.end
            speed = norm(guard.velocity)
            if speed > 0.0 and target != self._landing and target.position is not None:
                stop = law.stopping_way(guard.velocity, guard.acceleration) + 2.0 * h * speed
                if dist(guard.position, target.position) <= stop >= 0.5 * left * speed:
                    self._landing = target
            if self._landing == target and target.position is not None:
                place = Place(target.position, ZERO)
        course = Course(place.velocity, place.acceleration, place.next_acceleration)
        is_moving = place.velocity != ZERO or place.next_acceleration != ZERO
        gains, slack = (law.rest.softened(h), SLACK) if is_moving else (law.rest, inf)
        way = plus(place.position, guard.position, -1.0)
        state = way, guard.velocity, guard.acceleration
        acceleration = law.pursue(state, course, gains, slack=slack)
        if is_moving:
            law.need.note(law.taken)
        else:
            law.need.forget()
        velocity = plus(guard.velocity, acceleration, h)
        return plus(guard.position, velocity, h)

    def _note_position_gap(self) -> None:
        """Note how far the last setpoint is behind the position of the chunks."""
        guidance = self.tracker.guidance
        place = guidance.place
        if not guidance.preview.is_on:
            return
        if place is None:
            guidance.statistics.note_position_gap(ZERO, ZERO)
        else:
            gap = plus(place.position, self._guard.position, -1.0)
            guidance.statistics.note_position_gap(gap, place.velocity)

    def _take_targets(self, now_ns: int) -> None:
        """Take the targets that have arrived."""
        ring = self._ring
        head = ring.head
        if self._next == head:
            return
        first = end = ring.oldest(self._next)
        arrived = []
        for index in range(first, min(head, first + self._most_read)):
            fields = ring.read(index)
            if fields is None and head - index < ring.capacity:
                break  # still being written
            end = index + 1
            if fields is not None:
                _, time_ns, expires_ns, w, x, y, z, *more = fields
                omega, position = _given(more[:3]), _given(more[3:])
                arrived.append((index, Target((w, x, y, z), omega, time_ns, expires_ns, position)))
        kept = self._apart(arrived)
        if len(kept) > TARGETS_PER_CYCLE:
            end = kept[TARGETS_PER_CYCLE][0]
        left_out = end - self._next
        for _, target in kept[:TARGETS_PER_CYCLE]:
            self._taken_ns = target.time_ns
            left_out -= not self.tracker.take(target, now_ns)
        self._next = end
        if left_out:
            self._left_out = min(self._left_out + left_out, _MOST_COUNTED)
            ring.words[LEFT_OUT_WORD] = self._left_out

    def _apart(self, arrived: Sequence[tuple[int, Target]]) -> list[tuple[int, Target]]:
        """Return the newest of the targets that arrived, and those a period before one another."""
        kept: list[tuple[int, Target]] = []
        period_ns = self._period_ns
        for index, target in reversed(arrived):
            time_ns = target.time_ns
            if kept and (
                0 <= kept[-1][1].time_ns - time_ns < period_ns
                or 0 <= time_ns - self._taken_ns < period_ns
            ):
                continue
            kept.append((index, target))
        kept.reverse()
        return kept

    def _take_chunks(self, now_ns: int) -> None:
        """Take one arrived chunk a cycle; those whose poses are far ahead wait for their time."""
        ring = self._chunks
        if self._next_chunk < ring.head:
            self._next_chunk = ring.oldest(self._next_chunk)
            fields = ring.read(self._next_chunk)
            if fields is None:
                return  # still being written, or just overwritten
            self._next_chunk += 1
            chunk = read_chunk(fields)
            if chunk is not None:
                self._line_up(chunk, now_ns)
        self._take_chunk(now_ns)

    def _line_up(self, chunk: Chunk, now_ns: int) -> None:
        """Have a chunk wait, in place of those that begin no sooner, unless all of it is late."""
        waiting, first_ns = self._waiting, chunk.knots[0].time_ns
        guidance, sent_ns = self.tracker.guidance, now_ns - self._period_ns
        end_ns = guidance.preview.end.time_ns if guidance.preview.is_on else None
        if waiting:
            end_ns = waiting[-1].knots[-1].time_ns
        guidance.statistics.note_chunk(chunk.knots, chunk.observed_ns, end_ns, sent_ns)
        if chunk.knots[-1].time_ns <= sent_ns:
            return
        waiting[:] = [one for one in waiting if one.knots[0].time_ns < first_ns]
        waiting[MOST_WAITING - 1 :] = [chunk]

    def _take_chunk(self, now_ns: int) -> None:
        waiting, guard = self._waiting, self._guard
        if not waiting or waiting[0].knots[0].time_ns > now_ns + AHEAD_NS:
            return
        chunk = waiting.pop(0)
        at = guard.position, guard.velocity, guard.acceleration
        sent = Motion(guard.q, guard.omega, guard.alpha, *at)
        self.tracker.take_chunk(chunk, sent, now_ns - self._period_ns)


def _given(vector: Sequence[float]) -> Vector3 | None:
    """Return a vector of a record; ``None`` for :data:`.NOT_GIVEN`."""
    x, y, z = vector
    return None if x != x and y != y and z != z else (x, y, z)
