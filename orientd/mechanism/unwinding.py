"""Slews of a gimbal without times: the path rests while the axes change their branch or unwind.

The axes follow the cheapest chain of lines (:mod:`orientd.mechanism.router`).  From one line to the
next all axes turn evenly, and the tool leaves its path meanwhile.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

from orientd.curves.trajectory import Trajectory
from orientd.driver import Joints
from orientd.mechanism import Gimbal
from orientd.mechanism.arrays import row_of
from orientd.mechanism.poles import samples_of
from orientd.mechanism.router import Bools, Chain, Crossing, Edges, cheapest, turns_inside
from orientd.mechanism.routing import joints_along
from orientd.mechanism.turning import turned
from orientd.mechanism.way import Slew, Way
from orientd.rotation import Floats

_REST = 0.3
"""Cost of a rest, s, besides the time of its slew."""

_TRAVEL = 1e-4
"""Cost of a radian of travel, s."""

_MOST_LINES = 128
_TURN = 2.0 * math.pi


def slewed(gimbal: Gimbal, path: Way, near: Joints) -> Way:
    """Return a path that rests for slews where the axes have no other way inside their ranges.

    Any other path is returned as it is, and so is one without such a way.

    Args:
        gimbal: kinematics and limits of the axes.
        path: from rest to rest, with a position that stays.
        near: axis angles at its start, rad.

    Raises:
        PlanError: a pose is out of reach.
    """
    if not (gimbal.allow_slews and near):
        return path
    times = samples_of(path.trajectory)
    lines = _lines(gimbal, path.trajectory.orientations(times), times, near)
    low, high, edge = np.array([(one.low, one.high, one.resolution) for one in gimbal.axes]).T
    is_in = np.all((lines >= low - edge) & (lines <= high + edge), axis=2)
    if is_in[0].all():
        return path
    chain = _cheapest(gimbal, lines, is_in)
    if chain is None:
        return path
    return _laid(gimbal, path, times, lines, chain.crossings)


def _lines(gimbal: Gimbal, q: Floats, times: Floats, near: Joints) -> Floats:
    """Return the angles on the lines along a path, that of *near* first, shape ``(k, n, axes)``."""
    found: list[tuple[float, Floats]] = []
    begins = [near]
    if not gimbal.is_fitting:
        solutions = gimbal.branches(row_of(q[0]), near)
        apart = [np.abs(np.exp(1j * np.subtract(one, near)) - 1.0).max() for one in solutions]
        begins.append(solutions[int(np.argmax(apart))])
    for begin in begins:
        line = joints_along(gimbal, times, q, np.zeros((len(q), 3)), begin)
        turns = []
        for angles, axis, one in zip(line.T, gimbal.axes, near, strict=True):
            low, high = np.full_like(angles, axis.low), np.full_like(angles, axis.high)
            turns.append(turns_inside(angles, low, high, one))
        for shift in product(*turns):
            wound = line + _TURN * np.array(shift)
            found.append((float(np.abs(wound[0] - near).max()), wound))
    own = joints_along(gimbal, times, q, np.zeros((len(q), 3)), near)
    others = [line for far, line in sorted(found, key=lambda one: one[0]) if far > _TRAVEL]
    return np.stack([own, *others[: _MOST_LINES - 1]])


def _cheapest(gimbal: Gimbal, lines: Floats, is_in: Bools) -> Chain | None:
    """Return the cheapest chain of lines inside the ranges, from the first line on."""
    count, size = is_in.shape
    speed, force = np.array([(one.velocity, one.acceleration) for one in gimbal.axes]).T
    entry = np.full(count, np.inf)
    entry[0] = 0.0 if is_in[0, 0] else np.inf
    travel = _TRAVEL * np.abs(np.diff(lines, axis=1)).sum(axis=2)
    is_broken = ~(is_in[:, 1:] & is_in[:, :-1])

    def edges(origin: int, goal: int) -> list[Edges]:
        if origin == goal:
            return []
        begin = np.flatnonzero(is_in[origin, :-1] & is_in[goal, :-1] & is_in[goal, 1:])
        gaps = np.abs(lines[goal, begin] - lines[origin, begin])
        lasts = np.where(
            gaps > speed**2 / force, gaps / speed + speed / force, 2.0 * np.sqrt(gaps / force)
        ).max(axis=1, initial=0.0)
        return [Edges(begin, begin + 1, lasts + _REST * (begin > 0))]

    return cheapest(entry, travel, is_broken, edges, np.arange(size))


def _laid(
    gimbal: Gimbal,
    path: Way,
    times: Floats,
    lines: Floats,
    crossings: tuple[Crossing, ...],
) -> Way:
    """Return a path with slews at the beginnings of *crossings*."""
    parts, passed, delay = list[Trajectory](), 0.0, 0.0
    # Behind the first of them the axes are elsewhere.
    slews = [one for one in path.slews if one.end <= times[crossings[0].first]] if crossings else []
    moved = path.times.copy()
    for one in crossings:
        at = float(times[one.first])
        here, there = lines[one.origin, one.first], lines[one.goal, one.first]
        if at > passed:
            parts.append(path.trajectory.restricted(passed, at).shifted(delay))
        begin = at + delay
        end = begin + float(np.abs(there - here).max())
        asked = path.trajectory.orientations(times[[one.first]])[0]
        ends = tuple(here.tolist()), tuple(there.tolist())
        slews.append(Slew(begin, end, *ends, q=asked))
        parts.append(Trajectory.fit(partial(turned, gimbal, slews[-1]), [begin, end]))
        moved[path.times > at] += end - begin
        passed, delay = at, delay + end - begin
    if passed < path.duration:
        parts.append(path.trajectory.restricted(passed, path.duration).shifted(delay))
    whole = Trajectory.joined(parts, 0)
    return replace(path, trajectory=whole, times=moved, slews=tuple(slews))
