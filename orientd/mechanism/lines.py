r"""Lines of axis angles along a path: one for each branch of a gimbal and each whole turn.

On a line the axes point exactly where the path does.  An axis that would leave its range stays at
the end of it, with an error.  So every line covers the whole path.
Two lines have outer angles that lie half turns apart (:func:`.outer_line`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from orientd.driver import AxisLimits
from orientd.mechanism.arrays import joints_at, matrices, of_arrays, outer_line
from orientd.mechanism.gimbal import Gimbal
from orientd.rotation import Floats

Bools = np.ndarray[Any, np.dtype[np.bool_]]

_TURN = 2.0 * np.pi
_MOST_LINES = 12
_EXACT = 1e-9


@dataclass(frozen=True, eq=False)
class Line:
    """Axis angles along a whole path on one branch and turn.

    Attributes:
        branch: 0 or 1; the outer angles of the two lie half a turn apart.
        joints: inside the ranges of the axes, rad, shape ``(n, axes)``.
        error: angle between the requested direction and the one of *joints*, rad, shape ``(n,)``.
        is_quick: whether the axes cannot make the step from each sample to the next, shape
            ``(n - 1,)``.
    """

    branch: int
    joints: Floats
    error: Floats
    is_quick: Bools


@dataclass(frozen=True, eq=False)
class Sky:
    """A path as the outer axis of a gimbal sees it.

    Attributes:
        matrix: as from :func:`.matrices`, shape ``(9, n)``.
        exact: an exact outer angle of branch 0, continuous, rad, shape ``(n,)``.
        sine: sine of the distance from the pole, shape ``(n,)``.
        lines: the lines that point along the path somewhere.
    """

    matrix: Floats
    exact: Floats
    sine: Floats
    lines: tuple[Line, ...]


def lines_of(
    gimbal: Gimbal,
    q: Floats,
    period: float,
    axes: Sequence[AxisLimits],
    tolerance: float,
    *,
    near: Floats,
) -> Sky:
    """Return the lines along a path of orientations.

    Args:
        gimbal: the gimbal.
        q: orientations ``(w, x, y, z)``, tool to world, shape ``(n, 4)``.
        period: time between them, s.
        axes: limits of the axes that the plan may use.
        tolerance: largest error that still counts as pointing along the path, rad.
        near: axis angles; of many turns those about them are kept, rad, shape ``(axes,)``.
    """
    matrix = matrices(gimbal, q)
    exact, sine = outer_line(gimbal, matrix)
    found: list[tuple[float, Line]] = []
    for branch in (0, 1):
        joints = joints_at(gimbal, matrix, exact + branch * np.pi)
        joints[:, 1:] = np.unwrap(joints[:, 1:], axis=0)
        shifts = [_shifts(joints[:, place], axis, near[place]) for place, axis in enumerate(axes)]
        for turns in product(*shifts):
            line = _line(gimbal, matrix, joints + _TURN * np.array(turns), branch, period, axes)
            if np.any(line.error <= tolerance):
                far = float(np.max(np.abs(line.joints[0] - near)))
                found.append((far, line))
    kept = sorted(found, key=lambda one: one[0])[:_MOST_LINES]
    return Sky(matrix, exact, sine, tuple(line for _, line in kept))


def _shifts(angles: Floats, axis: AxisLimits, near: float) -> range:
    """Return the whole turns with which *angles* are inside the range of an axis anywhere.

    An axis may have hundreds of turns: only those about the angle *near* are of use.
    """
    low, high = float(np.min(angles)), float(np.max(angles))
    reach = high - low + _TURN
    least, most = max(axis.low, near - reach), min(axis.high, near + reach)
    return range(
        int(np.ceil((least - high) / _TURN - 0.01)),
        int(np.floor((most - low) / _TURN + 0.01)) + 1,
    )


def _line(
    gimbal: Gimbal,
    matrix: Floats,
    wanted: Floats,
    branch: int,
    period: float,
    axes: Sequence[AxisLimits],
) -> Line:
    low, high, speed, force = np.array(
        [(axis.low, axis.high, axis.velocity, axis.acceleration) for axis in axes]
    ).T
    outer = np.clip(wanted[:, 0], low[0], high[0])
    best = joints_at(gimbal, matrix, outer)
    best[:, 1:] += _TURN * np.round((wanted[:, 1:] - best[:, 1:]) / _TURN)
    joints = np.clip(best, low, high)
    _, missed = of_arrays(gimbal).inner(matrix, outer)
    error = missed + np.sum(np.abs(joints[:, 1:] - best[:, 1:]), axis=1)
    is_inside = np.max(np.abs(joints - wanted), axis=1) < _EXACT
    steps = np.diff(joints, axis=0)
    is_quick = np.any(np.abs(steps) > speed * period, axis=1)
    # At the end of a range the axis only has to be slowed down, which is left to rounding.
    bends = np.any(np.abs(np.diff(steps, axis=0)) > force * period**2, axis=1)
    bends &= is_inside[:-2] & is_inside[1:-1] & is_inside[2:]
    is_quick[1:] |= bends
    is_quick[:-1] |= bends
    return Line(branch, joints, error, is_quick)


def off_line(sky: Sky, outer: Floats, at: Any, is_open: Bools) -> Floats:  # noqa: ANN401 - a slice or indices
    """Return the sine of the error with given outer angles and the best inner ones.

    Args:
        sky: the path.
        outer: outer angles, rad.
        at: the samples of the path that they belong to.
        is_open: for each branch, whether the ranges of the inner axes allow it at all.
    """
    turn, sine = outer - sky.exact[at], sky.sine[at]
    error = sine * np.abs(np.sin(turn))
    if is_open.all():
        return np.asarray(error, dtype=np.float64)
    # On the far side of the pole the inner axis stays at the pole.
    is_near = (np.cos(turn) > 0.0) == bool(is_open[0])
    found: Floats = np.where(is_near, error, sine)
    return found
