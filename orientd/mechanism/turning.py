"""Motions of all axes of a gimbal together from rest to rest: home, and off the shortest turn.

The limits of the angles are a box, so the straight line between two sets of axis angles never
leaves them, and a pole on it is an angle like any other.
"""

from __future__ import annotations

import math
from math import degrees

import numpy as np

from orientd.driver import Figure, Joints, Quaternion, Vector3
from orientd.errors import LimitError, LimitKind, PlanError
from orientd.mechanism.arrays import matrices, of_arrays, orientations
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.joint_path import (
    EDGE,
    JointPath,
    ToolLimits,
    axis_peaks,
    figures_of,
    words_of,
)
from orientd.mechanism.routing import PLANNED, Route, as_driven, manipulability, refuse_angle
from orientd.mechanism.slews import TILT
from orientd.mechanism.timing import ramp_times
from orientd.rotation import Floats, conjugate, log, multiply, rotate

_TURN = 2 * math.pi
_RESERVE = 0.97
"""Share of the tool's limits that is used; the rest is for stops on the way."""
_FASTEST, _HARDEST = 1.875, 5.7735
"""Largest slope and curvature of the quintic by which the speed rises from 0 to 1."""
_ATTEMPTS = 40
_POINTS, _STEP = 129, 0.05
"""At which the turn of the tool is looked at, and one more for each step of an axis, rad."""


def pointed(gimbal: Gimbal, direction: Vector3, axis: str) -> Quaternion | None:
    """Return the orientation that points there with the innermost of three axes at zero.

    Args:
        gimbal: whose axes.
        direction: in the world.
        axis: of the tool, ``x``, ``y`` or ``z``.

    Returns:
        ``None`` where there are two axes, or the innermost one is not what points.
    """
    k = gimbal.kinematics
    points = rotate(np.array(k.tool), np.eye(3)["xyz".index(axis)])
    if len(gimbal.axes) == 2 or points[k.inner_axis] < 1.0 - 1e-9:
        return None
    matrix = np.zeros((3, 3))
    matrix[:, k.inner_axis] = rotate(conjugate(np.array(k.mount)), direction)
    nine = matrix.ravel().tolist()
    outer, _ = k.pointing(nine)
    return gimbal.orientation((outer, k.inner(nine, outer)[0][0], 0.0))


def windings(gimbal: Gimbal, q: Quaternion, last: Joints) -> list[Joints]:
    """Return the axis angles inside the limits that make *q*, nearest ones of each branch, rad.

    At the pole three axes make *q* with any outer angle: the inner one stays where it is, or turns
    as far as the limits of the outer one demand.

    Args:
        gimbal: whose axes.
        q: orientation of the tool.
        last: axis angles to which they are near, rad.

    Raises:
        LimitError: there are none; it names the axis.
    """
    branches = [gimbal.solve(q, last)[0]] if gimbal.is_fitting else gimbal.branches(q, last)
    found = []
    for branch in branches:
        nearest = _inside(gimbal, last, branch)
        if nearest is None and len(branch) == 3 and gimbal.is_at_pole(q):
            nearest = _shared(gimbal, q, last, branch)
        if nearest is not None:
            found.append(nearest)
    if not found:
        refuse_angle(np.array(branches), gimbal.axes, 0.0)
    return found


def _inside(gimbal: Gimbal, last: Joints, branch: Joints) -> Joints | None:
    """Return *branch* on the turns inside the limits that are nearest to *last*, if any are."""
    nearest = []
    for angle, near, axis in zip(branch, last, gimbal.axes, strict=True):
        least = math.ceil((axis.low - EDGE - angle) / _TURN)
        most = math.floor((axis.high + EDGE - angle) / _TURN)
        if least > most:
            return None
        count = min(max(round((near - angle) / _TURN), least), most)
        nearest.append(min(max(angle + _TURN * count, axis.low), axis.high))
    return tuple(nearest)


def _shared(gimbal: Gimbal, q: Quaternion, last: Joints, branch: Joints) -> Joints | None:
    """Return axis angles at the pole that share the turn between outer and inner axis."""
    outer, middle, inner = branch
    first, matrix = gimbal.axes[0], gimbal.kinematics.matrix(q)
    # Along a line through both angles nothing changes: one step on it shows its slope.
    slope = gimbal.kinematics.outer_at_pole(matrix, inner + 0.5) - outer
    slope = math.copysign(1.0, math.remainder(slope, _TURN))
    found = []
    for turns in range(-1, 2):
        near = outer + _TURN * (turns + round((last[0] - outer) / _TURN))
        for wanted in (first.low, first.high, min(max(near, first.low), first.high)):
            angles = _inside(gimbal, last, (wanted, middle, inner + slope * (wanted - near)))
            if angles is not None:
                found.append(angles)
    return min(found, key=lambda one: _travel(last, one), default=None)


def _travel(begin: Joints, end: Joints) -> float:
    return sum(abs(a - b) for a, b in zip(begin, end, strict=True))


def together(
    gimbal: Gimbal,
    joints: Joints,
    q: Quaternion | None,
    *,
    period: float,
    tool: ToolLimits,
    least: float = 0.0,
) -> JointPath | None:
    """Return how all axes turn together from rest to rest, as quick as the limits allow.

    Args:
        gimbal: whose axes.
        joints: axis angles where it begins, rad.
        q: orientation where it ends; ``None`` is home.
        period: of the cycles, s.
        tool: what it keeps to.
        least: how long it lasts at least, s.

    Returns:
        ``None`` where two axes cannot make *q*.

    Raises:
        LimitError: no axis angles inside the limits make *q*; it names the axis.
        PlanError: nothing keeps the limits of the tool.
    """
    if q is None:
        end = gimbal.home()
    elif gimbal.solve(q, joints)[1] > gimbal.roll_tolerance:
        return None
    else:
        end = min(windings(gimbal, q, joints), key=lambda one: _travel(joints, one))
    found = turned(gimbal, joints, end, period, tool, least=least)
    path = found.path
    figures = [
        *figures_of(path.joints, found.peaks),
        Figure("pointing error", 0.0, "rad", gimbal.max_deviation, 0.0),
        manipulability(gimbal, path.joints),
    ]
    goal = ", ".join(f"{degrees(angle):.1f}" for angle in path.joints[-1])
    notes = [f"all axes turn together to {goal} deg", *words_of(path.joints, found.peaks)]
    return JointPath(period, path.joints, path.q, path.path_times, tuple(figures), tuple(notes))


def turned(
    gimbal: Gimbal,
    begin: Joints,
    end: Joints,
    period: float,
    tool: ToolLimits,
    *,
    least: float = 0.0,
) -> Route:
    """Return the motion of all axes together between two sets of axis angles.

    Args:
        gimbal: whose.
        begin: axis angles, rad.
        end: those to go to.
        period: s.
        tool: what it keeps to.
        least: how long it lasts at least, s.

    Raises:
        PlanError: nothing is slow enough.
    """
    here, there = np.array(begin), np.array(end)
    tilt = _tilt(gimbal, here, there)

    def at(share: Floats) -> Floats:
        bump = 4.0 * share * (1.0 - share)
        angles: Floats = here + share[:, None] * (there - here) + bump[:, None] * tilt
        return angles

    points = _POINTS + round(float(np.max(np.abs(there - here))) / _STEP)
    speed, ramp = _quickest(gimbal, at(np.linspace(0.0, 1.0, points)), tool)
    seconds = max(1.0 / speed + ramp, least, 2.0 * period)
    for _ in range(_ATTEMPTS):
        count = math.ceil(seconds / period - 1e-9)
        stretch = count * period / (1.0 / speed + ramp)
        angles = at(_progress(count, period, speed / stretch, ramp * stretch))
        angles[0], angles[-1] = here, there
        times = period * np.arange(len(angles), dtype=np.float64)
        path = JointPath(period, angles, orientations(gimbal, angles), times)
        past = angles[[0, 0]]
        peaks = tuple(axis_peaks(angles, period, gimbal.axes, past))
        by_axes = max(
            one.value / one.limit if one.kind is LimitKind.VELOCITY
            else math.sqrt(one.value / (PLANNED * one.limit))
            for one in peaks
        )  # fmt: skip
        more = max(tool.excess(path.q, period) / _RESERVE, by_axes)
        seconds = count * period * max(more, 1.01)
        if more > 1.0:
            continue
        try:
            return as_driven(gimbal, Route(path, peaks), here, past)
        except LimitError:
            # A sample is just at the pole.
            seconds = (count + 1) * period
    raise PlanError("no way of the axes keeps the limits of the tool")


def _tilt(gimbal: Gimbal, here: Floats, there: Floats) -> Floats:
    """Return what the middle axis turns besides, so that the orientations show how the others turn.

    Close to the pole an orientation of three axes says nothing of outer and inner angle.
    """
    tilt = np.zeros_like(here)
    if len(here) < 3 or np.max(np.abs(there - here)[[0, 2]]) < EDGE:
        return tilt
    line = here + np.linspace(0.0, 1.0, _POINTS)[:, None] * (there - here)
    _, sine = of_arrays(gimbal).pointing(matrices(gimbal, orientations(gimbal, line)))
    if np.max(sine) < math.sin(TILT):
        middle = gimbal.axes[1]
        tilt[1] = math.copysign(TILT, (middle.low + middle.high) / 2 - here[1])
    return tilt


def _quickest(gimbal: Gimbal, angles: Floats, tool: ToolLimits) -> tuple[float, float]:
    """Return speed and ramp, of which the whole way is 1, that keep all limits or nearly so."""
    step = 1.0 / (len(angles) - 1)
    slope = np.max(np.abs(np.diff(angles, axis=0)), axis=0) / step
    q, axes = orientations(gimbal, angles), gimbal.axes
    turn = float(np.max(np.linalg.norm(log(multiply(conjugate(q[:-1]), q[1:])), axis=1))) / step
    slopes = np.maximum([*slope, turn], 1e-12)
    velocity = float(np.min([*(one.velocity for one in axes), tool.velocity] / slopes))
    force = float(np.min([*(one.acceleration for one in axes), tool.acceleration] / slopes))
    jerk = tool.jerk / max(turn, 1e-12)
    # Two ramps take no more than the whole way: their speed times their duration is 1 at most.
    speed = min(velocity, math.sqrt(force / _FASTEST), math.cbrt(jerk / _HARDEST))
    return speed, max(_FASTEST * speed / force, math.sqrt(_HARDEST * speed / jerk))


def _progress(count: int, period: float, speed: float, ramp: float) -> Floats:
    """Return how far the way is gone in every period, from 0 to 1."""
    elapsed = period * np.arange(count + 1, dtype=np.float64)
    gone: Floats = speed * ramp_times(np.minimum(elapsed, elapsed[-1] - elapsed), ramp)
    return np.where(elapsed < elapsed[-1] / 2.0, gone, 1.0 - gone)
