"""Motions of all axes together from rest to rest: home, and where the turn of the tool fails.

The limits of the angles are a box, so the straight line between two sets of axis angles never
leaves them, and a pole on it is an angle like any other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from orientd.driver import Quaternion, Vector3
from orientd.errors import LimitError, PlanError
from orientd.rotation import Floats, conjugate, log, multiply
from orientd_dynamixel.certificate import (
    AxisCertificate,
    AxisLimits,
    AxisPath,
    AxisPeak,
    ToolLimits,
    measured,
)
from orientd_dynamixel.kinematics import Gimbal
from orientd_dynamixel.options import GimbalOptions
from orientd_dynamixel.path import PLANNED, as_driven, refuse_angle
from orientd_dynamixel.planning import gimbal_of, limits_of
from orientd_dynamixel.stops import TILT, ramp_times
from orientd_dynamixel.tracker import AxisTracker

_TURN = 2 * math.pi
_EDGE = 1e-9
"""How far outside its limits an axis is taken to be at them, rad."""
_RESERVE = 0.97
"""Share of the tool's limits that is used; the rest is for stops on the way."""
_FASTEST, _HARDEST = 1.875, 5.7735
"""Largest slope and curvature of the quintic by which the speed rises from 0 to 1."""
_ATTEMPTS = 40
_POINTS, _STEP = 129, 0.05
"""At which the turn of the tool is looked at, and one more for each step of an axis, rad."""


def home(options: GimbalOptions) -> tuple[float, ...]:
    """Return the axis angles that are home: zero, or as near to it as the limits permit, rad."""
    return tuple(min(max(0.0, axis.low), axis.high) for axis in options.axes)


def windings(
    options: GimbalOptions, tracker: AxisTracker, q: Quaternion
) -> list[tuple[float, ...]]:
    """Return the axis angles inside the limits that make *q*, nearest ones of each branch, rad.

    At the pole three axes make *q* with any outer angle: the inner one stays where it is, or turns
    as far as the limits of the outer one demand.

    Raises:
        LimitError: there are none; it names the axis.
    """
    if len(options.axes) == 2 and not options.pointing:
        branches = [tracker.solve(q)[0]]
    else:
        branches = tracker.branches(q)
    found = []
    for branch in branches:
        nearest = _inside(options, tracker.angles, branch)
        if nearest is None and len(branch) == 3 and tracker.is_at_pole(q):
            nearest = _shared(options, tracker, q, branch)
        if nearest is not None:
            found.append(nearest)
    if not found:
        refuse_angle(np.array(branches), limits_of(options), 0.0)
    return found


def _inside(
    options: GimbalOptions, last: Sequence[float], branch: Sequence[float]
) -> tuple[float, ...] | None:
    """Return *branch* on the turns inside the limits that are nearest to *last*, if any are."""
    nearest = []
    for angle, near, axis in zip(branch, last, options.axes, strict=True):
        least = math.ceil((axis.low - _EDGE - angle) / _TURN)
        most = math.floor((axis.high + _EDGE - angle) / _TURN)
        if least > most:
            return None
        count = min(max(round((near - angle) / _TURN), least), most)
        nearest.append(min(max(angle + _TURN * count, axis.low), axis.high))
    return tuple(nearest)


def _shared(
    options: GimbalOptions, tracker: AxisTracker, q: Quaternion, branch: Sequence[float]
) -> tuple[float, ...] | None:
    """Return axis angles at the pole that share the turn between outer and inner axis."""
    outer, middle, inner = branch
    first = options.axes[0]
    # Along a line through both angles nothing changes: one step on it shows its slope.
    slope = tracker.outer_at_pole(q, inner + 0.5) - outer
    slope = math.copysign(1.0, math.remainder(slope, _TURN))
    found = []
    for turns in range(-1, 2):
        near = outer + _TURN * (turns + round((tracker.angles[0] - outer) / _TURN))
        for wanted in (first.low, first.high, min(max(near, first.low), first.high)):
            shared = (wanted, middle, inner + slope * (wanted - near))
            angles = _inside(options, tracker.angles, shared)
            if angles is not None:
                found.append(angles)
    return min(found, key=lambda one: _travel(tracker.angles, one), default=None)


def _travel(begin: Sequence[float], end: Sequence[float]) -> float:
    return sum(abs(a - b) for a, b in zip(begin, end, strict=True))


def way(
    options: GimbalOptions,
    joints: tuple[float, ...],
    q: Quaternion,
    *,
    period: float,
    rates: Vector3,
    least: float,
    is_homing: bool,
) -> AxisPath | None:
    """Return the way from *joints* to *q*, or home; see :meth:`.Driver.way`.

    Raises:
        LimitError: no axis angles inside the limits make *q*.
        PlanError: nothing keeps the limits of the tool.
    """
    tracker = AxisTracker(options.order, options.mount, options.tool, is_pointing=options.pointing)
    tracker.angles = joints
    if not is_homing and tracker.solve(q)[1] > options.roll_tolerance:
        return None
    ends = [home(options)] if is_homing else windings(options, tracker, q)
    end = min(ends, key=lambda one: _travel(joints, one))
    return turned(
        gimbal_of(options), joints, end, period, limits_of(options), ToolLimits(*rates), least=least
    )


def turned(
    gimbal: Gimbal,
    begin: Sequence[float],
    end: Sequence[float],
    period: float,
    limits: Sequence[AxisLimits],
    tool: ToolLimits,
    *,
    least: float = 0.0,
) -> AxisPath:
    """Return the motion of all axes together from *begin* to *end*, as quick as the limits allow.

    Args:
        gimbal: whose.
        begin: axis angles, rad.
        end: those to go to.
        period: s.
        limits: of every axis.
        tool: what it keeps to.
        least: how long it lasts at least, s.

    Raises:
        PlanError: nothing is slow enough.
    """
    here, there = np.asarray(begin, dtype=np.float64), np.asarray(end, dtype=np.float64)
    tilt = _tilt(gimbal, here, there, limits)

    def at(share: Floats) -> Floats:
        bump = 4.0 * share * (1.0 - share)
        angles: Floats = here + share[:, None] * (there - here) + bump[:, None] * tilt
        return angles

    points = _POINTS + round(float(np.max(np.abs(there - here))) / _STEP)
    speed, ramp = _quickest(gimbal, at(np.linspace(0.0, 1.0, points)), limits, tool)
    seconds = max(1.0 / speed + ramp, least, 2.0 * period)
    for _ in range(_ATTEMPTS):
        count = math.ceil(seconds / period - 1e-9)
        stretch = count * period / (1.0 / speed + ramp)
        angles = at(_progress(count, period, speed / stretch, ramp * stretch))
        angles[0], angles[-1] = here, there
        path = _certified(gimbal, angles, period, limits)
        more = max(
            tool.excess(path.q, period) / _RESERVE,
            *(one.value / one.limit for one in path.certificate.velocity),
            *(
                math.sqrt(one.value / (PLANNED * one.limit))
                for one in path.certificate.acceleration
            ),
        )
        seconds = count * period * max(more, 1.01)
        if more > 1.0:
            continue
        try:
            return as_driven(gimbal, path, here, period, limits, angles[[0, 0]])
        except LimitError:
            # A sample is just at the pole.
            seconds = (count + 1) * period
    raise PlanError("no way of the axes keeps the limits of the tool")


def _tilt(gimbal: Gimbal, here: Floats, there: Floats, limits: Sequence[AxisLimits]) -> Floats:
    """Return what the middle axis turns besides, so that the orientations show how the others turn.

    Close to the pole an orientation of three axes says nothing of outer and inner angle.
    """
    tilt = np.zeros_like(here)
    if len(here) < 3 or np.max(np.abs(there - here)[[0, 2]]) < _EDGE:
        return tilt
    line = here + np.linspace(0.0, 1.0, _POINTS)[:, None] * (there - here)
    _, sine = gimbal.pointing(gimbal.matrix(gimbal.forward(line)))
    if np.max(sine) < math.sin(TILT):
        middle = limits[1]
        tilt[1] = math.copysign(TILT, (middle.low + middle.high) / 2 - here[1])
    return tilt


def _quickest(
    gimbal: Gimbal, angles: Floats, limits: Sequence[AxisLimits], tool: ToolLimits
) -> tuple[float, float]:
    """Return speed and ramp, of which the whole way is 1, that keep all limits or nearly so."""
    step = 1.0 / (len(angles) - 1)
    slope = np.max(np.abs(np.diff(angles, axis=0)), axis=0) / step
    q = gimbal.forward(angles)
    turn = float(np.max(np.linalg.norm(log(multiply(conjugate(q[:-1]), q[1:])), axis=1))) / step
    slopes = np.maximum([*slope, turn], 1e-12)
    velocity = float(np.min([*(one.velocity for one in limits), tool.velocity] / slopes))
    force = float(np.min([*(one.acceleration for one in limits), tool.acceleration] / slopes))
    jerk = tool.jerk / max(turn, 1e-12)
    # Two ramps take no more than the whole way: their speed times their duration is 1 at most.
    speed = min(velocity, math.sqrt(force / _FASTEST), math.cbrt(jerk / _HARDEST))
    return speed, max(_FASTEST * speed / force, math.sqrt(_HARDEST * speed / jerk))


def _progress(count: int, period: float, speed: float, ramp: float) -> Floats:
    """Return how far the way is gone in every period, from 0 to 1."""
    elapsed = period * np.arange(count + 1, dtype=np.float64)
    gone: Floats = speed * ramp_times(np.minimum(elapsed, elapsed[-1] - elapsed), ramp)
    return np.where(elapsed < elapsed[-1] / 2.0, gone, 1.0 - gone)


def _certified(
    gimbal: Gimbal, angles: Floats, period: float, limits: Sequence[AxisLimits]
) -> AxisPath:
    times = period * np.arange(len(angles), dtype=np.float64)
    least = float(np.min(gimbal.manipulability(angles)))
    certificate = AxisCertificate((), (), (), AxisPeak(0.0, 0.0, 0.0), least, (), ())
    certificate = measured(certificate, angles, period, limits, angles[[0, 0]])
    return AxisPath(times, angles, gimbal.forward(angles), times, certificate)
