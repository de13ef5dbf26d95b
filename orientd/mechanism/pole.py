r"""Passages near the pole of a gimbal: the least deviation with which the axes can follow.

Within a tube of error *E* the outer angle may deviate by :math:`\arcsin(\sin E / \rho)` from an
exact one, :math:`\rho` the sine of the distance from the pole (:mod:`orientd.mechanism.gimbal`).
If :math:`\rho \le \sin E` it is free, and the line may leave on another branch.  For each branch to
leave on, the taut string through the tube needs the least rate that *E* allows.  Bisection finds
the smallest *E* whose rate the axis can reach.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.quintic import smooth_step
from orientd.driver import AxisLimits
from orientd.mechanism.arrays import joints_at, of_arrays, outer_line
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.joint_path import Bounds, rates
from orientd.mechanism.timing import smooth
from orientd.rotation import Floats

_BRANCHES = (0, 1, -1, 2, -2)
_BISECTIONS = 20
_SPEED_SHARE = 0.99
"""Share of an axis' velocity; where the line bends, an axis is faster between two records."""
_CLOSE = 0.2
"""Share of an axis' limit from which a sample counts as near the pole."""


@dataclass(frozen=True, slots=True)
class Passage:
    """One passage near the pole.

    Attributes:
        first: index of the last exact sample before it.
        last: index of the first exact sample after it.
        branch: number of half turns by which the outer angle leaves its exact line.
        joints: axis angles from *first* to *last*, rad, unwrapped, shape ``(n, axes)``.
        error: largest deviation from the path, rad.
    """

    first: int
    last: int
    branch: int
    joints: Floats
    error: float

    @property
    def kind(self) -> str:
        """The motion of the outer axis.

        In a ``pass`` it is nearly still, in a ``flip`` it turns by about half a turn, in a
        ``deviation`` the path bends around the pole.
        """
        turn = abs(self.joints[-1, 0] - self.joints[0, 0])
        if turn > np.pi / 2:
            return "flip"
        return "pass" if self.branch % 2 else "deviation"


def windows(line: Floats, bounds: Bounds) -> list[tuple[int, int]]:
    """Return the index ranges in which the outer axis would exceed its velocity.

    Args:
        line: as from :func:`outer_line`.
        bounds: limits of the plan.
    """
    period, limit = bounds.period, bounds.axes[0]
    velocity, acceleration = rates(line[:, None], period, np.empty((0, 1)))
    share = np.maximum(
        np.abs(velocity[:, 0]) / limit.velocity, np.abs(acceleration[:, 0]) / limit.acceleration
    )
    share[:-1] = np.maximum(share[:-1], share[1:])
    near = np.concatenate([[False], share > _CLOSE, [False]])
    edges = np.nonzero(near[1:] != near[:-1])[0]
    room = _room(limit, period)
    found: list[tuple[int, int]] = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        first, last = max(0, int(begin) - room), min(len(line) - 1, int(end) + room)
        if found and first <= found[-1][1]:
            found[-1] = (found[-1][0], last)
        else:
            found.append((first, last))
    return [(a, b) for a, b in found if np.max(share[a : b + 1]) > 1.0]


def _room(limit: AxisLimits, period: float) -> int:
    """Return the number of exact samples on each side of a window in which bends are rounded."""
    return 2 * math.ceil(limit.velocity / (limit.acceleration * period)) + 2


def passages(
    gimbal: Gimbal, matrix: Floats, window: tuple[int, int], bounds: Bounds
) -> list[Passage]:
    """Return the feasible passages near the pole, with the least error of each.

    Args:
        gimbal: the gimbal, with its largest deviation.
        matrix: of the whole path, as from :func:`.matrices`, shape ``(9, n)``.
        window: first and last index, as from :func:`windows`.
        bounds: limits of the plan; the ranges of the axes are not checked here.

    Returns:
        For both branches to enter on, one passage for each branch to leave on.
    """
    first, last = window
    part = matrix[:, first : last + 1]
    line, sine = outer_line(gimbal, part)
    found = []
    for branch in _BRANCHES:
        best: Floats | None = None
        low, high = 0.0, gimbal.max_deviation
        for step in range(_BISECTIONS):
            error = high if step == 0 else (low + high) / 2
            joints = _attempt(gimbal, part, line, sine, branch, error, bounds)
            if joints is None:
                if step == 0:
                    break
                low = error
            else:
                high, best = error, joints
        if best is None:
            continue
        missed = float(np.max(of_arrays(gimbal).inner(part, best[:, 0])[1]))
        if missed <= gimbal.max_deviation * (1 + 1e-9):
            # Half a turn apart all axes turn at the same rates, so with the same error.
            other = joints_at(gimbal, part, best[:, 0] + np.pi)
            other[:, 1:] = np.unwrap(other[:, 1:], axis=0)
            found += [Passage(first, last, branch, one, missed) for one in (best, other)]
    return found


def _attempt(
    gimbal: Gimbal,
    matrix: Floats,
    line: Floats,
    sine: Floats,
    branch: int,
    error: float,
    bounds: Bounds,
) -> Floats | None:
    """Return axis angles within *error* that keep the rates, or ``None``."""
    free = np.nonzero(sine <= np.sin(error))[0]
    if branch and free.size == 0:
        return None
    half = np.arcsin(np.minimum(1.0, np.sin(error) / np.maximum(sine, 1e-300)))
    low, high = line - half, line + half
    if free.size:
        low[free[0] : free[-1] + 1] = -np.inf
        high[free[0] : free[-1] + 1] = np.inf
        low[free[-1] + 1 :] += branch * np.pi
        high[free[-1] + 1 :] += branch * np.pi
    period, limit = bounds.period, bounds.axes[0]
    # Add exact samples on both sides of the string, so that its ends are rounded too.  Fade out the
    # rounding itself if the string is straight there.
    room = min(_room(limit, period), (len(line) - 2) // 3)
    first, last = room, len(line) - 1 - room
    exact = line.copy()
    exact[last:] += branch * np.pi
    exact[first : last + 1] = taut_string(
        low[first : last + 1], high[first : last + 1], exact[first], exact[last]
    )
    hurry = float(np.max(np.abs(np.diff(exact)))) / period
    width = min(math.ceil(hurry / (limit.acceleration * period)), room // 2)
    share = np.minimum(1.0, np.arange(len(line)) / max(1, room // 2))
    share = smooth_step(np.minimum(share, share[::-1]))
    outer = exact + share * (smooth(exact, width) - exact)
    joints = joints_at(gimbal, matrix, outer)
    joints[:, 1:] = np.unwrap(joints[:, 1:], axis=0)
    velocity, acceleration = rates(joints, period, joints[:0])
    for place, allowed in enumerate(bounds.axes):
        if np.max(np.abs(velocity[:, place])) > _SPEED_SHARE * allowed.velocity:
            return None
        if np.max(np.abs(acceleration[:, place])) > allowed.acceleration * (1 + 1e-6):
            return None
    return joints


def taut_string(low: ArrayLike, high: ArrayLike, start: float, end: float) -> Floats:
    """Return the shortest line between two bounds, on a uniform grid.

    Among all lines through the tube it has the least sum of every convex function of the slope.  So
    it also has the least peak slope (Davies and Kovac 2001, section 2; Grasmair 2007).

    Args:
        low: lower bounds, shape ``(n,)``; may be ``-inf``.
        high: upper bounds, shape ``(n,)``; may be ``inf``.
        start: value at the first sample, whose bounds are not checked.
        end: value at the last sample, whose bounds are not checked.

    Returns:
        The line, shape ``(n,)``.

    Raises:
        ValueError: the tube is closed somewhere: a lower bound lies above the upper one.
    """
    low = np.array(low, dtype=np.float64)
    high = np.array(high, dtype=np.float64)
    low[[0, -1]] = high[[0, -1]] = start, end
    if np.any(low > high):
        raise ValueError(f"the tube is closed at sample {int(np.argmax(low > high))}")
    count = len(low)
    line = np.empty(count)
    line[0] = start
    at = 0
    while at < count - 1:
        # Slopes from here that stay inside the tube up to each sample.  When none is left, the
        # string bends at the bound that was tightest.
        run = np.arange(1, count - at)
        least = np.maximum.accumulate((low[at + 1 :] - line[at]) / run)
        most = np.minimum.accumulate((high[at + 1 :] - line[at]) / run)
        closed = np.nonzero(least > most)[0]
        if closed.size == 0:
            to, value = count - 1, end
        else:
            first = int(closed[0])
            rises = (low[at + 1 + first] - line[at]) / run[first] > most[first - 1]
            bound, slopes = (high, most) if rises else (low, least)
            tightest = slopes[first - 1]
            inside = (bound[at + 1 : at + 1 + first] - line[at]) / run[:first]
            to = at + 1 + int(np.nonzero(inside == tightest)[0][-1])
            value = bound[to]
        line[at + 1 : to + 1] = line[at] + (value - line[at]) * np.arange(1, to - at + 1) / (
            to - at
        )
        at = to
    return line
