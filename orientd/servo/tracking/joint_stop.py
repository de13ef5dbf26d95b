"""Keep the axes of a device where their stop ends outside of the keep-out cones.

A device that takes joints follows poses as well as its axes can.  Near a pole they fall behind, and
the tool takes another path than the poses.  So the stop of the axes themselves is foreseen too,
each with its own acceleration.
"""

from __future__ import annotations

from itertools import pairwise
from math import acos, ceil, cos, inf, sqrt

from orientd.driver import ZERO, Joints, Quaternion, Vector3
from orientd.floats import cross, dot, norm, plus, rotate
from orientd.mechanism.following import USABLE
from orientd.mechanism.mechanism import Mechanism
from orientd.servo.keep_out_cones import KeepOutCones
from orientd.servo.tracking.stop_rollout import Arc

_RESERVE = 4e-4
"""Angle outside of a cone that the stop keeps, rad: less than that of the poses."""

_STEP = 0.03
"""Turn between two instants at which the tool's axis is computed, rad; between them is an arc."""

_MOST = 30
"""Most of these instants."""


class JointStop:
    """The stop of the axes, and the cones.

    Args:
        mechanism: kinematics and limits of the axes.
        cones: keep-out cones of the device.
        period: cycle period, s.
    """

    def __init__(self, mechanism: Mechanism, cones: KeepOutCones, period: float) -> None:
        self._mechanism = mechanism
        self._cones = cones
        self._period = period

    def stays_outside(self, q: Quaternion, joints: Joints, last: Joints) -> bool:
        """Return whether a stop after the next setpoint ends outside of every cone.

        Inside of one, the tool must not come nearer to its centre.

        Args:
            q: orientation of the last setpoint.
            joints: axes of the next setpoint, rad.
            last: axes of the last setpoint, rad.
        """
        h = self._period
        rates = [(a - b) / h for a, b in zip(joints, last, strict=True)]
        times = [
            abs(rate) / (USABLE * axis.acceleration) if axis.acceleration < inf else 0.0
            for rate, axis in zip(rates, self._mechanism.axes, strict=True)
        ]
        # Every axis turns the tool by at most its own angle.
        reach = sum(abs(rate) * (0.5 * t + h) for rate, t in zip(rates, times, strict=True))
        found = self._cones.clearances(q)
        if min(found) > reach + _RESERVE:
            return True
        poses = [self._mechanism.forward(joints)[0]]
        longest = max(times)
        count = min(ceil(reach / _STEP), _MOST) if longest > 0.0 else 0
        for k in range(1, count + 1):
            since = longest * (1.0 - sqrt(1.0 - k / count))
            poses.append(self._mechanism.forward(_stopping(joints, rates, times, since, h))[0])
        for one, direction, clearance in zip(
            self._cones.cones, self._cones.directions, found, strict=True
        ):
            if clearance <= reach + _RESERVE:
                least = one.half_angle + min(_RESERVE, clearance)
                pointing = [rotate(q, one.axis), *(rotate(pose, one.axis) for pose in poses)]
                if _comes_nearer(pointing, direction, least):
                    return False
        return True


def _stopping(
    joints: Joints, rates: list[float], times: list[float], since: float, period: float
) -> Joints:
    """Return the axes *since* the beginning of a stop that takes *times*, s."""
    found = []
    for angle, rate, seconds in zip(joints, rates, times, strict=True):
        t = min(since, seconds)
        # A stop in whole cycles is shorter by half a step: the first cycle is slower already.
        share = t / seconds if seconds > 0.0 else 0.0
        way = rate * t * (1.0 - 0.5 * share) - 0.5 * period * rate * share
        found.append(angle + way)
    return tuple(found)


def _comes_nearer(pointing: list[Vector3], direction: Vector3, least: float) -> bool:
    """Return whether the arcs between unit vectors come nearer to a direction than *least*, rad."""
    for p, following in pairwise(pointing):
        u = cross(p, following)
        sine = norm(u)
        if sine < 1e-12:
            continue
        angle = acos(max(-1.0, min(1.0, dot(p, following))))
        arc = Arc(p, plus(ZERO, u, 1.0 / sine), direction)
        if arc.largest(angle) > cos(least) + 1e-12:
            return True
    return False
