"""The poses from a setpoint to rest, for a driver to look at.

The servo sends a setpoint of targets that it follows only if the device's axes can follow a stop
from it.  If they cannot, the stop that was looked at a cycle before comes next, so there is always
a way to rest inside the limits of the axes.
"""

from __future__ import annotations

from math import ceil

from orientd.driver import ZERO, ComingPose, Quaternion, Vector3
from orientd.floats import exp, multiply, norm, plus
from orientd.servo.double_s import stop_phases

MOST = 12
"""At how many instants of a stop the axes are looked at, at most: in every cycle of a short one."""


class AxisStop:
    """A stop about one axis: its acceleration falls to a peak, stays there, and rises to zero.

    Attributes:
        seconds: how long it takes.
    """

    def __init__(
        self, axis: Vector3, speed: float, rate: float, acceleration: float, jerk: float
    ) -> None:
        """Begin at a *speed* about *axis* that changes at *rate*; rad/s and rad/s^2."""
        self._axis, self._speed, self._rate = axis, speed, rate
        phases = stop_phases(speed, rate, acceleration, jerk)
        self._phases = tuple(zip(phases, (-jerk, 0.0, jerk), strict=True))
        self.seconds = sum(phases)

    def turn(self, since: float) -> Vector3:
        """Return the rotation vector turned *since* the begin, s."""
        angle, speed, rate = 0.0, self._speed, self._rate
        for seconds, jerk in self._phases:
            t = min(since, seconds)
            angle += t * (speed + t * (0.5 * rate + t * jerk / 6.0))
            speed += t * (rate + 0.5 * t * jerk)
            rate += t * jerk
            since -= t
        return plus(ZERO, self._axis, angle)


def coming(
    q: Quaternion,
    position: Vector3,
    velocity: Vector3,
    stop: tuple[Quaternion, AxisStop | None],
    *,
    acceleration: float,
    period: float,
) -> list[ComingPose]:
    """Return a setpoint, the first cycle of a stop from it, and poses further on the way to rest.

    Args:
        q: orientation of the setpoint.
        position: its position, m.
        velocity: of the step to it, m/s.
        stop: orientation after the first cycle of the stop, and the rest of it, if any.
        acceleration: with which the position comes to rest, m/s^2.
        period: of a cycle, s.
    """
    poses = [ComingPose(period, q, position)]
    q, turning = stop
    speed = norm(velocity)
    if turning is None and speed == 0.0:
        return poses
    change = acceleration * period
    velocity = plus(ZERO, velocity, 1.0 - change / speed) if speed > change else ZERO
    position, speed = plus(position, velocity, period), max(speed - change, 0.0)
    poses.append(ComingPose(period, q, position))
    # The velocity of a step is that of its middle, and the next one is slower already.
    running = max(speed / acceleration - 0.5 * period, 0.0)
    share = running * acceleration / speed if speed > 0.0 else 0.0
    longest = max(running, turning.seconds if turning is not None else 0.0, period)
    count = min(ceil(longest / period), MOST)
    for k in range(1, count + 1):
        since = longest * k / count
        there = q if turning is None else multiply(q, exp(turning.turn(since)))
        left = 1.0 - since / running if since < running else 0.0
        along = 0.5 * running * share * (1.0 - left * left)
        poses.append(ComingPose(longest / count, there, plus(position, velocity, along)))
    return poses
