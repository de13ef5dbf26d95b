r"""The quick stop: the time scaling comes to rest in hardly more time than the limits demand.

The certified law of :mod:`orientd.servo.path.time_scaling` has one brake rate for a whole motion,
set by its worst point.  A quick stop takes in every cycle the least rate that keeps the limits at
the place where the device is (:mod:`orientd.servo.path.feasible_rates`), down to a terminal
deceleration in which velocity and acceleration reach zero together.

This law sees one cycle and could run into a place from which no rate keeps the limits.  So the
servo rolls the whole stop out first, cycle by cycle over the records that are in the ring, and
carries out only a stop that has come to rest there.  Until then the certified law brakes, which
always works, and from each of its cycles the servo tries again.  Before a place where the path
turns back no stop may be possible: then the device passes it, braking, and stops behind it.  A long
stop takes several cycles to roll out and begins where the certified law will be by then.

Every cycle is played through as the guard will see it.  A difference of the guard's is the
difference of the path's rotation vector at two places (what does not commute is of the third order
in the period); its slope by the rate is the velocity at the second.
"""

from __future__ import annotations

from copy import copy
from enum import Enum
from math import ceil

from orientd.driver import ZERO, Vector3
from orientd.floats import combine, norm, plus
from orientd.servo.guard import Guard
from orientd.servo.motion_law import stop_phases
from orientd.servo.path.feasible_rates import Ahead, Past, joint_stop_time, nearest, released
from orientd.servo.path.path_follower import PathFollower
from orientd.servo.path.segment import Segment
from orientd.servo.path.time_scaling import TimeScaling
from orientd.stream import ServoLimits

SHARE = 0.998
"""Part of the limits that a quick stop uses; the rest is for what its model leaves out."""

RELEASES = (0.985, 0.9)
"""Parts of the jerk with which the terminal deceleration begins, tried in turn."""

STEPS_PER_SECOND = 16_000.0
"""Cycles of a stop that are rolled out in one second: few enough to leave most of a cycle free."""

FEWEST_STEPS = 8

_ALLOWANCE = 1.15  # times the cycles expected
_SPARE = 4.0  # cycles more than that
_LONGER = 1.5  # times the cycles that were not enough
_REST = Ahead(ZERO, ZERO, ZERO, ZERO)
_STILL = 1e-9
_ATTEMPTS = 6
_NEAR = 2e-3  # records from a rate to the next guess; what is left of them is its square


class QuickStop:
    """A stop of the time scaling that uses what the limits leave at each point of the path.

    Args:
        scaling: takes the rates of the stop once they are found.
        follower: where the path is.
        guard: what was written.
    """

    def __init__(self, scaling: TimeScaling, follower: PathFollower, guard: Guard) -> None:
        self._scaling = scaling
        self._follower = follower
        self._guard = guard
        self._steps = max(FEWEST_STEPS, round(STEPS_PER_SECOND * scaling.period))
        self._moves = -1
        self._tries = 0
        self._expected = 0.0
        self._rollout: StopRollout | None = None

    def seek(self, servo_limits: ServoLimits, *, may_end: bool) -> None:
        """Go on looking for a stop, as far as one cycle allows, and plan it once it is found.

        To be called before every cycle of a stop that is not planned yet.

        Args:
            servo_limits: the limits.
            may_end: whether the end of the path is as good as a stop before it.
        """
        scaling, rollout, left = self._scaling, self._rollout, self._steps
        moves = scaling.moves
        if moves != self._moves:
            # Something else has moved it since: this is another stop.
            self._tries, self._expected, rollout = 0, 0.0, None
        self._moves = moves + 1
        if rollout and rollout.rates[moves - rollout.begun - 1] != scaling.rate:
            # The path has come to a motion whose certified law brakes harder.
            rollout = None
        while left > 0:
            rollout = rollout or self._begin(servo_limits)
            left -= rollout.go_on(servo_limits, left, may_end=may_end)
            if rollout.outcome is not RolloutOutcome.FAILED:
                break
            rollout = None
            self._tries += 1
            left -= 1
        if rollout and moves == rollout.begun + rollout.lead:
            if rollout.outcome is RolloutOutcome.UNFINISHED:
                self._expected = _LONGER * len(rollout.rates)
            else:
                scaling.plan = rollout.rates[rollout.lead :][::-1]
            rollout = None
        self._rollout = rollout

    def _begin(self, servo_limits: ServoLimits) -> StopRollout:
        """Begin a rollout that is over when the certified law is where it begins."""
        guard, rate = self._guard, self._scaling.rate
        # The cycles that a stop takes at least, were its path straight.
        speed = norm(guard.omega)
        change = _dot(guard.omega, guard.alpha) / speed if speed > 0.0 else 0.0
        time = max(
            sum(stop_phases(speed, change, servo_limits.acceleration, servo_limits.jerk)),
            norm(guard.velocity) / servo_limits.linear_acceleration,
            joint_stop_time(rate, servo_limits.joint_shares),
        )
        cycles = max(time / self._scaling.period, self._expected)
        return StopRollout(
            self._scaling,
            self._follower,
            guard,
            lead=ceil((_ALLOWANCE * cycles + _SPARE) / (self._steps - 1)) - 1,
            release=RELEASES[self._tries % len(RELEASES)],
        )


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
        begun: how often the time scaling had been moved when it began.
        outcome: of the rollout so far.
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
        self.begun = scaling.moves
        self.outcome = RolloutOutcome.UNFINISHED
        self._release = release * SHARE
        self._scaling = copy(scaling)
        self._follower = follower
        self._revision = follower.revision
        # Records are counted from the one where it began.
        self._passed, self._here = 0, follower.index
        self._index, self._fraction = 0, follower.fraction
        self._past = Past(guard.omega, guard.alpha, guard.velocity, scaling.rate)
        self._guess = scaling.rate + scaling.acceleration * scaling.period
        self._segments: dict[int, Segment] = {}

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
            self.outcome = self._step(servo_limits, end, may_end=may_end)
        return steps

    def _step(self, servo_limits: ServoLimits, end: float, *, may_end: bool) -> RolloutOutcome:
        is_free = len(self.rates) >= self.lead
        rate = min(max(self._guess, 0.0), 1.0) if is_free else self._scaling.advance()
        if self._index + self._fraction + rate >= end:
            self.rates.append(rate)
            return RolloutOutcome.END if may_end else RolloutOutcome.FAILED
        h, start, past = self._scaling.period, self._segment(self._index), self._past
        if start is None:
            return RolloutOutcome.FAILED
        n = 1.0 / h
        turned, travelled = start.turn.value(self._fraction), start.travel.value(self._fraction)
        for _ in range(_ATTEMPTS):
            u, there, came, drift = self._fraction + rate, start, turned, travelled
            if u >= 1.0:
                following = self._segment(self._index + 1)
                if following is None:
                    return RolloutOutcome.FAILED
                u, there = u - 1.0, following
                came = plus(turned, start.turn.value(1.0), -1.0)
                drift = plus(travelled, start.travel.value(1.0), -1.0)
            omega = combine(there.turn.value(u), n, came, -n)
            velocity = combine(there.travel.value(u), n, drift, -n)
            if not is_free:
                break
            slope, push = plus(ZERO, there.turn.rate(u), n), plus(ZERO, there.travel.rate(u), n)
            ahead = Ahead(slope, plus(omega, slope, -rate), push, plus(velocity, push, -rate))
            wanted = released(past, ahead, servo_limits, h, self._release)
            found = nearest(past, ahead, servo_limits, h, SHARE, wanted)
            if found is None:
                return RolloutOutcome.FAILED
            error, rate = abs(found - rate), found
            if error < _NEAR:
                omega, velocity = plus(ahead.bend, slope, rate), plus(ahead.shift, push, rate)
                break
        else:
            return RolloutOutcome.FAILED
        is_rest = is_free and rate <= _STILL
        rate = 0.0 if is_rest else rate
        self.rates.append(rate)
        self._past = Past(omega, combine(omega, n, past.omega, -n), velocity, rate)
        if is_rest:
            if nearest(self._past, _REST, servo_limits, h, 1.0, 0.0) is None:
                return RolloutOutcome.FAILED  # at rest, but not without its acceleration
            # One cycle more at rest: a resumption that began at once would add its own jerk to that
            # of the last step.
            self.rates.append(0.0)
            return RolloutOutcome.REST
        self._guess = 2.0 * rate - past.rate
        self._fraction += rate
        if self._fraction >= 1.0:
            self._segments.pop(self._index, None)
            self._index, self._fraction = self._index + 1, self._fraction - 1.0
        return RolloutOutcome.UNFINISHED

    def _segment(self, index: int) -> Segment | None:
        """Return the path between a record and the next, or ``None`` beyond the last."""
        segments, ahead = self._segments, index - self._passed
        if index not in segments:
            start = self._follower.peek_ahead(ahead)
            end = self._follower.peek_ahead(ahead + 1)
            if start is None or end is None:
                return None
            segments[index] = Segment(start, end, self._scaling.period)
        return segments[index]


def _dot(a: Vector3, b: Vector3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
