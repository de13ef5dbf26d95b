r"""The quick stop: the time scaling comes to rest in hardly more time than the limits demand.

The certified law of :mod:`orientd.servo.path.time_scaling` has one brake rate for a whole motion,
set by its worst point.  A quick stop takes in every cycle the least rate that keeps the limits at
the place where the device is (:mod:`orientd.servo.path.feasible_rates`), down to a terminal
deceleration in which velocity and acceleration reach zero together.

This law sees one cycle and could run into a place from which no rate keeps the limits.  So the
servo rolls the whole stop out first, cycle by cycle over the records that are in the ring
(:mod:`orientd.servo.path.stop_rollout`), and carries out only a stop that has come to rest there.
Until then the certified law brakes, which always works, and from each of its cycles the servo tries
again.  Before a place where the path turns back no stop may be possible: then the device passes it,
braking, and stops behind it.  A long stop takes several cycles to roll out and begins where the
certified law will be by then.
"""

from __future__ import annotations

from math import ceil

from orientd.floats import norm
from orientd.servo.double_s import stop_time
from orientd.servo.guard import Guard
from orientd.servo.path.feasible_rates import Past, joint_stop_time
from orientd.servo.path.path_follower import PathFollower
from orientd.servo.path.stop_rollout import RolloutOutcome, StopRollout
from orientd.servo.path.time_scaling import TimeScaling
from orientd.stream import ServoLimits

RELEASES = (0.985, 0.9)
"""Parts of the jerk with which the terminal deceleration begins, tried in turn."""

STEPS_PER_SECOND = 16_000.0
"""Cycles of a stop that are rolled out in one second: few enough to leave most of a cycle free."""

FEWEST_STEPS = 8

_ALLOWANCE = 1.15  # times the cycles expected
_SPARE = 4.0  # cycles more than that


class QuickStop:
    """A stop of the time scaling that uses what the limits leave at each point of the path.

    Args:
        scaling: the stop overrides it while it lasts.
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
        self._rates: list[float] = []

    def advance(self, servo_limits: ServoLimits, *, may_end: bool) -> float:
        """Advance the time scaling by one cycle of a stop and return the new rate.

        Args:
            servo_limits: the limits.
            may_end: whether the end of the path is as good as a stop before it.
        """
        scaling = self._scaling
        if scaling.moves != self._moves:
            # Something else has moved it since: this is another stop.
            self._tries, self._expected, self._rollout, self._rates = 0, 0.0, None, []
        if not self._rates:
            self._roll_out(servo_limits, may_end=may_end)
        if self._rates:
            rate = self._rates.pop()
            scaling.override(rate, is_last=rate == 0.0 and not self._rates)
        else:
            scaling.advance()
        self._moves = scaling.moves
        return scaling.rate

    def _roll_out(self, servo_limits: ServoLimits, *, may_end: bool) -> None:
        """Go on with the rollout, or begin others, as far as one cycle allows."""
        rollout, left = self._rollout, self._steps
        if rollout and rollout.has_left(self._scaling.rate):
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
        self._rollout = rollout
        if rollout is None:
            return
        if rollout.outcome is RolloutOutcome.UNFINISHED:
            cycles = self._remaining(rollout.past, servo_limits)
            if cycles >= self._steps * (rollout.lead - rollout.taken):
                # It will not be over in time: begin later.
                found = len(rollout.rates) - rollout.lead + cycles
                self._expected = max(found, _ALLOWANCE * self._expected)
                self._rollout = None
        elif rollout.taken == rollout.lead:
            self._rollout = None
            self._rates = rollout.rates[rollout.lead :][::-1]
            if rollout.outcome is RolloutOutcome.REST:
                # One cycle more at rest: a resumption that began at once would add its own jerk to
                # that of the last step.
                self._rates.insert(0, 0.0)
        rollout.taken += 1

    def _begin(self, servo_limits: ServoLimits) -> StopRollout:
        """Begin a rollout that is over when the certified law is where it begins."""
        guard = self._guard
        past = Past(guard.omega, guard.alpha, guard.velocity, self._scaling.rate)
        cycles = max(self._remaining(past, servo_limits), self._expected)
        return StopRollout(
            self._scaling,
            self._follower,
            guard,
            lead=ceil((_ALLOWANCE * cycles + _SPARE) / (self._steps - 1)) - 1,
            release=RELEASES[self._tries % len(RELEASES)],
        )

    def _remaining(self, past: Past, servo_limits: ServoLimits) -> float:
        """Return the cycles that a stop takes at least, were its path straight."""
        speed = norm(past.omega)
        (x, y, z), (u, v, w) = past.omega, past.alpha
        rate = (x * u + y * v + z * w) / speed if speed > 0.0 else 0.0
        time = max(
            stop_time(speed, rate, servo_limits.acceleration, servo_limits.jerk),
            norm(past.velocity) / servo_limits.linear_acceleration,
            joint_stop_time(past.rate, servo_limits.joint_shares),
        )
        return time / self._scaling.period
