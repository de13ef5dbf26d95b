r"""Lead the slews of a gimbal of two axes around keep-out cones, by a search over its axis angles.

The search covers a part of the path (:mod:`orientd.mechanism.angle_grid`).  A step on one of the
lines costs nothing, a step elsewhere its time, and no step enters a cone.  The cheapest chain of
steps may leave the path at another time, turn the other way round, or pass a cone above or below.
Then it is straightened: the slew keeps only the corners that it needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from orientd.driver import AxisLimits
from orientd.mechanism.angle_grid import AngleGrid, GridLines, Indices, cheapest_chain
from orientd.mechanism.arrays import orientations
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.lines import Bools, Sky
from orientd.mechanism.schedule import Crossing, Schedule, refined
from orientd.rotation import Floats

Clearance = Callable[[Floats, Floats], Floats]
"""Returns the least clearance from all cones, rad: orientations ``(n, 4)``, times in s ``(n,)``."""


_AROUND = 1.5
"""Time before and after a slew within which it may move, in times of the longest slew."""
_FEWEST = 5
"""Steps on a line that count as following it."""
_SUN_STEP = 30.0
"""Time after which the positions of the cones are computed again, s.

The sun turns by 0.12 degrees.
"""
_ATTEMPTS = 5
"""Most parts of a path whose slews are replaced."""
_CLOSER = 1e-3
"""How much nearer than its ends a slew may come to a cone within the reserve, rad."""


class Obstacles(NamedTuple):
    """The cones, and how far to keep away from them.

    Attributes:
        clearance: see :data:`Clearance`; its times begin with the motion.
        reserve: least clearance of a slew, rad; a rounded corner uses some of it.
        begin: time of the first sample of the path, s.
    """

    clearance: Clearance
    reserve: float
    begin: float

    def are_cleared(
        self, gimbal: Gimbal, joints: Floats, times: Floats, near: Sequence[int] = (0, -1)
    ) -> bool:
        """Return whether axis angles keep away.

        Args:
            gimbal: the gimbal.
            joints: rad, shape ``(n, axes)``.
            times: s since the first sample of the path, shape ``(n,)``.
            near: indices of angles that may be within the reserve; the others may be as close.
        """
        found = self.clearance(orientations(gimbal, joints), self.begin + times)
        least = min([self.reserve, *(float(found[one]) - _CLOSER for one in near)])
        return bool(np.all(found >= least))


def around(
    gimbal: Gimbal,
    sky: Sky,
    plan: Schedule,
    obstacles: Obstacles,
    laid: Callable[[Schedule], Floats],
    *,
    period: float,
    axes: Sequence[AxisLimits],
    counts: Bools,
    entry: Floats,
) -> Schedule | None:
    """Return a schedule whose slews keep out of the cones.

    Args:
        gimbal: the gimbal, of two axes.
        sky: the path with its lines.
        plan: the best schedule without cones.
        obstacles: the cones.
        laid: returns the axis angles of a schedule.
        period: of the samples, s.
        axes: limits of the axes that the plan may use.
        counts: of each sample, whether being off the path there counts as lost, shape ``(n,)``.
        entry: cost of beginning on each line, s; infinite where that is impossible.

    Returns:
        ``None`` if a slew has no way around.
    """
    for _ in range(_ATTEMPTS):
        joints, times = laid(plan), period * np.arange(len(sky.exact), dtype=np.float64)
        blocked = [
            (first, last)
            for first, last, near in _off_path(sky, plan, gimbal.on_target)
            if not obstacles.are_cleared(
                gimbal, joints[first : last + 1], times[first : last + 1], near
            )
        ]
        if not blocked:
            return plan
        found = _replaced(gimbal, sky, plan, blocked[0], obstacles, period, axes, counts, entry)
        if found is None:
            return None
        plan = found
    return None


def _off_path(sky: Sky, plan: Schedule, tolerance: float) -> Iterator[tuple[int, int, list[int]]]:
    """Yield first and last sample of each part off the path, and which of these are on it."""
    is_off = sky.lines[plan.line].error > tolerance
    for one in plan.crossings:
        is_off[one.first + 1 : one.last] = True
        is_off[one.last :] = sky.lines[one.goal].error[one.last :] > tolerance
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_off, [False]])))
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        near = [place for place, is_in in ((0, begin > 0), (-1, end < len(is_off))) if is_in]
        yield max(begin - 1, 0), min(end, len(is_off) - 1), near


def way_between(
    gimbal: Gimbal,
    start: Floats,
    goal: Floats,
    obstacles: Obstacles,
    *,
    period: float,
    axes: Sequence[AxisLimits],
) -> Floats | None:
    """Return the corners of the quickest way from rest to axis angles outside of the cones.

    Args:
        gimbal: the gimbal, of two axes.
        start: axis angles, rad, shape ``(2,)``.
        goal: axis angles, rad, shape ``(2,)``.
        obstacles: the cones, where they are when the path begins.
        period: of the samples, s.
        axes: limits of the axes that the plan may use.

    Returns:
        Shape ``(n, 2)``, without both ends; ``None`` if there is no way.
    """
    ends = np.stack([start, goal])
    longest = 3 * _longest(axes, ends[None], period)
    grid = AngleGrid.of(ends[None], axes, period, longest)
    count = longest // grid.stride + 2
    found = obstacles.clearance(
        orientations(gimbal, np.concatenate([ends, grid.every])), np.full(len(grid.every) + 2, 0.0)
    )
    # Near a cone the ends themselves have no reserve.
    away = min(_kept(grid, obstacles), float(found[:2].min()))
    cells = np.repeat(grid.cells(ends)[:, None], count, axis=1)
    is_on = np.ones((2, count), dtype=bool)
    is_on[0, 1:] = False
    is_free = (found[2:] >= away).reshape(1, *grid.shape)
    part = np.zeros(count, dtype=np.intp)
    lines = GridLines(cells, is_on, np.ones(count), is_free, part)
    chain = cheapest_chain(lines, np.array([0.0, np.inf]), np.array([False, True]))
    if chain is None:
        return None
    arrived = int(np.argmax(np.all(chain[0] == cells[1, 0], axis=1)))
    points = grid.joints(chain[0][: arrived + 1])
    points[[0, -1]] = ends
    return _corners(gimbal, points, np.zeros(len(points)), obstacles)


def _longest(axes: Sequence[AxisLimits], joints: Floats, period: float) -> int:
    """Return the samples that an axis needs for all of its range, or for the lines and a turn."""
    found = []
    for place, axis in enumerate(axes):
        wide = float(np.ptp(joints[..., place])) + 2.0 * np.pi
        found.append(min(axis.high - axis.low, wide) / axis.velocity)
    return int(max(found) / period) + 1


def _replaced(
    gimbal: Gimbal,
    sky: Sky,
    plan: Schedule,
    blocked: tuple[int, int],
    obstacles: Obstacles,
    period: float,
    axes: Sequence[AxisLimits],
    counts: Bools,
    entry: Floats,
) -> Schedule | None:
    """Return the schedule with other slews around some samples, or ``None``."""
    every = np.stack([line.joints for line in sky.lines])
    count = every.shape[1]
    wide = int(_AROUND * _longest(axes, every, period))
    begin, end = max(0, blocked[0] - wide), min(count - 1, blocked[1] + wide)
    # A slew is replaced as a whole.
    for one in plan.crossings:
        begin = min(begin, one.first) if one.last > begin else begin
    for one in reversed(plan.crossings):
        end = max(end, one.last) if one.first < end else end
    before = [one for one in plan.crossings if one.last <= begin]
    after = [one for one in plan.crossings if one.first >= end]
    grid = AngleGrid.of(every[:, begin : end + 1], axes, period, end - begin)
    at = np.unique(np.append(np.arange(begin, end, grid.stride), end))
    places = np.arange(len(sky.lines))
    first = entry if begin == 0 else np.where(places == plan.at(begin), 0.0, np.inf)
    is_last = (places == plan.at(end)) | (end == count - 1)
    lines = _lines(gimbal, sky, grid, at, obstacles, period, counts)
    chain = cheapest_chain(lines, first, is_last)
    if chain is None:
        return None
    crossings = []
    labels = _labels(chain, lines)
    known = np.flatnonzero(labels >= 0)
    for a, b in zip(known[:-1].tolist(), known[1:].tolist(), strict=True):
        origin, goal = int(labels[a]), int(labels[b])
        if b == a + 1 and origin == goal:
            continue
        points = grid.joints(chain[0][a : b + 1])
        points[0], points[-1] = every[origin, at[a]], every[goal, at[b]]
        via = _corners(gimbal, points, period * at[a : b + 1], obstacles)
        if via is None:
            return None
        crossings.append(Crossing(int(at[a]), int(at[b]), origin, goal, via))
    moved = [
        refined(sky, one, grid.stride, period, axes, counts, gimbal.on_target) for one in crossings
    ]
    line = plan.line if begin else int(labels[0])
    return Schedule(line, (*before, *moved, *after), plan.lost)


def _lines(
    gimbal: Gimbal,
    sky: Sky,
    grid: AngleGrid,
    at: Indices,
    obstacles: Obstacles,
    period: float,
    counts: Bools,
) -> GridLines:
    """Return where a chain may go at the samples *at*."""
    joints = np.stack([line.joints[at] for line in sky.lines])
    is_quick = [np.logical_or.reduceat(line.is_quick, at[:-1]) for line in sky.lines]
    is_on = np.stack([line.error[at] <= gimbal.on_target for line in sky.lines])
    is_on[:, :-1] &= ~np.stack(is_quick)
    is_on[:, 1:] &= ~np.stack(is_quick)
    step = np.append(np.diff(at), 0) * period
    price = np.where(counts[at], step, 1e-3 * step)
    since = obstacles.begin + period * at
    q, away = orientations(gimbal, grid.every), _kept(grid, obstacles)

    def free(when: float) -> Bools:
        found = obstacles.clearance(q, np.full(len(q), when)) >= away
        return np.reshape(found, grid.shape)

    part = ((since - since[0]) / _SUN_STEP).astype(np.intp)
    is_free = [free(float(since[0]))]
    if np.array_equal(is_free[0], free(float(since[-1]))):
        part = np.zeros_like(part)
    else:
        middles = float(since[0]) + _SUN_STEP * (np.arange(int(part[-1]) + 1) + 0.5)
        is_free = [free(when) for when in middles.tolist()]
    return GridLines(grid.cells(joints), is_on, price, np.stack(is_free), part)


def _kept(grid: AngleGrid, obstacles: Obstacles) -> float:
    """Return the clearance of two neighbours with which the way between them has the reserve."""
    return obstacles.reserve + 0.5 * float(np.linalg.norm(grid.cell))


def _labels(chain: tuple[Indices, int], lines: GridLines) -> Indices:
    """Return the line that a chain follows at every step, -1 while it is on none."""
    cells, line = chain
    is_there = np.all(lines.cells == cells, axis=-1) & lines.is_on
    count = len(cells)
    # How long it stays on each line.
    runs = np.zeros((len(is_there), count + 1), dtype=np.intp)
    for at in range(count - 1, -1, -1):
        runs[:, at] = np.where(is_there[:, at], runs[:, at + 1] + 1, 0)
    labels = np.full(count, -1, dtype=np.intp)
    labels[0] = line
    for at in range(1, count):
        if not is_there[line, at] or labels[at - 1] < 0:
            longest = int(np.argmax(runs[:, at]))
            if runs[longest, at] < min(_FEWEST, count - at):
                continue
            line = longest
        labels[at] = line
    if labels[-1] < 0:
        same = np.all(lines.cells[:, -1] == cells[-1], axis=1)
        labels[-1] = int(np.argmax(same))
    return labels


def _corners(gimbal: Gimbal, points: Floats, times: Floats, obstacles: Obstacles) -> Floats | None:
    """Return the fewest of successive axis angles that keep a way clear, without both ends.

    Args:
        gimbal: the gimbal.
        points: one for each step, rad, shape ``(n, 2)``.
        times: s since the first sample of the path, shape ``(n,)``.
        obstacles: the cones.

    Returns:
        ``None`` if the way enters a cone.
    """
    corners, here, last = [], 0, len(points) - 1
    while here < last:
        there = last
        while not _is_straight_clear(gimbal, points, times, obstacles, here, there):
            if there == here + 1:
                return None
            there = here + max(1, int(0.9 * (there - here)))
        corners.append(there)
        here = there
    return points[corners[:-1]]


def _is_straight_clear(
    gimbal: Gimbal, points: Floats, times: Floats, obstacles: Obstacles, here: int, there: int
) -> bool:
    share = np.linspace(0.0, 1.0, 2 * (there - here) + 1)
    joints = points[here] + share[:, None] * (points[there] - points[here])
    between = times[here] + share * (times[there] - times[here])
    return obstacles.are_cleared(gimbal, joints, between)
