r"""Lead the slews of a gimbal of two axes around keep-out cones, by a search over its axis angles.

The angles lie on a grid on which both axes turn by one cell in the same time.  So the quickest way
is the one of fewest steps to a neighbour, straight or diagonal, and a search in breadth finds it:
each cell is visited once, however the cones lie.  Then the way is straightened: it keeps only the
corners that it needs.  A slew of a path that leads around takes longer, so its begin and end are
chosen again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from orientd.driver import AxisLimits
from orientd.mechanism.arrays import orientations
from orientd.mechanism.crossings import Crossings
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.router import Bools, Chain, Crossing, Indices, Sky
from orientd.rotation import Floats

Clearance = Callable[[Floats, Floats], Floats]
"""Returns the least clearance from all cones, rad: orientations ``(n, 4)``, times in s ``(n,)``."""

_ATTEMPTS = 8
"""Most slews of a path that are replaced or left out."""
_APART = 1.5
"""Time before and after a slew at which the path counts, in times of the longest slew."""
_CLOSER = 1e-3
"""How much nearer than its ends a slew may come to a cone within the reserve, rad."""
_CELL, _MOST_CELLS = np.radians(1.5), 100_000
"""Largest cell of the grid, rad, and the most cells."""
_SHORTER = 0.9


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

    def of(self, gimbal: Gimbal, joints: Floats, times: Floats) -> Floats:
        """Return the clearance of axis angles at times since the first sample of the path, rad."""
        return self.clearance(orientations(gimbal, joints), self.begin + times)

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
        found = self.of(gimbal, joints, times)
        least = min([self.reserve, *(float(found[one]) - _CLOSER for one in near)])
        return bool(np.all(found >= least))


def around(
    gimbal: Gimbal,
    sky: Sky,
    obstacles: Obstacles,
    laid: Callable[[Chain], Floats],
    search: Crossings,
    entry: Floats,
    *,
    period: float,
    axes: Sequence[AxisLimits],
) -> Chain | None:
    """Return a chain whose slews keep out of the cones.

    A slew without a way around is left out, and another chain is searched for.  Some time before
    and after that slew it must be on the path, so that no more of it is lost than with the slew.

    Args:
        gimbal: the gimbal, of two axes.
        sky: the path with its lines.
        obstacles: the cones.
        laid: returns the axis angles of a chain.
        search: for the best chain without cones.
        entry: as for :meth:`.Crossings.best`.
        period: of the samples, s.
        axes: limits of the axes that the plan may use.

    Returns:
        ``None`` if no chain keeps out of them.
    """
    plan, entry, joined = search.best(entry), entry.copy(), np.empty(0, dtype=np.intp)
    wide = int(_APART * _longest(sky, axes, period))
    times = period * np.arange(len(sky.exact), dtype=np.float64)
    for _ in range(_ATTEMPTS):
        if plan is None:
            break
        if any(sky.lines[plan.at(at)].error[at] > gimbal.on_target for at in joined.tolist()):
            # From another first line there may be a chain that is on the path there.
            entry[plan.line] = np.inf
            plan = search.best(entry)
            continue
        joints = laid(plan)
        for first, last, near in _off_path(sky, plan, gimbal.on_target):
            part = slice(first, last + 1)
            if not obstacles.are_cleared(gimbal, joints[part], times[part], near):
                break
        else:
            return plan
        inside = [one for one in plan.crossings if one.first < last and first < one.last]
        first = min([first, *(one.first for one in inside)])
        last = max([last, *(one.last for one in inside)])
        ends = plan.at(first), plan.at(last)
        start, goal = sky.lines[ends[0]].joints[first], sky.lines[ends[1]].joints[last]
        via = way_between(gimbal, start, goal, obstacles, axes=axes, times=times[[first, last]])
        if via is None:
            search.close(*ends)
            around_it = np.array([first - wide, last + wide])
            is_within = (around_it > 0) & (around_it < len(times) - 1)
            joined = np.concatenate([joined, around_it[is_within]])
            plan = search.best(entry)
            continue
        before = [one for one in plan.crossings if one.last <= first]
        after = [one for one in plan.crossings if one.first >= last]
        limits = before[-1].last if before else 0, after[0].first if after else len(times) - 1
        # The way around may last longer by any part of the path.
        lasts = _lasting(np.stack([start, *via, goal]), axes, period)
        led = search.refined(Crossing(first, last, *ends, via), *limits, wide=lasts)
        if led is None:
            return None
        plan = Chain(plan.line, (*before, led, *after))
    return None


def _longest(sky: Sky, axes: Sequence[AxisLimits], period: float) -> float:
    """Return the samples that an axis needs for all of its range, or for the lines and a turn."""
    every = np.concatenate([line.joints for line in sky.lines])
    low, high, speed = np.array([(axis.low, axis.high, axis.velocity) for axis in axes]).T
    wide = np.minimum(high - low, np.ptp(every, axis=0) + 2.0 * np.pi)
    return float(np.max(wide / speed)) / period


def _off_path(sky: Sky, plan: Chain, tolerance: float) -> Iterator[tuple[int, int, list[int]]]:
    """Yield first and last sample of each part off the path, and which of these are on it."""
    is_off = sky.lines[plan.line].error > tolerance
    for one in plan.crossings:
        is_off[one.first + 1 : one.last] = True
        is_off[one.last :] = sky.lines[one.goal].error[one.last :] > tolerance
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_off, [False]])))
    for begin, end in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        near = [place for place, is_in in ((0, begin > 0), (-1, end < len(is_off))) if is_in]
        yield max(begin - 1, 0), min(end, len(is_off) - 1), near


def _lasting(corners: Floats, axes: Sequence[AxisLimits], period: float) -> int:
    """Return the samples that the axes need from corner to corner, rounded up."""
    speed = np.array([axis.velocity for axis in axes])
    seconds = float(np.sum(np.max(np.abs(np.diff(corners, axis=0)) / speed, axis=1)))
    return int(np.ceil(seconds / period))


def way_between(
    gimbal: Gimbal,
    start: Floats,
    goal: Floats,
    obstacles: Obstacles,
    *,
    axes: Sequence[AxisLimits],
    times: Floats,
) -> Floats | None:
    """Return the corners of the quickest way between axis angles outside of the cones.

    Args:
        gimbal: the gimbal, of two axes.
        start: axis angles, rad, shape ``(2,)``.
        goal: axis angles, rad, shape ``(2,)``.
        obstacles: the cones.
        axes: limits of the axes that the plan may use.
        times: when the way begins and ends, s since the first sample of the path, shape ``(2,)``.

    Returns:
        Shape ``(n, 2)``, without both ends; ``None`` if there is no way.
    """
    ends = np.stack([start, goal])
    low, high, speed = np.array([(axis.low, axis.high, axis.velocity) for axis in axes]).T
    low = np.maximum(low, ends.min(axis=0) - 2.0 * np.pi)
    high = np.minimum(high, ends.max(axis=0) + 2.0 * np.pi)
    # Time in which the faster axis turns by a cell.
    step = max(
        float(_CELL / speed.max()), float(np.sqrt(np.prod((high - low) / speed) / _MOST_CELLS))
    )
    shape = np.maximum(np.ceil((high - low) / (speed * step)), 1.0).astype(np.intp) + 1
    cell = np.maximum((high - low) / (shape - 1), 1e-12)
    every = low + cell * np.argwhere(np.ones(shape, dtype=np.bool_))
    found = np.min([obstacles.of(gimbal, every, np.full(len(every), at)) for at in times], axis=0)
    # Two neighbours have the reserve between them; near a cone the ends have none themselves.
    kept = obstacles.reserve + 0.5 * float(np.linalg.norm(cell))
    away = min(kept, float(obstacles.of(gimbal, ends, times).min()))
    places = np.clip(np.rint((ends - low) / cell).astype(np.intp), 0, shape - 1)
    chain = _fewest(np.reshape(found >= away, shape), places[0], places[1])
    if chain is None:
        return None
    points = np.concatenate([start[None], low + cell * chain[1:-1], goal[None]])
    between = np.interp(np.linspace(0.0, 1.0, len(points)), [0.0, 1.0], times)
    return _corners(gimbal, points, between, obstacles)


def _fewest(is_free: Bools, begin: Indices, end: Indices) -> Indices | None:
    """Return the free cells from one to another with the fewest steps, shape ``(n, 2)``.

    The ends count as free.  Of equally short ways any is taken.
    """
    padded = np.pad(is_free, 1)
    wide = padded.shape[1]
    start, goal = (int((place[0] + 1) * wide + place[1] + 1) for place in (begin, end))
    free = padded.ravel()
    free[[start, goal]] = True
    moves = np.array([-1, 1, -wide, wide, -wide - 1, -wide + 1, wide - 1, wide + 1])
    came = np.full(len(free), -1, dtype=np.intp)
    came[start] = start
    front = np.array([start])
    while len(front) and came[goal] < 0:
        ahead, origin = (front[:, None] + moves).ravel(), np.repeat(front, len(moves))
        is_new = free[ahead] & (came[ahead] < 0)
        front, place = np.unique(ahead[is_new], return_index=True)
        came[front] = origin[is_new][place]
    if came[goal] < 0:
        return None
    way = [goal]
    while way[-1] != start:
        here = way[-1]
        way.append(int(came[here]))
    flat = np.array(way[::-1])
    return np.stack([flat // wide - 1, flat % wide - 1], axis=1)


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
            there = here + max(1, int(_SHORTER * (there - here)))
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
