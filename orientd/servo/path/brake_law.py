r"""The quick stop: how the time scaling comes to rest in hardly more time than the limits demand.

The certified law of :mod:`orientd.servo.path.time_scaling` has one brake rate for a whole motion,
set by its worst point.  Here every cycle of a stop takes the least rate that keeps the limits at
the point where the device is (:mod:`orientd.servo.path.feasible_rates`), down to a release in which
velocity and acceleration reach zero together.

Such a law looks at one cycle and could run into a place from which no rate keeps the limits.  So
the whole stop is rolled out first, cycle by cycle over the records that are in the ring
(:mod:`orientd.servo.path.stop_rollout`), one plan after the other.  What comes to rest there is
carried out as it was rolled out; until then, and wherever nothing does, the certified law brakes,
which always works.  A long stop is rolled out in several cycles, from where the certified law will
be by then.

Where the path slows down by itself, as it does before it turns back, no rate gives the device the
acceleration that a stop before the turn would need, and whoever brakes for one is too fast there
and too slow to go on.  Such a place is passed, as slowly as still leads beyond it
(:mod:`orientd.servo.path.turn_back`), and the stop is behind it.  Where the path does not turn
back, or not so that this succeeds, the device brakes a little, keeps that rate until the path is
faster again, and stops then.

The first plan that comes to rest is carried out.  Where that takes much longer than a stop in a
straight line would, others are rolled out from along it, and taken where they are over sooner.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil, sqrt

from orientd.floats import norm
from orientd.servo.guard import Guard
from orientd.servo.path.feasible_rates import Past, joint_stop_time
from orientd.servo.path.path_follower import PathFollower
from orientd.servo.path.stop_rollout import RolloutOutcome, StopPlan, StopRollout
from orientd.servo.path.time_scaling import TimeScaling
from orientd.stream import ServoLimits

PLANS = (
    StopPlan(0.998, 0.985),
    StopPlan(0.995, 0.985, until=0.3),
    StopPlan(0.998, 0.9),
    StopPlan(0.995, 0.985, until=1.0, stops_across=True),
    StopPlan(0.995, 0.985, rate=0.93),
)
"""Ways to stop, tried one after the other; chosen by ``tests/bench/tune_quick_stop.py``, which says
what each of these, and of those below that leave a stop, is worth."""

TURNING_PLANS = PLANS[1:2]
"""Ways to stop behind a place where the path turns back soon, tried before the others."""

BETTER_PLANS = (StopPlan(0.9, 0.9), StopPlan(0.995, 0.985, rate=0.87)) * 6
"""Ways to leave a stop that takes long for another one that is over sooner, tried in turn: what
fails from one place on the path may do from another."""

BRIEF_PLANS = tuple(StopPlan(1.0, 1.0, cycles=cycles) for cycles in (0, 1, 2))
"""Ways to stop within a few cycles, tried before the others where that may be enough."""

STEPS_PER_SECOND = 16_000.0
"""Cycles of a stop that are rolled out in one second: few enough to leave most of a cycle free."""

FEWEST_STEPS = 8

_ALLOWANCE = 1.15  # times the cycles expected
_SPARE = 4.0  # cycles more than that
_SLOWEST = 2.0  # times as long as a stop is how far off a slowest point is looked for
_BRIEF = 3.0  # cycles that a stop takes at least, where the brief plans are tried
_GOOD = 1.15  # times as long as a stop on a straight path is one that is not improved
_FARTHEST = 4.0  # times as far as where a stop failed is how far off a turn is looked for


class BrakeLaw:
    """A stop of the time scaling that uses what the limits leave at each point of the path.

    Args:
        scaling: is handed over while a quick stop lasts.
        follower: where the path is.
        guard: what was written.
    """

    def __init__(self, scaling: TimeScaling, follower: PathFollower, guard: Guard) -> None:
        self._scaling = scaling
        self._follower = follower
        self._guard = guard
        self._steps = max(FEWEST_STEPS, round(STEPS_PER_SECOND * scaling.period))
        self._is_coasting = False
        self._moves = -1
        self._taken = 0
        self._tries = 0
        self._plans: Sequence[StopPlan] = PLANS
        self._expected = 0.0
        self._trouble = self._turning = 0.0
        self._is_straight = False
        self._choices: list[StopPlan] = []
        self._rollout: StopRollout | None = None
        self._rates: list[float] = []

    def advance(self, servo_limits: ServoLimits, *, may_end: bool) -> float:
        """Advance the time scaling by one cycle of a stop and return the new rate.

        Args:
            servo_limits: the limits.
            may_end: whether the end of the path is as good as a stop before it.
        """
        scaling = self._scaling
        if scaling.moves != self._moves:
            self._renew(may_end=may_end)
        if self._rates:
            self._improve(servo_limits, may_end=may_end)
        else:
            self._rehearse(servo_limits, may_end=may_end)
        if self._rates:
            rate = self._rates.pop()
            scaling.lead(rate, is_last=rate == 0.0 and not self._rates)
        elif self._is_coasting:
            scaling.lead(scaling.rate)
        else:
            scaling.advance()
        self._trouble -= scaling.rate
        self._moves = scaling.moves
        return scaling.rate

    def _renew(self, *, may_end: bool) -> None:
        """Begin with another stop."""
        scaling = self._scaling
        self._tries, self._expected, self._trouble, self._turning = 0, 0.0, 0.0, 0.0
        self._rollout, self._rates, self._is_straight = None, [], False
        self._choices = []
        # A path that ends sooner than the certified stop is left as it is.
        rest = self._follower.records_left() * scaling.period / scaling.rate
        is_even = scaling.acceleration == 0.0
        self._is_coasting = may_end and is_even and rest <= 1.0 / scaling.brake_rate

    def _rehearse(self, servo_limits: ServoLimits, *, may_end: bool) -> None:
        """Go on with the rollout, or with others, as far as one cycle allows."""
        begun, taken = self._rollout, self._taken
        if begun is not None and taken and begun.rates[taken - 1 : taken] != [self._scaling.rate]:
            # The path has come to a motion whose certified law brakes harder.
            self._rollout = None
        left = self._steps
        while left > 0:
            rollout = self._rollout
            if rollout is None:
                rollout = self._rollout = self._begin(servo_limits)
                self._taken = 0
            left -= rollout.go_on(servo_limits, left, may_end=may_end)
            outcome = rollout.outcome
            if outcome is RolloutOutcome.FAILED:
                if not rollout.plan.passes:
                    trouble = rollout.gone - sum(rollout.rates[: self._taken])
                    self._trouble = max(self._trouble, trouble)
                self._is_straight = self._is_straight or rollout.is_without_turn
                self._rollout = None
                self._tries += 1
                while self._is_straight and self._plan.until is not None:
                    self._tries += 1
                left -= 1
            elif outcome is not RolloutOutcome.UNFINISHED:
                break
        rollout = self._rollout
        if rollout is None:
            return
        if rollout.outcome is RolloutOutcome.UNFINISHED:
            more = self._steps * (rollout.lead - self._taken)
            remaining = self._remaining(rollout.past, servo_limits)
            if remaining > more or self._taken >= rollout.lead:
                found = len(rollout.rates) - rollout.lead + remaining
                self._expected = max(found, _ALLOWANCE * self._expected)
                self._rollout = None
        if self._taken < rollout.lead:
            self._taken += 1
        elif rollout.outcome is not RolloutOutcome.UNFINISHED:
            self._adopt(rollout)
            self._rollout = None
            past = self._past()
            if len(self._rates) > _GOOD * self._remaining(past, servo_limits) + _SPARE:
                self._choices = list(BETTER_PLANS[::-1])

    def _adopt(self, rollout: StopRollout) -> None:
        """Carry out a stop that was rolled out up to the present cycle and beyond."""
        self._rates = rollout.rates[self._taken :][::-1]
        if rollout.outcome is RolloutOutcome.REST:
            # One cycle more at rest: a resumption that began at once would add its own jerk to
            # that of the last step.
            self._rates.insert(0, 0.0)

    def _improve(self, servo_limits: ServoLimits, *, may_end: bool) -> None:
        """Rehearse how to leave the stop that is carried out for a shorter one."""
        left = self._steps
        while left > 0:
            rollout = self._rollout
            if rollout is None:
                rollout = self._rollout = self._begin_better()
                self._taken = 0
                if rollout is None:
                    return
            left -= rollout.go_on(servo_limits, left, may_end=may_end)
            if rollout.outcome is RolloutOutcome.UNFINISHED and self._taken < rollout.lead:
                break
            if rollout.outcome in (RolloutOutcome.REST, RolloutOutcome.END):
                if len(rollout.rates) - self._taken + 1 < len(self._rates):
                    self._adopt(rollout)
            else:
                left -= 1
            self._rollout = None
        self._taken += 1

    def _begin_better(self) -> StopRollout | None:
        """Rehearse the next way to leave the stop that is carried out, if there is one in time."""
        lead = ceil(_ALLOWANCE * len(self._rates) / (self._steps - 1))
        if not self._choices or lead >= len(self._rates):
            self._choices.clear()
            return None
        plan = self._choices.pop()
        reach = len(self._rates) if plan.until is not None else max(self._trouble, 0.0)
        return StopRollout(
            self._scaling,
            self._follower,
            self._guard,
            lead=lead,
            plan=plan._replace(distance=float(reach)),
            along=self._rates[: -lead - 1 : -1],
        )

    def _past(self) -> Past:
        """Return what the device did last."""
        guard = self._guard
        return Past(guard.omega, guard.alpha, guard.velocity, self._scaling.rate)

    @property
    def _plan(self) -> StopPlan:
        return self._plans[self._tries % len(self._plans)]

    def _remaining(self, past: Past, servo_limits: ServoLimits) -> float:
        """Return the cycles that a stop takes at least, were its path straight."""
        speed, push = _along(past)
        time = max(
            _shortest(speed, push, servo_limits.acceleration, servo_limits.jerk),
            norm(past.velocity) / servo_limits.linear_acceleration,
            joint_stop_time(past.rate, servo_limits.joint_shares),
        )
        return time / self._scaling.period

    def _begin(self, servo_limits: ServoLimits) -> StopRollout:
        """Rehearse the next plan, from where the device is when that is over."""
        guard, period, past = self._guard, self._scaling.period, self._past()
        cycles = self._remaining(past, servo_limits)
        if self._tries == 0:
            self._plans = (*BRIEF_PLANS, *PLANS) if cycles <= _BRIEF else PLANS
            speed, push = _along(past)
            if cycles > _BRIEF and -speed > push * cycles * period:
                # It will have turned back before it could have stopped: there is no time to lose.
                self._plans = (*TURNING_PLANS, *PLANS)
                self._turning = -speed / push / period
        plan = self._plan
        if plan.passes:
            distance = self._trouble
            if plan.until is not None:
                distance = _FARTHEST * max(distance, self._turning) + FEWEST_STEPS
            plan = plan._replace(distance=distance)
            speed, push = _along(past)
            slowest = min(-speed / push, _SLOWEST * cycles * period) if push < 0.0 else 0.0
            # What is left of the acceleration there has to fall, and then the speed it leads to:
            # in a/j and 2 sqrt(v/j) with v = a^2/2j.
            cycles = max(cycles, (slowest + 2.4 * norm(guard.alpha) / servo_limits.jerk) / period)
        cycles = _ALLOWANCE * max(cycles, self._expected) + _SPARE
        return StopRollout(
            self._scaling,
            self._follower,
            guard,
            lead=ceil(cycles / (self._steps - 1)) - 1,
            plan=plan,
            is_coasting=self._is_coasting,
        )


def _along(past: Past) -> tuple[float, float]:
    """Return the speed and how fast it changes."""
    speed = norm(past.omega)
    (x, y, z), (u, v, w) = past.omega, past.alpha
    return speed, (x * u + y * v + z * w) / speed if speed > 0.0 else 0.0


def _shortest(speed: float, push: float, most: float, jerk: float) -> float:
    """Return how long it takes to rest from a speed and its first change, in a straight line."""
    peak = sqrt(jerk * speed + 0.5 * push * push)
    if peak <= most:
        return max(push + 2.0 * peak, 0.0) / jerk
    held = speed + (push * push - 2.0 * most * most) / (2.0 * jerk)
    return (push + 2.0 * most) / jerk + held / most
