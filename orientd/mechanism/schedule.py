"""Choose which line the axes follow when, and when they slew, so that least time is lost.

The whole path is known.  Dynamic programming over its samples weighs every slew from line to line
that keeps the speeds of the axes.  A slew begins before the axes would leave the path, and ends
behind it: the choice of that instant splits the loss between both sides of the keyhole.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from orientd.driver import AxisLimits
from orientd.mechanism.lines import Bools, Sky, off_line
from orientd.rotation import Floats

_COARSE = 0.2
"""Time between the instants at which a slew may begin, before these are refined, s."""
_MOST_SAMPLES = 2000
_REFINED = 101
"""Number of instants around the best coarse one that are compared."""
_LEAVING = 1e-3
"""Cost of a second off the line, in seconds lost: of equal losses the exact path is better."""
_TRAVEL = 1e-4
"""Cost of a radian of the outer axis, in seconds lost."""
_NEVER = -1


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


class Schedule(NamedTuple):
    """The lines that the axes follow.

    Attributes:
        line: index of the first line.
        crossings: in order.
        lost: time off the path by more than the tolerance, about, s.
    """

    line: int
    crossings: tuple[Crossing, ...]
    lost: float

    def at(self, sample: int) -> int:
        """Return the line at a sample that is on one."""
        passed = [one.goal for one in self.crossings if one.last <= sample]
        return passed[-1] if passed else self.line


class _Grid(NamedTuple):
    """Some samples of a path.

    Attributes:
        at: their indices in the path, shape ``(m,)``.
        step: time between them, s.
        joints: all angles of every line, shape ``(lines, m, axes)``.
        is_quick: whether a step is too quick for the axes, shape ``(lines, m - 1)``.
        cost: what it costs to follow each line for a step, s, shape ``(lines, m)``.
        weight: seconds lost for a step off the path, shape ``(m,)``.
    """

    at: np.ndarray[tuple[int], np.dtype[np.int64]]
    step: float
    joints: Floats
    is_quick: Bools
    cost: Floats
    weight: Floats


def scheduled(
    sky: Sky,
    period: float,
    axes: Sequence[AxisLimits],
    tolerance: float,
    *,
    counts: Bools,
    entry: Floats,
) -> Schedule | None:
    """Return the schedule with the least time off the path by more than *tolerance*.

    Args:
        sky: the path with its lines.
        period: of its samples, s.
        axes: limits of the axes that the plan may use.
        tolerance: rad.
        counts: of each sample, whether being off the path there counts as lost, shape ``(n,)``.
        entry: cost of beginning on each line, s; infinite where that is impossible.

    Returns:
        ``None`` if no schedule follows the path to its end.
    """
    grid = _grid(sky, period, tolerance, counts)
    is_lossless = np.sum(grid.cost[:, :-1], axis=1) < period
    is_lossless &= ~np.any(grid.is_quick, axis=1) & np.isfinite(entry)
    if np.any(is_lossless):
        return Schedule(int(np.argmin(np.where(is_lossless, entry, np.inf))), (), 0.0)
    speed = np.array([axis.velocity for axis in axes])
    is_open = _is_open(sky)
    every = range(len(sky.lines))
    edges = {
        pair: _crossings(sky, grid, pair, speed, tolerance, is_open)
        for pair in product(every, every)
    }
    found = _shortest(grid, edges, entry)
    if found is None:
        return None
    line, crossings, lost = found
    stride = int(grid.at[1])
    best = [refined(sky, one, stride, period, axes, counts, tolerance) for one in crossings]
    return Schedule(line, tuple(best), lost)


def _is_open(sky: Sky) -> Bools:
    """Return for both branches whether any line is on it: the inner axes may pass the pole."""
    branches = {line.branch for line in sky.lines}
    return np.array([0 in branches, 1 in branches])


def _grid(sky: Sky, period: float, tolerance: float, counts: Bools) -> _Grid:
    count = len(sky.exact)
    stride = max(1, round(_COARSE / period), -(-count // _MOST_SAMPLES))
    at = np.unique(np.append(np.arange(0, count, stride), count - 1))
    step = stride * period
    weight = np.where(counts[at], step, step * _LEAVING)
    quick = [np.logical_or.reduceat(line.is_quick, at[:-1]) for line in sky.lines]
    lost = [line.error[at] > tolerance for line in sky.lines]
    return _Grid(
        at,
        step,
        np.stack([line.joints[at] for line in sky.lines]),
        np.stack(quick),
        np.stack(lost) * weight,
        weight,
    )


def _crossings(
    sky: Sky,
    grid: _Grid,
    pair: tuple[int, int],
    speed: Floats,
    tolerance: float,
    is_open: Bools,
) -> tuple[np.ndarray, Floats]:
    """Return where the quickest slew from each sample of a line ends on another, and its cost."""
    origin, goal = grid.joints[pair[0]], grid.joints[pair[1]]
    count, step = len(grid.at), grid.step
    ends = np.full(count, _NEVER)
    may_go_on = np.append(~grid.is_quick[pair[1]], True)
    after = _after_quick(grid.is_quick[pair[0]]) if pair[0] == pair[1] else np.arange(count) + 1
    for apart in range(1, count):
        first = np.flatnonzero(
            (ends[:-apart] == _NEVER) & (after[:-apart] <= np.arange(apart, count))
        )
        if not len(first):
            if np.all(ends[:-apart] != _NEVER):
                break
            continue
        last = first + apart
        is_near = np.all(np.abs(goal[last] - origin[first]) <= speed * (apart * step), axis=1)
        is_near &= may_go_on[last]
        ends[first[is_near]] = last[is_near]
    cost = np.full(count, np.inf)
    begun = np.flatnonzero(ends != _NEVER)
    cost[begun] = 0.0
    outer, limit = grid.joints[..., 0], np.sin(tolerance)
    length = ends - np.arange(count)
    for apart in range(1, int(np.max(length[begun], initial=0))):
        first = begun[length[begun] > apart]
        share = apart / length[first]
        here = (1.0 - share) * outer[pair[0], first] + share * outer[pair[1], ends[first]]
        at = first + apart
        is_lost = off_line(sky, here, grid.at[at], is_open) > limit
        cost[first] += is_lost * grid.weight[at]
    # The first sample is still on its line.
    cost[begun] += grid.cost[pair[0], begun] + _LEAVING * length[begun] * step
    cost[begun] += _TRAVEL * np.abs(outer[pair[1], ends[begun]] - outer[pair[0], begun])
    return ends, cost


def _after_quick(is_quick: Bools) -> np.ndarray:
    """Return for each sample the first one behind the next steps that are too quick."""
    count = len(is_quick) + 1
    after = np.full(count, 2 * count)
    ahead = 2 * count
    for at in range(count - 2, -1, -1):
        if is_quick[at]:
            is_end = at + 1 >= count - 1 or not is_quick[at + 1]
            ahead = at + 1 if is_end else ahead
        after[at] = ahead
    return after


def _shortest(
    grid: _Grid, edges: dict[tuple[int, int], tuple[np.ndarray, Floats]], entry: Floats
) -> tuple[int, list[Crossing], float] | None:
    lines, count = len(grid.joints), len(grid.at)
    best = np.full((count, lines), np.inf)
    best[0] = entry
    via: dict[tuple[int, int], tuple[int, int]] = {}
    travel = _TRAVEL * np.abs(np.diff(grid.joints[..., 0], axis=1))
    follow = np.where(grid.is_quick, np.inf, grid.cost[:, :-1] + travel)
    for at in range(count - 1):
        here = best[at]
        onward = here + follow[:, at]
        is_better = onward < best[at + 1]
        for same in np.flatnonzero(is_better).tolist():
            via[at + 1, same] = (at, same)
        best[at + 1] = np.where(is_better, onward, best[at + 1])
        for (origin, goal), (ends, cost) in edges.items():
            price = here[origin] + cost[at]
            end = int(ends[at])
            if end != _NEVER and price < best[end, goal]:
                best[end, goal] = price
                via[end, goal] = (at, origin)
    at, line = count - 1, int(np.argmin(best[-1]))
    lost = float(best[at, line])
    if not np.isfinite(lost):
        return None
    crossings = []
    while at > 0:
        before, origin = via[at, line]
        if before != at - 1 or origin != line:
            crossings.append(Crossing(int(grid.at[before]), int(grid.at[at]), origin, line))
        at, line = before, origin
    return line, crossings[::-1], lost


def refined(
    sky: Sky,
    crossing: Crossing,
    stride: int,
    period: float,
    axes: Sequence[AxisLimits],
    counts: Bools,
    tolerance: float,
) -> Crossing:
    """Return a crossing with the best ends among all samples around its own.

    Args:
        sky: the path with its lines.
        crossing: it begins and ends on the lines to within *stride* samples.
        stride: samples by which it may begin earlier or later.
        period: of the samples, s.
        axes: limits of the axes that the plan may use.
        counts: of each sample, whether being off the path there counts as lost, shape ``(n,)``.
        tolerance: largest error that still counts as on the path, rad.
    """
    origin, goal = (sky.lines[place] for place in (crossing.origin, crossing.goal))
    speed = np.array([axis.velocity for axis in axes])
    is_open, begin, end = _is_open(sky), crossing.first, crossing.last
    starts = np.unique(np.linspace(begin - stride, begin + stride, _REFINED).round().astype(int))
    starts = starts[(starts >= max(0, begin - stride)) & (starts < end)]
    lasts = np.arange(max(0, end - 3 * stride), min(len(sky.exact), end + 3 * stride))
    best = (np.inf, begin, end)
    limit = np.sin(tolerance)
    may_go_on = np.append(~goal.is_quick, True)
    for first in starts.tolist():
        if np.any(origin.is_quick[min(first, begin) : max(first, begin)]):
            continue
        needed = _needed(origin.joints[first], goal.joints[lasts], crossing.via, speed)
        fits = (needed <= (lasts - first) * period) & (lasts > first)
        fits &= may_go_on[lasts]
        # It stays on the goal from there on.
        quick = np.append(np.flatnonzero(goal.is_quick[lasts[0] : end]) + lasts[0] + 1, 0)
        fits &= lasts >= quick.max()
        if not np.any(fits):
            continue
        last = int(lasts[int(np.argmax(fits))])
        at = np.arange(first, last + 1)
        is_lost = counts[at]
        if crossing.via is None:
            here = np.linspace(origin.joints[first, 0], goal.joints[last, 0], len(at))
            is_lost = is_lost & (off_line(sky, here, at, is_open) > limit)
        cost = period * (float(np.sum(is_lost)) + _LEAVING * (last - first))
        if cost < best[0]:
            best = (cost, first, last)
    return crossing._replace(first=best[1], last=best[2])


def _needed(begin: Floats, ends: Floats, via: Floats | None, speed: Floats) -> Floats:
    """Return the time that the axes need from one place by way of others to each of *ends*, s."""
    seconds = 0.0
    for corner in () if via is None else via:
        seconds += float(np.max(np.abs(corner - begin) / speed))
        begin = corner
    found: Floats = seconds + np.max(np.abs(ends - begin) / speed, axis=1)
    return found
