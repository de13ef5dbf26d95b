r"""The rollout of a quick stop: the rates of all its cycles, before the first of them is taken.

Every cycle is played through as the guard will see it.  Between two records the servo turns by the
law of :mod:`orientd.servo.path.segment`.  A difference of the guard's is the difference of its
angle at two places (what does not commute is of the third order in the period); its slope by the
rate is the velocity at the second.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from enum import Enum
from math import inf
from typing import NamedTuple

from orientd.driver import ZERO, Vector3
from orientd.floats import norm, plus
from orientd.servo.guard import Guard
from orientd.servo.path.feasible_rates import (
    Ahead,
    Past,
    brought_to_rest,
    jerk_along,
    nearest,
    released,
)
from orientd.servo.path.path_follower import PathFollower
from orientd.servo.path.segment import Law, hermite, law_between
from orientd.servo.path.time_scaling import TimeScaling
from orientd.servo.path.turn_back import TurnBackPoint, dot
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
_REST = Ahead(ZERO, ZERO, ZERO, ZERO)
_STILL = 1e-9
_THERE = 0.05  # records: what is nearer to a turn is past it
_ATTEMPTS = 6
_NEAR = 2e-3  # records from a rate to the next guess; what is left of them is its square
_RECORDS_A_STEP = 4  # records that can be looked at while a cycle is rolled out


class RolloutOutcome(Enum):
    """How far a rollout has come."""

    UNFINISHED = "unfinished"
    REST = "rest"
    END = "end"
    FAILED = "failed"


class StopPlan(NamedTuple):
    """A way to stop.

    Attributes:
        share: part of the limits that is used.
        release: part of the jerk's share that the release is begun with.
        rate: to which the device brakes first, and which it keeps until the path has been through
            its slowest point; ``None`` to stop wherever that is possible.
        until: cycles before the next place where the path turns back, until which the device
            makes for it as slowly as possible, to stop behind it; ``None`` not to.
        stops_across: whether the stop begins with the cycle that leads past that place, or with
            the next.
        cycles: in which the device still moves, for a stop of hardly any; ``None`` for one of any
            length.
        distance: records before which the slowest point is not looked for, or behind which no
            place where the path turns back is.
    """

    share: float
    release: float
    rate: float | None = None
    until: float | None = None
    stops_across: bool = False
    cycles: int | None = None
    distance: float = 0.0

    @property
    def passes(self) -> bool:
        """Whether it passes a place before it stops."""
        return self.rate is not None or self.until is not None


class StopRollout:
    """A stop from where the device is, some cycles of the certified law first.

    Attributes:
        rates: of the cycles rolled out so far.
        lead: how many of them the certified law, a steady rate, or another stop takes.
        plan: how to stop.
        outcome: of the rollout so far.
        past: how the device moves after it.
        gone: records that it has come along.
    """

    def __init__(
        self,
        scaling: TimeScaling,
        follower: PathFollower,
        guard: Guard,
        *,
        lead: int,
        plan: StopPlan,
        is_coasting: bool = False,
        along: Sequence[float] = (),
    ) -> None:
        """Begin at the present cycle, before it has moved anything.

        Args:
            scaling: as it is.
            follower: where the path is.
            guard: what was written.
            lead: cycles before the plan begins.
            plan: how to stop.
            is_coasting: whether the rate is kept until then.
            along: rates of those cycles, where no certified law decides on them.
        """
        self.rates: list[float] = []
        self.lead = lead
        self.plan = plan
        self.outcome = RolloutOutcome.UNFINISHED
        self._scaling = copy(scaling)
        self._is_coasting = is_coasting
        self._along = along
        self._follower = follower
        self._revision = follower.revision
        self._passed, self._here = 0, follower.index
        self._index, self._fraction = 0, follower.fraction
        self.past = Past(guard.omega, guard.alpha, guard.velocity, scaling.rate)
        self._rate, self._change = scaling.rate, scaling.acceleration * scaling.period
        self._pieces: dict[int, Piece] = {}
        self.gone = 0.0
        self._is_past = not plan.passes
        self._path_speed = inf
        self._turn: TurnBackPoint | None = None

    def go_on(self, servo_limits: ServoLimits, steps: int, *, may_end: bool) -> int:
        """Rehearse at most so many cycles more and return how many.

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
            if self._is_looking:
                self._look()
            else:
                self._step(servo_limits, end, may_end=may_end)
        return steps

    @property
    def is_without_turn(self) -> bool:
        """Whether it was looked in vain for a place where the path turns back."""
        return self.outcome is RolloutOutcome.FAILED and self._turn is not None and self._is_looking

    @property
    def _is_looking(self) -> bool:
        """Whether the place where the path turns back is yet to be found."""
        if self.plan.until is None or len(self.rates) < self.lead:
            return False
        return self._turn is None or not self._turn.is_found

    def _look(self) -> None:
        """Look at some records more for the place where the path turns back."""
        turn = self._turn
        for _ in range(_RECORDS_A_STEP):
            place = self._index if turn is None else int(turn.place)
            piece = self._load(place) if place <= self.plan.distance else None
            if piece is None:
                self.outcome = RolloutOutcome.FAILED
                return
            if turn is None:
                speed = max(norm(self.past.omega), _STILL)
                x, y, z = self.past.omega
                self._turn = turn = TurnBackPoint((x / speed, y / speed, z / speed), place)
                turn.come(piece.turn.value(self._fraction))
            turn.look(piece.turn)
            if turn.is_found:
                self._is_past = self._index + self._fraction >= turn.place - _THERE
                return

    def _step(self, servo_limits: ServoLimits, end: float, *, may_end: bool) -> None:
        is_led = len(self.rates) >= self.lead
        rate = min(max(self._rate + self._change, 0.0), 1.0) if is_led else self._led()
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
            if not is_led:
                break
            ahead = Ahead(slope, plus(omega, slope, -rate), push, plus(velocity, push, -rate))
            wanted = self._wanted(ahead, servo_limits)
            found = nearest(self.past, ahead, servo_limits, h, self.plan.share, wanted)
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
        if rate <= _STILL and is_led:
            rate = 0.0
            is_there = self._follower.peek_ahead(self._index + 1 - self._passed) is not None
            self.outcome = RolloutOutcome.REST if is_there else RolloutOutcome.FAILED
        self.gone += rate
        if self._turn is not None:
            self._turn.come(omega)
            self._is_past = self._index + before + rate >= self._turn.place - _THERE
        elif is_led and not self._is_past:
            speed = norm(slope)
            is_far = self.gone >= self.plan.distance
            self._is_past, self._path_speed = is_far and speed > self._path_speed, speed
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

    def _led(self) -> float:
        """Return the rate of a cycle before the plan begins."""
        if self._along:
            return self._along[len(self.rates)]
        return self._rate if self._is_coasting else self._scaling.advance()

    def _wanted(self, ahead: Ahead, servo_limits: ServoLimits) -> float:
        """Return the rate that this cycle of the plan would have if every rate were allowed."""
        plan, turn, h = self.plan, self._turn, self._scaling.period
        if plan.cycles is not None:
            left = plan.cycles - (len(self.rates) - self.lead)
            return brought_to_rest(self.past, ahead, h, left)
        share = plan.release * plan.share
        path_speed = 0.0 if turn is None else dot(ahead.omega, turn.axis)
        if self._is_past or (plan.stops_across and path_speed <= 0.0):
            return released(self.past, ahead, servo_limits, h, share)
        if plan.rate is not None:
            return min(plan.rate, self._rate)
        if turn is None or plan.until is None or path_speed <= 0.0:
            return self._rate
        step = share * jerk_along(servo_limits, turn.axis) * h * h
        speed = turn.slowest(dot(self.past.omega, turn.axis), step, plan.until)
        if speed is None:
            return self._rate
        if speed == 0.0:
            return released(self.past, ahead, servo_limits, h, share)
        return min((speed - dot(ahead.bend, turn.axis)) / path_speed, self._rate)

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
