"""The rollout of a quick stop: the rates of all its cycles, before the first of them is taken.

Every cycle is played through as the guard will see it.  Between two records the servo turns by the
law of :mod:`orientd.servo.path.segment`.  A difference of the guard's is the difference of its
angle at two places (what does not commute is of the third order in the period); its slope by the
rate is the velocity at the second.
"""

from __future__ import annotations

from copy import copy
from enum import Enum
from typing import NamedTuple

from orientd.driver import ZERO, Vector3
from orientd.floats import plus
from orientd.servo.guard import Guard
from orientd.servo.path.feasible_rates import Ahead, Past, nearest, released
from orientd.servo.path.path_follower import PathFollower
from orientd.servo.path.segment import Law, hermite, law_between
from orientd.servo.path.time_scaling import TimeScaling
from orientd.stream import ServoLimits


class Piece(NamedTuple):
    """The path between two records, in units of the period.

    Attributes:
        turn: how it turns, rad/s.
        way: by what in all.
        travel: how it travels, m/s; ``None`` where it does not.
        drift: by what in all.
    """

    turn: Law
    way: Vector3
    travel: Law | None
    drift: Vector3


_NO_LAW = Law(ZERO, ZERO, ZERO)
SHARE = 0.998
"""Part of the limits that a quick stop uses; the rest is for what its model leaves out."""

_REST = Ahead(ZERO, ZERO, ZERO, ZERO)
_STILL = 1e-9
_ATTEMPTS = 6
_NEAR = 2e-3  # records from a rate to the next guess; what is left of them is its square


class RolloutOutcome(Enum):
    """How far a rollout has come."""

    UNFINISHED = "unfinished"
    REST = "rest"
    END = "end"
    FAILED = "failed"


class StopRollout:
    """A stop from where the device is: the certified law first, then the least rate of each cycle.

    Attributes:
        rates: of the cycles rolled out so far.
        lead: how many of them the certified law takes.
        taken: how many of them the servo has carried out meanwhile.
        outcome: of the rollout so far.
        past: how the device moves after it.
    """

    def __init__(
        self,
        scaling: TimeScaling,
        follower: PathFollower,
        guard: Guard,
        *,
        lead: int,
        release: float,
    ) -> None:
        """Begin at the present cycle, before it has moved anything.

        Args:
            scaling: as it is.
            follower: where the path is.
            guard: what was written.
            lead: cycles of the certified law before the quick stop begins.
            release: part of the jerk with which the terminal deceleration begins.
        """
        self.rates: list[float] = []
        self.lead = lead
        self.taken = 0
        self.outcome = RolloutOutcome.UNFINISHED
        self._release = release * SHARE
        self._scaling = copy(scaling)
        self._follower = follower
        self._revision = follower.revision
        self._passed, self._here = 0, follower.index
        self._index, self._fraction = 0, follower.fraction
        self.past = Past(guard.omega, guard.alpha, guard.velocity, scaling.rate)
        self._rate, self._change = scaling.rate, scaling.acceleration * scaling.period
        self._pieces: dict[int, Piece] = {}

    def has_left(self, rate: float) -> bool:
        """Whether the certified law has come to another *rate* than it had in the rollout."""
        return self.taken > 0 and self.rates[self.taken - 1 : self.taken] != [rate]

    def go_on(self, servo_limits: ServoLimits, steps: int, *, may_end: bool) -> int:
        """Roll out at most *steps* cycles more and return how many.

        It is called in the cycle that the rollout begins in and in each one after that.

        Args:
            servo_limits: the limits.
            steps: cycles to roll out.
            may_end: whether the end of the path is as good as a stop before it.
        """
        follower = self._follower
        if follower.revision != self._revision:
            self.outcome = RolloutOutcome.FAILED
        if follower.index != self._here:
            self._passed, self._here = self._passed + 1, follower.index
        end = self._passed + follower.fraction + follower.records_left()
        for step in range(steps):
            if self.outcome is not RolloutOutcome.UNFINISHED:
                return step
            self._step(servo_limits, end, may_end=may_end)
        return steps

    def _step(self, servo_limits: ServoLimits, end: float, *, may_end: bool) -> None:
        is_free = len(self.rates) >= self.lead
        rate = min(max(self._rate + self._change, 0.0), 1.0)
        if not is_free:
            rate = self._scaling.advance()
        if self._index + self._fraction + rate >= end:
            self.rates.append(rate)
            self.outcome = RolloutOutcome.END if may_end else RolloutOutcome.FAILED
            return
        h = self._scaling.period
        start = self._load(self._index)
        if start is None:
            self.outcome = RolloutOutcome.FAILED
            return
        before = self._fraction
        came = start.turn.value(before)
        travelled = start.travel.value(before) if start.travel else ZERO
        for _ in range(_ATTEMPTS):
            u, there, gone, drift = before + rate, start, ZERO, ZERO
            if u >= 1.0:
                following = self._load(self._index + 1)
                if following is None:
                    self.outcome = RolloutOutcome.FAILED
                    return
                u, there, gone, drift = u - 1.0, following, start.way, start.drift
            omega = plus(plus(there.turn.value(u), gone, 1.0), came, -1.0)
            slope = there.turn.rate(u)
            velocity = push = ZERO
            if start.travel or there.travel:
                travel = there.travel or _NO_LAW
                velocity = plus(plus(travel.value(u), drift, 1.0), travelled, -1.0)
                push = travel.rate(u)
            if not is_free:
                break
            ahead = Ahead(slope, plus(omega, slope, -rate), push, plus(velocity, push, -rate))
            wanted = released(self.past, ahead, servo_limits, h, self._release)
            found = nearest(self.past, ahead, servo_limits, h, SHARE, wanted)
            if found is None:
                self.outcome = RolloutOutcome.FAILED
                return
            error, rate = abs(found - rate), found
            if error < _NEAR:
                omega = plus(ahead.bend, slope, rate)
                velocity = plus(ahead.shift, push, rate)
                break
        else:
            self.outcome = RolloutOutcome.FAILED
            return
        if rate <= _STILL and is_free:
            rate = 0.0
            is_there = self._follower.peek_ahead(self._index + 1 - self._passed) is not None
            self.outcome = RolloutOutcome.REST if is_there else RolloutOutcome.FAILED
        u, v, w = self.past.omega
        x, y, z = omega
        self.past = Past(omega, ((x - u) / h, (y - v) / h, (z - w) / h), velocity, rate)
        if (
            self.outcome is RolloutOutcome.REST
            and nearest(self.past, _REST, servo_limits, h, 1.0, 0.0) is None
        ):
            self.outcome = RolloutOutcome.FAILED  # at rest, but not without its acceleration
        self.rates.append(rate)
        self._change, self._rate = rate - self._rate, rate
        self._fraction += rate
        if self._fraction >= 1.0:
            self._pieces.pop(self._index, None)
            self._index, self._fraction = self._index + 1, self._fraction - 1.0

    def _load(self, index: int) -> Piece | None:
        """Return what lies between a record and the next, or ``None`` beyond the last."""
        pieces = self._pieces
        if index in pieces:
            return pieces[index]
        start = self._follower.peek_ahead(index - self._passed)
        end = self._follower.peek_ahead(index + 1 - self._passed)
        if start is None or end is None:
            return None
        h = self._scaling.period
        turn, travel, drift = law_between(start, end, h).scaled(1.0 / h), None, ZERO
        if start.position != end.position:
            x, y, z = plus(end.position, start.position, -1.0)
            drift = (x / h, y / h, z / h)
            travel = hermite(drift, start.velocity, end.velocity)
        piece = pieces[index] = Piece(turn, turn.value(1.0), travel, drift)
        return piece
