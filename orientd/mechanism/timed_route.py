"""Axis angles of a gimbal for a path whose times are fixed: least time off it, told beforehand.

The path does not wait for the axes.  Where they cannot follow, they leave it early, slew at full
rate, and rejoin it (:mod:`orientd.mechanism.crossings`).  A slew that would enter a keep-out cone
leads around it (:mod:`orientd.mechanism.keep_out_slews`).  Corners between lines and slews are
rounded, so that acceleration is continuous.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np

from orientd.driver import AxisLimits, Joints
from orientd.errors import PlanError, StartError
from orientd.mechanism.arrays import joints_at, orientations, row_of, wrapped
from orientd.mechanism.crossings import Crossings
from orientd.mechanism.figure import Figure
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.joint_path import (
    KINDS,
    Bounds,
    JointPath,
    ToolLimits,
    losses_of,
    planned,
    rates,
    refuse_angle,
)
from orientd.mechanism.keep_out_slews import Clearance, Obstacles, around, way_between
from orientd.mechanism.pointing import manipulability, pointing_error
from orientd.mechanism.router import Bools, Chain, Crossing, Sky, lines_of
from orientd.mechanism.timing import rounded, width
from orientd.rotation import Floats, check_unit

SAME = 1e-3
"""Largest distance of the path's start from the given angles, rad."""
_SPEED_SHARE = 0.997
"""Usable share of an axis' velocity: between two records it is faster."""
_TOOL_SHARE = 0.9
"""Usable share of the tool's limits: all axes turn it at once."""
_ENTRY = 1e-3
"""Cost of a second of the lead-in, in seconds lost."""
_PLANE = 2
"""Axes of a gimbal whose slews can lead around cones."""
_SAME_LINE = 1e-6
_FEWEST = 5
_ROUNDING = 1e-9
_ATTEMPTS = 6
_SLOWER, _SLOWEST = 0.98, 0.25
"""Share of a limit after an attempt that exceeds it, and the least such share."""
_RESERVES = tuple(np.radians([0.2, 0.8, 2.0, 4.0]).tolist())
"""Clearances of slews around a cone that are tried in turn, rad: fast axes cut corners more."""
_STILL = 1e-9
_OUTSIDE = np.radians(0.1)
"""Clearance of the path from which on the axes must be outside too, rad."""


@dataclass(frozen=True, eq=False)
class TimedPath:
    """The path to follow.

    Attributes:
        q: orientations ``(w, x, y, z)``, tool to world, shape ``(n, 4)``.
        counts: of each sample, whether it belongs to the keyframes, shape ``(n,)``.
        start: axis angles before the path, rad, shape ``(axes,)``; ``None`` is anywhere.
        past: axis angles of the samples before a path that begins in motion, oldest first, rad,
            shape ``(m, axes)``.
        has_lead_in: whether the axes first lead from *start*, at rest, to the path.
        keep_out: clearances that slews keep; if one cannot be kept, the next one counts.
    """

    q: Floats
    counts: Bools
    start: Floats | None
    past: Floats
    has_lead_in: bool
    keep_out: tuple[Clearance, ...] = ()


class Timed(NamedTuple):
    """A path at fixed times, with its lead-in.

    Attributes:
        joints: rad, shape ``(n, axes)``.
        lead: number of samples before the first one of the path.
        rest: number of samples after the last one of the path.
        is_led: whether slews lead around cones.
    """

    joints: Floats
    lead: int
    rest: int
    is_led: bool = False


def route_at_times(
    gimbal: Gimbal,
    period: float,
    q: Floats,
    ends: tuple[float, float],
    *,
    joints: Joints = (),
    before: Sequence[Joints] = (),
    tool: ToolLimits | None = None,
    keep_out: tuple[Clearance, ...] = (),
) -> JointPath:
    """Return the joint path of a gimbal for a tool path that keeps its times.

    At rest, the lead-in of the axes takes the place of the one of *q*, and may last longer.

    Args:
        gimbal: kinematics and limits of the axes.
        period: of the grid, s.
        q: tool orientations up to rest, shape ``(n, 4)``.
        ends: path times of the first keyframe and of the last, s.
        joints: planned or reported axis angles at the start, rad; empty if unknown.
        before: planned axis angles of the periods before a path that begins in motion, oldest
            first; empty for a path that begins at rest.
        tool: limits of the tool; none by default.
        keep_out: clearances from keep-out cones that slews of two axes keep if they can; if one
            cannot be kept, the next one counts.

    Raises:
        LimitError: an axis cannot follow.
        PlanError: the axes can neither follow the path nor rejoin it.
        StartError: the axes cannot be at the start of the path.
        ValueError: a quaternion is not of unit norm.
    """
    q, past = check_unit(q), np.reshape(np.array(before), (-1, len(gimbal.axes)))
    begin, end = (round(time / period) for time in ends)
    is_moving = len(past) > 0 and bool(np.ptp(past, axis=0).max() > _STILL)
    first = begin if begin and not is_moving else 0
    start = np.array(gimbal.solve(row_of(q[0]), joints)[0]) if joints else None
    at = np.arange(first, len(q))
    path = TimedPath(
        q[first:],
        (at >= begin) & (at <= end),
        start,
        past if is_moving else past[:0],
        first > 0,
        keep_out,
    )
    bounds = Bounds(period, planned(gimbal.axes, period), tool or ToolLimits())
    found, lead = timed_route(gimbal, path, bounds)
    times = found.path_times + first * period
    if lead:
        times[:lead] = np.linspace(0.0, first * period, lead, endpoint=False)
    return replace(found, path_times=times)


def timed_route(gimbal: Gimbal, path: TimedPath, bounds: Bounds) -> tuple[JointPath, int]:
    """Return the axis angles with the least time off a path, certified, and their lead-in.

    Args:
        gimbal: the gimbal; its :attr:`~.Gimbal.on_target` says what counts as off the path.
        path: the path.
        bounds: limits of the plan.

    Returns:
        The joint path, and the number of its samples before the first one of *path*.  Its path
        times begin at 0 with that one, and are negative before.

    Raises:
        LimitError: an axis would exceed a limit.
        PlanError: the axes cannot follow.
        StartError: the path does not begin at the given angles.
    """
    period = bounds.period
    joints, lead, rest, is_led = timed_joints(gimbal, path, bounds)
    count = len(path.q)
    reached = orientations(gimbal, joints)
    times = period * np.arange(-lead, count, dtype=np.float64)
    times = np.concatenate([times, np.repeat(times[-1:], rest)])
    followed = slice(lead, lead + count)
    off = np.where(path.counts, pointing_error(gimbal, reached[followed], path.q), 0.0)
    losses = losses_of(np.concatenate([np.zeros(lead), off]), period, gimbal.on_target)
    held = np.where(off > gimbal.on_target, 0.0, off)
    at = int(np.argmax(held))
    figures = (
        Figure("pointing error", float(held[at]), "rad", gimbal.on_target, (lead + at) * period),
        Figure("time off target", sum(one.end - one.start for one in losses), "s"),
        manipulability(gimbal, joints),
    )
    notes = ("the axes slew around keep-out cones",) if is_led else ()
    return JointPath(period, joints, reached, times, figures, notes, losses), lead


def timed_joints(gimbal: Gimbal, path: TimedPath, bounds: Bounds) -> Timed:
    """Return axis angles with the least time off a path.

    Slews keep out of the cones if there is a way.  Otherwise they are as if there were none.

    Args:
        gimbal: the gimbal; its :attr:`~.Gimbal.on_target` says what counts as off the path.
        path: the path.
        bounds: limits of the plan.

    Raises:
        LimitError: no slew keeps the limits of the axes.
        PlanError: the axes cannot follow.
        StartError: the path does not begin at the given angles.
    """
    direct = found = _within_limits(gimbal, path, bounds, None)
    if direct is None:
        raise PlanError(
            "the axes can neither follow the path nor rejoin it after a slew; give it more time"
        )
    for clearance in path.keep_out if len(gimbal.axes) == _PLANE else ():
        for reserve in (0.0, *_RESERVES):
            if reserve:
                begin = direct.lead * bounds.period
                obstacles = Obstacles(clearance, reserve, begin)
                found = _within_limits(gimbal, path, bounds, obstacles)
            if found is None:
                break
            if _is_clear(gimbal, path, found, clearance, bounds.period):
                return found
    return direct


def _within_limits(
    gimbal: Gimbal, path: TimedPath, bounds: Bounds, obstacles: Obstacles | None
) -> Timed | None:
    """Return axis angles that keep the limits of the axes and the tool; ``None`` without a way."""
    shares = np.ones(len(KINDS))
    limits = np.array([(one.velocity, one.acceleration, one.jerk) for one in bounds.axes]).T
    for _ in range(_ATTEMPTS):
        axes = _usable(bounds, shares)
        found = _attempt(gimbal, path, bounds, axes, obstacles)
        if found is None:
            return None
        past = path.past if len(path.past) else np.repeat(found.joints[:1], 3, axis=0)
        sizes = np.abs(rates(found.joints, bounds.period, past))
        excess = np.max(sizes / limits[:, None], axis=(1, 2))
        tool = bounds.tool.excess(orientations(gimbal, found.joints), bounds.period)
        excess = np.maximum(excess, tool ** np.arange(1.0, len(KINDS) + 1.0))
        if np.max(excess) <= 1.0:
            break
        # A limit that is kept need not be lower: a lower velocity would lose time.
        shares *= np.where(excess > 1.0, np.maximum(_SLOWER / excess, _SLOWEST), 1.0)
    return found


def _is_clear(
    gimbal: Gimbal, path: TimedPath, found: Timed, clearance: Clearance, period: float
) -> bool:
    """Return whether the axes are outside of the cones wherever the path is."""
    times = period * np.arange(len(found.joints), dtype=np.float64)
    made = clearance(orientations(gimbal, found.joints), times) >= 0.0
    followed = slice(found.lead, found.lead + len(path.q))
    made[followed] |= clearance(path.q, times[followed]) < _OUTSIDE
    return bool(np.all(made))


def _usable(bounds: Bounds, shares: Floats) -> list[AxisLimits]:
    """Return the limits of the axes for lines and slews; they keep those of the tool too.

    Args:
        bounds: limits of the plan.
        shares: usable shares of velocity, acceleration and jerk, shape ``(3,)``.
    """
    tool, (speed, force, jerk) = bounds.tool, shares.tolist()
    return [
        axis._replace(
            velocity=speed * min(_SPEED_SHARE * axis.velocity, _TOOL_SHARE * tool.velocity),
            acceleration=force * min(axis.acceleration, _TOOL_SHARE * tool.acceleration),
            jerk=jerk * min(axis.jerk, _TOOL_SHARE * tool.jerk),
        )
        for axis in bounds.axes
    ]


def _attempt(
    gimbal: Gimbal,
    path: TimedPath,
    bounds: Bounds,
    axes: Sequence[AxisLimits],
    obstacles: Obstacles | None,
) -> Timed | None:
    start, period = path.start, bounds.period
    near = np.array(gimbal.home()) if start is None else start
    sky = lines_of(gimbal, path.q, period, axes, gimbal.on_target, near=near)
    if not sky.lines:
        branches = np.array(gimbal.solutions(row_of(path.q[0])))
        refuse_angle(wrapped(branches), gimbal.axes, 0.0)
    entry = _entry(sky, path, axes)
    if not np.any(np.isfinite(entry)):
        raise StartError(
            "the path does not begin at the axis angles the gimbal is commanded to be at"
        )
    search = Crossings(sky, period, axes, gimbal.on_target, path.counts)
    while np.any(np.isfinite(entry)):
        laid = partial(_laid, gimbal, sky, period=period, axes=axes)
        if obstacles is None:
            plan = search.best(entry)
        else:
            plan = around(gimbal, sky, obstacles, laid, search, entry, period=period, axes=axes)
        if plan is None:
            return None
        joints = laid(plan)
        before = joints[:0]
        if path.has_lead_in:
            way = partial(_lead_around, gimbal, obstacles, axes)
            found = _lead_in(joints, joints[0] if start is None else start, period, axes, way)
            if found is None:
                # Another line may be reached.
                entry[plan.line] = np.inf
                continue
            before = found
        rest = width(axes, period)
        joints = np.concatenate([before, joints, np.repeat(joints[-1:], rest, axis=0)])
        return Timed(rounded(joints, axes, period), len(before), rest, obstacles is not None)
    return None


def _entry(sky: Sky, path: TimedPath, axes: Sequence[AxisLimits]) -> Floats:
    """Return the cost of beginning on each line."""
    if path.start is None:
        return np.zeros(len(sky.lines))
    speed = np.array([axis.velocity for axis in axes])
    gaps = np.array([np.abs(line.joints[0] - path.start) for line in sky.lines])
    if path.has_lead_in:
        return np.asarray(_ENTRY * np.max(gaps / speed, axis=1), dtype=np.float64)
    return np.where(np.max(gaps, axis=1) < SAME, 0.0, np.inf)


def _laid(
    gimbal: Gimbal, sky: Sky, plan: Chain, *, period: float, axes: Sequence[AxisLimits]
) -> Floats:
    """Return the axis angles of a chain, with corners."""
    joints = sky.lines[plan.line].joints.copy()
    for crossing in plan.crossings:
        first, last = crossing.first, crossing.last
        goal = sky.lines[crossing.goal].joints
        joints[last:] = goal[last:]
        joints[first : last + 1] = _crossed(gimbal, sky, crossing, period=period, axes=axes)
    return joints


def _crossed(
    gimbal: Gimbal, sky: Sky, crossing: Crossing, *, period: float, axes: Sequence[AxisLimits]
) -> Floats:
    """Return the axis angles of a slew: the outer axis at an even rate, the others at their best.

    If the inner axes are too slow for the best angles, they stay on their line or turn evenly.
    Between corners all axes turn evenly.
    """
    first, last = crossing.first, crossing.last
    origin, goal = (sky.lines[place].joints for place in (crossing.origin, crossing.goal))
    if crossing.via is not None:
        corners = np.stack([origin[first], *crossing.via, goal[last]])
        speed = np.array([axis.velocity for axis in axes])
        needed = np.max(np.abs(np.diff(corners, axis=0)) / speed, axis=1)
        passed = np.concatenate([[0.0], np.cumsum(needed)]) / np.sum(needed)
        share = np.linspace(0.0, 1.0, last - first + 1)
        return np.stack([np.interp(share, passed, column) for column in corners.T], axis=1)
    outer = np.linspace(origin[first, 0], goal[last, 0], last - first + 1)
    best = joints_at(gimbal, sky.matrix[:, first : last + 1], outer)
    best[:, 1:] = np.unwrap(best[:, 1:], axis=0)
    best[:, 1:] += 2.0 * np.pi * np.round((origin[first, 1:] - best[0, 1:]) / (2.0 * np.pi))
    low, high = np.array([(axis.low, axis.high) for axis in axes]).T
    best = np.clip(best, low, high)
    if np.max(np.abs(best[-1] - goal[last])) < _SAME_LINE and _is_slow(best, axes, period):
        return best
    best[:, 1:] = np.linspace(origin[first, 1:], goal[last, 1:], len(best))
    if np.max(np.abs(origin[last, 1:] - goal[last, 1:])) < _SAME_LINE:
        best[:, 1:] = origin[first : last + 1, 1:]
    return best


def _is_slow(joints: Floats, axes: Sequence[AxisLimits], period: float) -> bool:
    """Return whether the axes can make a part of a path, its corners rounded."""
    if len(joints) < _FEWEST:
        return True
    speed, force = np.array([(axis.velocity, axis.acceleration) for axis in axes]).T
    steps = np.diff(rounded(joints, axes, period), axis=0)
    is_slow = np.all(np.abs(steps) <= speed * period * (1.0 + _ROUNDING))
    return bool(is_slow and np.all(np.abs(np.diff(steps, axis=0)) <= force * period**2))


def _lead_in(
    joints: Floats,
    start: Floats,
    period: float,
    axes: Sequence[AxisLimits],
    way: Callable[[Floats, Floats], Floats | None],
) -> Floats | None:
    """Return the axis angles before a path: at rest, slewing, and then at the rate of the path.

    *way* returns the corners of the slew from one place to another, ``None`` if there is no way.
    """
    low, high, speed = np.array([(axis.low, axis.high, axis.velocity) for axis in axes]).T
    count = width(axes, period)
    rate = joints[1] - joints[0]
    run_up = np.clip(joints[0] - rate * np.arange(count, 0, -1.0)[:, None], low, high)
    via = way(start, run_up[0])
    if via is None:
        return None
    slew = [start[None]]
    for goal in (*via, run_up[0]):
        here = slew[-1][-1]
        steps = math.ceil(float(np.max(np.abs(goal - here) / (speed * period)))) + 1
        slew.append(np.linspace(here, goal, steps + 1)[1:])
    held = np.repeat(start[None], count, axis=0)
    return np.concatenate([held, *slew[:-1], slew[-1][:-1], run_up])


def _lead_around(
    gimbal: Gimbal,
    obstacles: Obstacles | None,
    axes: Sequence[AxisLimits],
    start: Floats,
    goal: Floats,
) -> Floats | None:
    """Return the corners of the slew before a path."""
    if obstacles is None:
        return np.empty((0, len(axes)))
    return way_between(gimbal, start, goal, obstacles, axes=axes, times=np.zeros(2))
