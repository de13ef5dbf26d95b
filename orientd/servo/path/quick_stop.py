r"""The quick stop: the time scaling comes to rest in hardly more time than the limits demand.

The certified law of :mod:`orientd.servo.path.time_scaling` has one brake rate for a whole motion,
set by its worst point.  In every cycle, a quick stop takes the least rate that keeps the limits at
the current place (:mod:`orientd.servo.path.feasible_rates`).  It ends with a terminal deceleration
in which velocity and acceleration reach zero together.

This law sees one cycle and could reach a place without a feasible rate.  So the servo first rolls
out the whole stop, cycle by cycle over the records in the ring.  It carries out only a stop that
comes to rest there.  Until then the certified law brakes, which always works, and the servo tries
again in each cycle.  Before a turn-back point of the path there may be no feasible stop.  The
device then brakes, passes it and stops after it.  A long stop takes several cycles to roll out, and
begins at the place that the certified law will have reached by then.

The rollout computes every cycle as the guard will see it.  The turn between two places of the path
is the difference of its rotation vectors *a* and *b* there, less half of their cross product.  The
next term is smaller by the turn of a cycle.  The derivative of the turn by the rate is the velocity
at the second place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from math import ceil

from orientd import kernels
from orientd.driver import ZERO, AxisLimits, Joints
from orientd.floats import combine, cross, dot, norm, plus
from orientd.servo.guard import Guard
from orientd.servo.path.feasible_rates import Ahead, Past, nearest, released
from orientd.servo.path.path_follower import PathFollower
from orientd.servo.path.segment import STANDING, Segment, joints_at
from orientd.servo.path.time_scaling import TimeScaling
from orientd.stream.records import ServoLimits

SHARE = 0.998
"""Share of the limits that a quick stop uses; the rest is for the errors of its model."""

RELEASES = (0.985, 0.9)
"""Shares of the jerk for the start of the terminal deceleration, tried in turn."""

STEPS_PER_SECOND = 16_000.0
"""Rolled-out cycles per second: few enough to leave most of a cycle free."""

FEWEST_STEPS = 8

_ALLOWANCE = 1.15  # factor of the expected cycles
_SPARE = 4.0  # additional cycles
_LONGER = 1.5  # factor after too few cycles
_REST = Ahead(ZERO, ZERO, ZERO, ZERO)
_STILL = 1e-9
_ATTEMPTS = 6
_NEAR = 2e-3  # records between two guesses of a rate; the error is its square


class QuickStop:
    """A stop of the time scaling that uses the full limits at each point of the path."""

    def __init__(self, scaling: TimeScaling, follower: PathFollower, guard: Guard) -> None:
        self._scaling = scaling
        self._follower = follower
        self._guard = guard
        self._axes: tuple[AxisLimits, ...] = ()
        self._steps = max(FEWEST_STEPS, round(STEPS_PER_SECOND * scaling.period))
        self._moves = -1
        self._tries = 0
        self._expected = 0.0
        # The rollout: its rates, first those of the certified law, and the follower's position
        # since.
        self._rollout: Iterator[bool] | None = None
        self._rates: list[float] = []
        self._lead = self._begun = self._revision = self._here = self._passed = 0

    def know(self, axes: Sequence[AxisLimits], *, share: float) -> None:
        """Use from here on at most a *share* of the acceleration of *axes*."""
        self._axes = tuple(
            axis._replace(acceleration=share * axis.acceleration, jerk=share * axis.jerk)
            for axis in axes
        )

    def seek(self, servo_limits: ServoLimits, *, may_end: bool) -> None:
        """Continue the search for a stop, as far as one cycle allows, and plan it once it is found.

        Call it before every cycle of a stop that is not planned yet.  *may_end* tells whether the
        end of the path is as good as a stop before it.
        """
        scaling, follower = self._scaling, self._follower
        self._servo_limits, self._may_end = servo_limits, may_end
        if scaling.moves != self._moves:
            # Something else has moved it since: this is another stop.
            self._tries, self._expected, self._rollout = 0, 0.0, None
        elif self._rollout and (
            self._rates[scaling.moves - self._begun - 1] != scaling.rate
            or self._revision != follower.revision
        ):
            # The path, or the time at which it may be left, differs from the rollout.
            self._rollout = None
        self._moves = scaling.moves + 1
        if follower.index != self._here:
            self._passed, self._here = self._passed + 1, follower.index
        self._left = follower.fraction + follower.records_left()
        is_over = self._roll_out()
        if self._rollout is None or scaling.moves < self._begun + self._lead:
            return
        self._rollout = None
        if is_over:
            scaling.plan = self._rates[self._lead :][::-1]
        else:
            self._expected = _LONGER * len(self._rates)

    def _roll_out(self) -> bool:
        """Continue the rollout, or start others; return whether one has finished."""
        left = self._steps
        while left > 0:
            rollout = self._rollout = self._rollout or self._begin()
            for is_over in rollout:
                left -= 1
                if is_over or left <= 0:
                    return is_over
            # The rollout failed.
            self._rollout = None
            self._tries += 1
            left -= 1
        return False

    def _begin(self) -> Iterator[bool]:
        """Start a rollout that ends when the certified law reaches its start."""
        guard, servo_limits = self._guard, self._servo_limits
        # The least number of cycles of a stop on a straight path.
        speed = norm(guard.omega)
        change = dot(guard.omega, guard.alpha) / speed if speed > 0.0 else 0.0
        time = max(
            kernels.stop_along(speed, change, servo_limits.acceleration, servo_limits.jerk)[0],
            norm(guard.velocity) / servo_limits.linear_acceleration,
            *(
                abs(rate) / axis.acceleration
                for axis, rate in zip(self._axes, guard.joint_rates, strict=False)
            ),
        )
        cycles = max(time / self._scaling.period, self._expected)
        self._lead = ceil((_ALLOWANCE * cycles + _SPARE) / (self._steps - 1)) - 1
        self._begun, self._revision = self._scaling.moves, self._follower.revision
        self._here, self._passed, self._rates = self._follower.index, 0, []
        return self._rolled_out(RELEASES[self._tries % len(RELEASES)] * SHARE)

    def _rolled_out(self, release: float) -> Iterator[bool]:
        """Roll out a stop from before the present cycle, cycle by cycle, as the guard will see it.

        The cycles of the certified law come first, then those of the least rate.

        Args:
            release: share of the jerk for the start of the terminal deceleration.

        Yields:
            Whether it has finished, at rest or at the end of the path; nothing more after a
            failure.
        """
        scaling, follower, guard = copy(self._scaling), self._follower, self._guard
        h, n, rates = scaling.period, 1.0 / scaling.period, self._rates
        # Joints count if their limits and last cycles are known.
        axes = self._axes if guard.joint_changes else ()
        past = Past(
            guard.omega, guard.alpha, guard.velocity, scaling.rate,
            guard.joint_rates if axes else (), guard.joint_changes if axes else (),
        )  # fmt: skip
        guess = scaling.rate + scaling.acceleration * h
        index, fraction, start, following = 0, follower.fraction, self._segment(0), self._segment(1)
        moved: Joints = ()
        turning: list[tuple[float, float]] = []
        is_over = False
        while start is not None:
            is_free = len(rates) >= self._lead
            rate = min(max(guess, 0.0), 1.0) if is_free else scaling.advance()
            if index + fraction + rate >= self._passed + self._left:
                rates.append(rate)
                is_over = self._may_end
                break
            turned, travelled = start.turn.value(fraction), start.travel.value(fraction)
            joints = joints_at(start.joints, fraction) if axes else ()
            for _ in range(_ATTEMPTS):
                u, there, came, drift = fraction + rate, start, turned, travelled
                if u >= 1.0:
                    if following is None:
                        return
                    u, there = u - 1.0, following
                    whole = start.turn.value(1.0)
                    came = plus(plus(turned, whole, -1.0), cross(whole, turned), -0.5)
                    drift = plus(travelled, start.travel.value(1.0), -1.0)
                goes, slope = there.turn.value(u), there.turn.rate(u)
                omega = plus(combine(goes, n, came, -n), cross(came, goes), -0.5 * n)
                velocity = push = ZERO
                if start.travel is not STANDING or there.travel is not STANDING:
                    velocity = combine(there.travel.value(u), n, drift, -n)
                    push = there.travel.rate(u)
                if axes:
                    if len(there.joints) != len(axes):
                        return
                    reached = zip(joints_at(there.joints, u), joints, strict=True)
                    moved = tuple([(a - b) * n for a, b in reached])
                if not is_free:
                    break
                slope, push = plus(ZERO, slope, n), plus(ZERO, push, n)
                if axes:
                    slopes = [n * one.rate(u) for one in there.joints]
                    turning = [(a - b * rate, b) for a, b in zip(moved, slopes, strict=True)]
                ahead = Ahead(
                    slope, plus(omega, slope, -rate), push, plus(velocity, push, -rate), turning
                )
                wanted = released(past, ahead, self._servo_limits, axes, h, release)
                found = nearest(past, ahead, self._servo_limits, axes, h, SHARE, wanted)
                if found is None:
                    return
                error, rate = abs(found - rate), found
                if error < _NEAR:
                    omega, velocity = plus(ahead.bend, slope, rate), plus(ahead.shift, push, rate)
                    moved = tuple([a + b * rate for a, b in turning])
                    break
            else:
                return
            is_over = is_free and rate <= _STILL
            rate = 0.0 if is_over else rate
            guess = 2.0 * rate - past.rate
            changes = tuple([(a - b) * n for a, b in zip(moved, past.joint_rates, strict=True)])
            alpha = combine(omega, n, past.omega, -n)
            past = Past(omega, alpha, velocity, rate, moved, changes)
            rates.append(rate)
            if is_over:
                rest = _REST._replace(joints=((0.0, 0.0),) * len(axes))
                if nearest(past, rest, self._servo_limits, axes, h, 1.0, 0.0) is None:
                    return  # at rest, but with an acceleration
                # One more cycle at rest: an immediate resumption would add its own jerk to that of
                # the last step.
                rates.append(0.0)
                break
            fraction += rate
            if fraction >= 1.0:
                index, fraction = index + 1, fraction - 1.0
                start, following = following, self._segment(index + 1)
            yield False
        while is_over:
            yield True

    def _segment(self, index: int) -> Segment | None:
        """Return the path from a record of the rollout to the next; ``None`` beyond the last."""
        ahead = index - self._passed
        start, end = self._follower.peek_ahead(ahead), self._follower.peek_ahead(ahead + 1)
        return None if start is None or end is None else Segment(start, end, self._scaling.period)
