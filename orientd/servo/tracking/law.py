"""The law of tracking for a tool's turn or its position (``kernels/c/law.h``, ``vector.h``).

The motion is a chain of backward differences, exactly as the guard computes them.  In each cycle
the acceleration changes as far as the jerk allows, the velocity by ``h`` times the acceleration,
and the tool moves by ``h`` times the velocity.  A limit holds for the norm of a vector and for each
of its components.  A straight path to the target stays straight.

The law closes in on a reference as fast as a stop relative to the reference allows, with the part
of the limits that the reference leaves free.  Close by, no limit is active, and it is linear.
"""

from __future__ import annotations

from array import array
from math import cbrt, inf, sqrt
from typing import NamedTuple

from orientd import kernels
from orientd.driver import ZERO, Vector3
from orientd.floats import norm, plus
from orientd.mechanism.mechanism import Rows
from orientd.stream.records import ServoLimits

PRECISION = 1e-3
"""Size of the final approach, rad or m, where the law is linear; larger for a slow device."""

QUICKEST = 0.27
"""Largest share of the remaining way that the final approach covers in one cycle."""

SOFT = 20.0
"""Largest closing speed per remaining way while the target moves, 1/s."""

EVENLY = 2.0
"""How much faster the acceleration settles than the velocity, while the target moves."""

RATIO = 2.0
"""How much faster velocities settle than ways.

With 2, a stop at the limits continues in the linear law without exceeding a limit.
"""

NEAR = 0.3
"""Remaining way up to which a close follower of a disturbed target corrects slowly, rad."""

FORGETTING = 0.02
"""Share of the target's largest acceleration that is forgotten in a second."""

LEAST_PART = 0.05
"""Share of the limit of the acceleration that a close follower may always use."""

NEED_MEMORY = 1.5
"""Time over which the need of a reference is averaged, s."""

LEAST_SPARE = 0.1
"""Share of a limit that corrections may always use."""

SLACK = 0.05
"""Way by which a stop may end beyond that of the target, rad or m."""

LEAST = 1e-9
"""Smallest value of a limit, to avoid division by zero."""

NO_LIMITS = ServoLimits(LEAST, LEAST, LEAST, LEAST, LEAST, 1.0)
"""Limits before the first motion."""

FULL = (1.0, 1.0, 1.0)
"""Shares of the limits that a reference at rest leaves free."""

_FREE = (inf, inf, inf)


class Gains(NamedTuple):
    """How hard the final approach is.

    Attributes:
        approach: closing speed per remaining way, 1/s.
        settle: acceleration per velocity error, 1/s.
        share: share of the wanted change of acceleration made in one cycle.
    """

    approach: float
    settle: float
    share: float

    def softened(self, period: float) -> Gains:
        """Return the gains for a moving, noisy target."""
        approach = min(self.approach, SOFT)
        share = min(self.share, EVENLY * RATIO * approach * period)
        return Gains(approach, RATIO * approach, share)


def gains_of(acceleration: float, jerk: float, period: float) -> Gains:
    """Return the gains for a target at rest: the final approach is *PRECISION* long."""
    # A jerk that reaches the full acceleration in less than two cycles saves no time.
    jerk = min(jerk, acceleration / (2.0 * period))
    approach = min(cbrt(jerk / PRECISION), sqrt(acceleration / PRECISION), QUICKEST / period)
    return Gains(approach, RATIO * approach, 0.8)


class Need:
    """The share of each limit that the reference itself takes.

    That is the mean of its present share and of its amplitude, which is that of a sine but not of
    noise: the square root of twice the mean square of the last time.

    Attributes:
        spare: shares of velocity, acceleration and jerk that it leaves free.
    """

    def __init__(self, period: float) -> None:
        self._gain = period / NEED_MEMORY
        self.forget()

    def forget(self) -> None:
        """Begin with a reference that needs nothing."""
        self._squares = [0.0, 0.0, 0.0]
        self._weight = 0.0
        self.spare = FULL

    def note(self, taken: array[float]) -> None:
        """Note the shares of velocity, acceleration and jerk that the reference takes now."""
        self._weight += self._gain * (1.0 - self._weight)
        spare = []
        for place, share in enumerate(taken):
            share = min(share, 1.0)
            self._squares[place] += self._gain * (share * share - self._squares[place])
            most = min(sqrt(2.0 * self._squares[place] / self._weight), 1.0)
            spare.append(max(1.0 - 0.5 * (min(share, most) + most), LEAST_SPARE))
        self.spare = (spare[0], spare[1], spare[2])


class Calm:
    """The acceleration that corrections may take while the device follows a target closely.

    Lost or late packets are surprises: the target turns out to be elsewhere than expected.  The
    total acceleration, including the target's own, stays below the target's recent maximum.  So a
    bad network causes no acceleration peak.  While the target accelerates at its maximum, the
    correction waits.

    The device follows closely once the correction of angle and velocity takes no more than the
    target's own acceleration.  It no longer does when it has to catch up with the full limits.

    Attributes:
        margin: acceleration for corrections; infinity while the device catches up.
        most: largest acceleration together with the target's own.
    """

    def __init__(self, period: float) -> None:
        self._kept = 1.0 - FORGETTING * period
        self.release()

    def release(self) -> None:
        """Start to catch up with another target."""
        self.most, self.margin = 0.0, inf

    def note(self, alpha: Vector3, needed: float, limit: float) -> None:
        """Note the acceleration of the target, and what its correction takes by itself.

        *needed* is infinity if nothing has to be restrained.  All in rad/s^2.
        """
        size = norm(alpha)
        self.most = max(size, self._kept * self.most, LEAST_PART * limit)
        is_close = needed < inf and (self.margin < inf or needed <= self.most)
        self.margin = self.most - size if is_close else inf


class Course(NamedTuple):
    """The motion of a reference at the last setpoint, by backward differences.

    Attributes:
        rate: velocity of the last step.
        change: acceleration of the last two steps.
        next_change: acceleration with the next step.
    """

    rate: Vector3
    change: Vector3
    next_change: Vector3


class Law:
    """One step a cycle of a vector within its limits.

    Attributes:
        period: of a cycle, s.
        acceleration: largest of any direction, rad/s^2 or m/s^2.
        rest: gains for a target at rest.
        need: of the reference so far.
        taken: shares of the limits that the reference takes now.
    """

    def __init__(self, period: float) -> None:
        self.period = period
        self.need = Need(period)
        self.taken = array("d", bytes(24))
        self._found = array("d", bytes(24))
        self.limit_turn(NO_LIMITS)

    def limit_turn(self, limits: ServoLimits) -> None:
        """Keep the limits of a turn from here on."""
        norms = limits.velocity, limits.acceleration, limits.jerk
        self._limit(norms, (limits.axis_velocity, limits.axis_acceleration, limits.axis_jerk))

    def limit_position(self, limits: ServoLimits) -> None:
        """Keep the limits of a position from here on.

        No limit of a device speaks of the jerk of its position: the acceleration is built up in the
        same time as that of the orientation.
        """
        acceleration = limits.linear_acceleration
        jerk = acceleration * limits.jerk / max(limits.acceleration, LEAST)
        self._limit((limits.linear_velocity, acceleration, jerk), (_FREE, _FREE, _FREE))

    def _limit(
        self, norms: tuple[float, float, float], axes: tuple[Vector3, Vector3, Vector3]
    ) -> None:
        least, h = LEAST, self.period
        velocity, acceleration, jerk = (max(most, least) for most in norms)
        parts = [[max(most, least) for most in each] for each in axes]
        # A jerk that reaches the full acceleration in less than two cycles saves no time, and a
        # stop in whole cycles would follow its prediction less exactly.
        jerk = min(jerk, acceleration / (2.0 * h))
        parts[2] = [min(j, a / (2.0 * h)) for a, j in zip(parts[1], parts[2], strict=True)]
        self._row = array("d", (velocity, acceleration, jerk, *parts[0], *parts[1], *parts[2]))
        self._has_axes = min(map(min, axes)) < inf
        self.acceleration = min(acceleration, max(parts[1]))
        self.rest = gains_of(self.acceleration, min(jerk, max(parts[2])), h)
        self.need.forget()

    def along(self, direction: Vector3) -> tuple[float, float, float]:
        """Return the limits of velocity, acceleration and jerk along a unit vector."""
        row = self._row
        a, b, c = (
            min([row[k], *(row[3 + 3 * k + i] / abs(x) for i, x in enumerate(direction) if x)])
            for k in range(3)
        )
        return a, b, c

    def share(self, kind: int, vector: Vector3) -> float:
        """Return the share of a limit that a vector takes; *kind* 0 is velocity, 2 is jerk."""
        row = self._row
        share = norm(vector) / row[kind]
        if self._has_axes:
            share = max(share, *(abs(x) / row[3 + 3 * kind + i] for i, x in enumerate(vector)))
        return share

    def stopping_way(self, rate: Vector3, change: Vector3) -> float:
        """Return the way of the quickest stop along a velocity, rad or m."""
        speed = norm(rate)
        if speed == 0.0:
            return 0.0
        unit = plus(ZERO, rate, 1.0 / speed)
        _, acceleration, jerk = self.along(unit)
        bend = unit[0] * change[0] + unit[1] * change[1] + unit[2] * change[2]
        return kernels.stop_along(speed, bend, acceleration, jerk)[1]

    def reach(self, rate: Vector3) -> float:
        """Return the largest way of a step from a velocity and of a stop after it, rad or m."""
        row, h = self._row, self.period
        speed = norm(rate) + h * row[1]
        least, jerk = min(row[1], *row[6:9]), min(row[2], *row[9:12])
        return kernels.stop_along(speed, row[1], least, jerk)[1] + h * speed

    def loosened(self, rate: Vector3, change: Vector3) -> float:
        """Return the limit of the velocity, raised to the least that a state can still keep."""
        size, step = norm(change), self._row[2] * self.period
        speed = norm(rate)
        if size > 0.0:
            cycles = int(size / step)
            run_out = cycles * (size - 0.5 * step * (cycles + 1))
            speed = max(speed, norm(plus(rate, change, self.period * run_out / size)))
        return max(self._row[0], speed)

    def pursue(
        self,
        state: tuple[Vector3, Vector3, Vector3],
        course: Course,
        gains: Gains,
        *,
        calm: Calm | None = None,
        slack: float = inf,
    ) -> Vector3:
        """Return the acceleration of the next step towards a reference.

        Args:
            state: way to the reference, velocity of the last step, and acceleration.
            course: motion of the reference.
            gains: of the final approach.
            calm: bound of corrections.
            slack: way by which a stop may end beyond that of the reference.
        """
        margin, most = (inf, inf) if calm is None else (calm.margin, calm.most)
        spare = self.need.spare
        is_linear = kernels.pursue_vector(
            self._row,
            self.period,
            array("d", (*state[0], *state[1], *state[2])),
            array("d", (*course[0], *course[1], *course[2])),
            array("d", (*gains, *spare, NEAR, margin, most, slack)),
            self.taken,
            self._found,
        )
        if calm is not None and not is_linear:
            calm.margin = inf
        x, y, z = self._found
        return x, y, z

    def halt(self, rate: Vector3, change: Vector3, aside: Vector3 = ZERO) -> Vector3:
        """Return the acceleration of one more cycle towards rest.

        *aside* is an acceleration that is added to the one to aim at.
        """
        state = array("d", (*ZERO, *rate, *change))
        kernels.halt_vector(self._row, self.period, state, array("d", aside), self._found)
        x, y, z = self._found
        return x, y, z

    def stop_clearance(self, rate: Vector3, change: Vector3, cones: Rows) -> float:
        """Return the least angle to the edges of cones in a step and the stop after it, rad.

        Args:
            rate: angular velocity of the step, rad/s.
            change: angular acceleration with it, rad/s^2.
            cones: see ``kernels/c/vector.h``.
        """
        state = array("d", (*ZERO, *rate, *change))
        return kernels.stop_clearance(self._row, self.period, state, cones.view)
