"""Which line the axes of a gimbal follow when: the lines of a path, and the cheapest chain of them.

A *line* is a branch of the gimbal with one whole turn of each axis.  On it the axes point exactly
along the path; an axis that would leave its range stays at the end of it.  A *run* is a part of a
line whose steps the axes can make.  A *crossing* leads from one line to a run of another, or of the
same.  Whether it passes a pole, flips or unwinds makes no difference.

The cheapest chain is found by correcting costs line by line: a line is settled for all samples at
once, and its crossings may make other lines cheaper.  So the number of rounds is that of crossings
on the way, not that of samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from orientd.driver import AxisLimits
from orientd.mechanism.arrays import joints_at, matrices, of_arrays, outer_line
from orientd.mechanism.gimbal import Gimbal
from orientd.rotation import Floats

Bools = np.ndarray[Any, np.dtype[np.bool_]]
Indices = np.ndarray[Any, np.dtype[np.intp]]

EDGE = 1e-9
"""Rounding of angles, rad, and of shares of a limit."""
_TURN = 2.0 * np.pi
_MOST_LINES = 12
"""Lines of a path: at any sample about a dozen are inside the ranges."""
_LOOKS = 2000
"""Samples at which turns are compared."""
_MOST_ROUNDS = 1000
_BETTER = 1e-9
"""Least gain of cost, s."""


class Line(NamedTuple):
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


class Sky(NamedTuple):
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

    @property
    def is_open(self) -> tuple[bool, bool]:
        """Whether any line is on each branch: the inner axes may pass the pole."""
        branches = {line.branch for line in self.lines}
        return 0 in branches, 1 in branches


class Edges(NamedTuple):
    """Crossings from one line to another.

    Attributes:
        begin: index in the grid of the last sample on the first line, shape ``(m,)``.
        end: index in the grid of the first sample on the other line, shape ``(m,)``.
        cost: s, shape ``(m,)``.
    """

    begin: Indices
    end: Indices
    cost: Floats


class Crossing(NamedTuple):
    """A part of the path on which the axes lead from one line to another, or to the same.

    Attributes:
        first: index of the last sample on *origin*.
        last: index of the first sample on *goal*.
        origin: index of a line.
        goal: index of a line.
        via: axis angles at the corners on the way, rad, shape ``(m, axes)``; ``None`` if the outer
            axis turns evenly and the others do what is best.
    """

    first: int
    last: int
    origin: int
    goal: int
    via: Floats | None = None


class Chain(NamedTuple):
    """The lines that the axes follow.

    Attributes:
        line: index of the first line.
        crossings: in order.
    """

    line: int
    crossings: tuple[Crossing, ...]

    def at(self, sample: int) -> int:
        """Return the line at a sample that is on one."""
        passed = [one.goal for one in self.crossings if one.last <= sample]
        return passed[-1] if passed else self.line


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

    A turn of an axis counts if it is inside the range at some sample at which all turns nearer to
    *near* are outside.  So an endless axis has one turn for each branch.

    Args:
        gimbal: the gimbal.
        q: orientations ``(w, x, y, z)``, tool to world, shape ``(n, 4)``.
        period: time between them, s.
        axes: limits of the axes that the plan may use.
        tolerance: largest error that still counts as pointing along the path, rad.
        near: axis angles, rad, shape ``(axes,)``.
    """
    matrix = matrices(gimbal, q)
    exact, sine = outer_line(gimbal, matrix)
    at = np.unique(np.linspace(0, len(q) - 1, _LOOKS).astype(np.intp))
    # Close to the pole a large error of the outer axis is a small one of the direction.
    slack = np.full((len(at), len(axes)), tolerance + EDGE)
    slack[:, 0] += np.arcsin(np.minimum(1.0, tolerance / np.maximum(sine[at], EDGE)))
    low, high = np.array([(axis.low, axis.high) for axis in axes]).T
    found: list[tuple[float, Line]] = []
    for branch in (0, 1):
        joints = joints_at(gimbal, matrix, exact + branch * np.pi)
        joints[:, 1:] = np.unwrap(joints[:, 1:], axis=0)
        turns = [
            turns_inside(joints[at, k], low[k] - slack[:, k], high[k] + slack[:, k], float(near[k]))
            for k in range(len(axes))
        ]
        is_quick = _quick(joints, axes, period)
        for shift in product(*turns):
            wanted = joints + _TURN * np.array(shift)
            line = _line(gimbal, matrix, wanted, Line(branch, wanted, sine, is_quick), axes, period)
            if np.any(line.error <= tolerance):
                found.append((float(np.max(np.abs(line.joints[0] - near))), line))
    kept = sorted(found, key=lambda one: one[0])[:_MOST_LINES]
    return Sky(matrix, exact, sine, tuple(line for _, line in kept))


def turns_inside(angles: Floats, low: Floats, high: Floats, near: float) -> list[int]:
    """Return the whole turns with which an axis is inside its range where nearer turns are not.

    Args:
        angles: rad, shape ``(m,)``.
        low: ends of the range, rad, shape ``(m,)``.
        high: as *low*.
        near: angle from which turns are counted, rad.
    """
    reach = float(np.ptp(angles)) + _TURN
    least, most = max(float(low.min()), near - reach), min(float(high.max()), near + reach)
    first = int(np.ceil((least - angles.max()) / _TURN))
    last = int(np.floor((most - angles.min()) / _TURN))
    every = sorted(
        range(first, last + 1), key=lambda turn: abs(float(angles[0]) + _TURN * turn - near)
    )
    kept: list[tuple[int, Bools]] = []
    for turn in every:
        here = angles + _TURN * turn
        inside = (here >= low) & (here <= high)
        if inside.any() and not any(bool((other | ~inside).all()) for _, other in kept):
            kept.append((turn, inside))
    return [turn for turn, _ in kept]


def _quick(
    joints: Floats, axes: Sequence[AxisLimits], period: float, *, has_bends: bool = True
) -> Bools:
    """Return which steps exceed a velocity or, with *has_bends*, an acceleration of the axes."""
    speed, force = np.array([(axis.velocity, axis.acceleration) for axis in axes]).T
    steps = np.diff(joints, axis=0)
    is_quick: Bools = np.any(np.abs(steps) > speed * period * (1.0 + EDGE), axis=1)
    if has_bends:
        bends = np.any(np.abs(np.diff(steps, axis=0)) > force * period**2, axis=1)
        is_quick[1:] |= bends
        is_quick[:-1] |= bends
    return is_quick


def _line(
    gimbal: Gimbal,
    matrix: Floats,
    wanted: Floats,
    exact: Line,
    axes: Sequence[AxisLimits],
    period: float,
) -> Line:
    """Return the line *exact*, whose angles are *wanted*, inside the ranges of the axes."""
    low, high = np.array([(axis.low, axis.high) for axis in axes]).T
    is_out = np.any((wanted < low - EDGE) | (wanted > high + EDGE), axis=1)
    joints, error, is_quick = np.clip(wanted, low, high), np.zeros(len(wanted)), exact.is_quick
    at = np.flatnonzero(is_out)
    if len(at):
        best = joints_at(gimbal, matrix[:, at], joints[at, 0])
        best[:, 1:] += _TURN * np.round((wanted[at, 1:] - best[:, 1:]) / _TURN)
        joints[at] = np.clip(best, low, high)
        _, missed = of_arrays(gimbal).inner(matrix[:, at], joints[at, 0])
        error[at] = missed + np.sum(np.abs(joints[at, 1:] - best[:, 1:]), axis=1)
        # At the end of a range the axis only has to be slowed down, which is left to rounding.
        slowed = _quick(joints, axes, period, has_bends=False)
        is_quick = np.where(is_out[1:] | is_out[:-1], slowed, is_quick)
    return Line(exact.branch, joints, error, is_quick)


def cheapest(
    entry: Floats,
    stay: Floats,
    is_broken: Bools,
    edges: Callable[[int, int], Sequence[Edges]],
    at: Indices,
) -> Chain | None:
    """Return the cheapest chain from the first sample of a grid to the last.

    Args:
        entry: cost of beginning on each line, infinite where that is impossible, shape ``(k,)``.
        stay: cost of each step on each line, shape ``(k, m - 1)``.
        is_broken: whether the axes cannot make that step, same shape.
        edges: returns the crossings from one line to another; asked for only if they may be needed.
        at: samples of the grid, shape ``(m,)``.

    Returns:
        ``None`` if no chain leads to the last sample.
    """
    count, size = len(entry), len(at)
    passed = np.concatenate([np.zeros((count, 1)), np.cumsum(stay, axis=1)], axis=1)
    run = np.concatenate([np.zeros((count, 1), np.intp), np.cumsum(is_broken, axis=1)], axis=1)
    entries = np.full((count, size), np.inf)
    entries[:, 0] = entry
    best = np.full((count, size), np.inf)
    begun = np.zeros((count, size), dtype=np.intp)
    came: list[dict[int, tuple[int, int]]] = [{} for _ in range(count)]
    known: dict[tuple[int, int], Sequence[Edges]] = {}
    todo = [line for line in range(count) if np.isfinite(entry[line])]
    for _ in range(_MOST_ROUNDS * count):
        if not todo:
            break
        origin = todo.pop(0)
        _settle(entries[origin], passed[origin], run[origin], best[origin], begun[origin])
        for goal in range(count):
            if (origin, goal) not in known:
                known[origin, goal] = edges(origin, goal)
            for one in known[origin, goal]:
                price = best[origin, one.begin] + one.cost
                better = np.flatnonzero(price < best[goal, one.end] - _BETTER)
                # Of several to the same sample the cheapest is written last.
                for k in better[np.argsort(-price[better], kind="stable")].tolist():
                    end = int(one.end[k])
                    entries[goal, end] = best[goal, end] = price[k]
                    came[goal][end] = origin, int(one.begin[k])
                if len(better) and goal not in todo:
                    todo.append(goal)
    line, place = int(np.argmin(best[:, -1])), size - 1
    if not np.isfinite(best[line, -1]):
        return None
    crossings: list[Crossing] = []
    while (place := int(begun[line, place])) > 0:
        origin, before = came[line][place]
        crossings.append(Crossing(int(at[before]), int(at[place]), origin, line))
        line, place = origin, before
    return Chain(line, tuple(crossings[::-1]))


def _settle(entries: Floats, passed: Floats, run: Indices, best: Floats, begun: Indices) -> None:
    """Spread the costs of *entries* over the runs of a line, into *best* and *begun*."""
    starts = np.flatnonzero(np.diff(run, prepend=-1)).tolist()
    for a, b in zip(starts, [*starts[1:], len(run)], strict=True):
        level = entries[a:b] - passed[a:b]
        least = np.minimum.accumulate(level)
        best[a:b] = least + passed[a:b]
        begun[a:b] = a + np.maximum.accumulate(np.where(level <= least, np.arange(b - a), 0))
