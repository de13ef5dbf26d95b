"""Decide what the device follows: targets, chunks, or the last of them until it is there."""

from __future__ import annotations

from typing import Protocol

from orientd.driver import ZERO, Quaternion
from orientd.floats import difference, norm
from orientd.servo.tracking.chunk_report import ChunkStatistics
from orientd.servo.tracking.chunks import Chunk
from orientd.servo.tracking.forecast import JUMP
from orientd.servo.tracking.preview import Motion, Place, Preview, PreviewState
from orientd.servo.tracking.reference import Reference, ReferenceState, Target
from orientd.stream.records import ServoLimits

_MET = 0.02
"""Largest distance from its target at which the device has met it, rad."""

_ASTRAY = 1e-3
"""Angle to the poses beyond which the device is not on their curve, rad."""

_ARRIVED = 1e-8
"""Angle, rad, and velocity, rad/s, within which the device is at its end."""


class Follower(Protocol):
    """The motion that follows, as the guidance must know it."""

    def moving(self) -> tuple[Quaternion, float]:
        """Return the orientation of the last setpoint, and its angular speed, rad/s."""

    def must_brake(self, target: Target, left: float) -> bool:
        """Return whether a stop that begins later would pass the end *target*, *left* s before."""


class Guidance:
    """The target or pose to follow in every cycle.

    When targets end, the motion comes to rest at the last one.  It does not pass that target if it
    is known beforehand to be the last.  Without a live target the motion comes to rest as soon as
    it can, or at the last target if it has met that and that had no velocity.

    Attributes:
        reference: the targets.
        preview: the chunks.
        place: where the position should be, if the target says so.
        end: the target that is known to be the last, and the time until then, s.
        statistics: how chunks are followed.
    """

    def __init__(self, period: float) -> None:
        """Create it for one cycle per *period* seconds."""
        self.statistics = ChunkStatistics(period)
        self._period = period
        self._period_ns = round(period * 1e9)
        self.reference = Reference(period)

    def begin(self, servo_limits: ServoLimits) -> None:
        """Begin without targets; chunks are joined within *servo_limits*."""
        self.reference.clear()
        self.statistics.clear()
        self.preview = Preview(self._period, servo_limits, self.statistics)
        self._forget()

    @property
    def awaits(self) -> bool:
        """Whether there is a target whose time has not passed."""
        return self.reference.awaits

    def take(self, target: Target, now_ns: int) -> str:
        """Accept a target; return an empty string, or why it was refused."""
        problem = self.reference.take(target, now_ns)
        if not problem and self.preview.is_on:
            self._forget_chunks()
        return problem

    def take_chunk(self, chunk: Chunk, sent: Motion, sent_ns: int) -> str:
        """Take a chunk; return an empty string, or why it was refused.

        Args:
            chunk: its times ascend.
            sent: the last setpoint.
            sent_ns: the time of that.
        """
        is_fresh = self._is_concluded or self._is_astray
        problem = self.preview.take(chunk, sent, sent_ns, is_fresh=is_fresh)
        if not problem:
            self.reference.clear()
            self._forget()
        return problem

    def cease(self) -> None:
        """Forget every target."""
        self.reference.clear()
        self._forget_chunks()
        self._forget()

    def _forget_chunks(self) -> None:
        self.preview.clear()
        self.statistics.rest()

    def _forget(self) -> None:
        self.place: Place | None = None
        self.end: tuple[Target, float] | None = None
        self._last: Target | None = None
        self._home: Target | None = None
        self._has_met = self._is_concluded = self._is_astray = False

    def look(self, now_ns: int, follower: Follower) -> ReferenceState | PreviewState | None:
        """Return what to follow, at the last setpoint, on the way to the one due at *now_ns*.

        ``None`` is to come to rest anywhere.
        """
        if self.preview.is_on:
            return self._previewed(now_ns, follower)
        # State and target at the same time, that of the last setpoint.
        return self._found(now_ns - self._period_ns, follower)

    def _found(self, now_ns: int, follower: Follower) -> ReferenceState | None:
        reference = self.reference
        found = reference.at(now_ns)
        self.end = reference.end(now_ns)
        if found is None:
            return self._expired(follower)
        if self.end is not None and follower.must_brake(*self.end):
            reference.conclude()
            found = reference.at(now_ns) or found
        where = reference.position_at(now_ns)
        self.place = None if where is None else Place(*where, where[-1])
        last = reference.last
        if last is not None:
            self._note(last, found, follower.moving()[0])
        return found

    def _note(self, last: Target, found: ReferenceState, q: Quaternion) -> None:
        """Record whether the device, at *q*, has met its target, and where it must end."""
        if last is not self._last:
            self._last = last
            if self.reference.begins and norm(difference(q, last.q)) > JUMP:
                self._has_met = False
        if not self._has_met:
            self._has_met = norm(difference(q, found.q)) < _MET
        is_order = last.omega_body is None or last.omega_body == ZERO
        self._home = last if self._has_met and is_order else None

    def _expired(self, follower: Follower) -> ReferenceState | None:
        """Return the expired target while the device has not reached it."""
        home = self._home
        self.place = None
        if home is None:
            return None
        if home.position is not None:
            self.place = Place(home.position, ZERO)
        q, speed = follower.moving()
        if speed < _ARRIVED and norm(difference(q, home.q)) < _ARRIVED:
            return None
        return ReferenceState(home.q, ZERO, ZERO)

    def _previewed(self, now_ns: int, follower: Follower) -> ReferenceState | PreviewState:
        """Return what to follow of the chunks."""
        preview = self.preview
        found, self.place = preview.at(now_ns)
        end = preview.end
        left_ns = end.time_ns - now_ns + self._period_ns
        position = end.position if preview.has_positions else None
        last = Target(end.q, None, end.time_ns, end.time_ns, position)
        self.end = (last, left_ns * 1e-9) if left_ns > 0 else None
        if not self._is_concluded:
            self._is_concluded = left_ns <= 0 or (
                not preview.is_continued(now_ns) and follower.must_brake(last, left_ns * 1e-9)
            )
        gap = difference(follower.moving()[0], found.q)
        if self._is_concluded:
            # Until the last pose is due, a device that brakes for it is not behind.
            self.statistics.note_gap(ZERO if left_ns > 0 else gap, ZERO)
            return ReferenceState(end.q, ZERO, ZERO)
        self._is_astray = norm(gap) > _ASTRAY
        self.statistics.note_gap(gap, found.omega)
        return found
