"""Axis angles of a gimbal for a path whose times are fixed: least time off it, told beforehand.

The path does not wait for the axes.  Where they cannot follow, they leave it early, slew at full
rate, and rejoin it (:mod:`orientd.mechanism.schedule`).  Corners between lines and slews are
rounded, so that acceleration is continuous.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from orientd.driver import AxisLimits
from orientd.errors import PlanError, StartError
from orientd.mechanism.arrays import joints_at, orientations, wrapped
from orientd.mechanism.figure import Figure
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.gimbal_route import error_along, manipulability, refuse_angle, row_of
from orientd.mechanism.joint_path import (
    Bounds,
    JointPath,
    axis_peaks,
    certified,
    excess_of,
    losses_of,
    refuse_rates,
)
from orientd.mechanism.lines import Bools, Sky, lines_of
from orientd.mechanism.pole import smooth
from orientd.mechanism.schedule import Crossing, Schedule, scheduled
from orientd.mechanism.timing import quintic
from orientd.rotation import Floats

SAME = 1e-3
"""Largest distance of the path's start from the given angles, rad."""
_SPEED_SHARE = 0.997
"""Usable share of an axis' velocity: between two records it is faster."""
_TOOL_SHARE = 0.9
"""Usable share of the tool's limits: all axes turn it at once."""
_ENTRY = 1e-3
"""Cost of a second of the lead-in, in seconds lost."""
_CORNER = 0.5
"""Share of the acceleration limit from which a bend is rounded."""
_LEAST_ROUNDING = 2
_SAME_LINE = 1e-6
_FEWEST = 5
_ROUNDING = 1e-9
_ATTEMPTS = 6
_SLOWER = 0.9
_ADVICE = "give the pass more time, or begin it elsewhere"


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
    """

    q: Floats
    counts: Bools
    start: Floats | None
    past: Floats
    has_lead_in: bool


class Timed(NamedTuple):
    """A path at fixed times, with its lead-in.

    Attributes:
        joints: rad, shape ``(n, axes)``.
        lead: number of samples before the first one of the path.
        rest: number of samples after the last one of the path.
    """

    joints: Floats
    lead: int
    rest: int


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
    period, axes = bounds.period, gimbal.axes
    joints, lead, rest = timed_joints(gimbal, path, bounds)
    count = len(path.q)
    reached = orientations(gimbal, joints)
    times = period * np.arange(-lead, count, dtype=np.float64)
    times = np.concatenate([times, np.repeat(times[-1:], rest)])
    followed = slice(lead, lead + count)
    off = np.where(path.counts, error_along(gimbal, path.q, reached[followed]), 0.0)
    losses = losses_of(np.concatenate([np.zeros(lead), off]), period, gimbal.on_target)
    before = path.past if len(path.past) else np.repeat(joints[:1], 3, axis=0)
    peaks = tuple(axis_peaks(joints, period, axes, before))
    refuse_rates(peaks, _ADVICE)
    held = np.where(off > gimbal.on_target, 0.0, off)
    at = int(np.argmax(held))
    figures = [
        Figure("pointing error", float(held[at]), "rad", gimbal.on_target, (lead + at) * period),
        Figure("time off target", sum(one.end - one.start for one in losses), "s"),
        manipulability(gimbal, joints),
    ]
    found = JointPath(period, joints, reached, times, losses=losses)
    return certified(found, peaks, figures), lead


def timed_joints(gimbal: Gimbal, path: TimedPath, bounds: Bounds) -> Timed:
    """Return axis angles with the least time off a path.

    Args:
        gimbal: the gimbal; its :attr:`~.Gimbal.on_target` says what counts as off the path.
        path: the path.
        bounds: limits of the plan.

    Raises:
        LimitError: no slew keeps the limits of the axes.
        PlanError: the axes cannot follow.
        StartError: the path does not begin at the given angles.
    """
    share = 1.0
    for _ in range(_ATTEMPTS):
        axes = _usable(bounds, share)
        found = _attempt(gimbal, path, bounds, axes)
        past = path.past if len(path.past) else np.repeat(found.joints[:1], 3, axis=0)
        excess = excess_of(axis_peaks(found.joints, bounds.period, bounds.axes, past))
        tool = bounds.tool.excess(orientations(gimbal, found.joints), bounds.period)
        if max(excess, tool) <= 1.0:
            break
        share *= max(_SLOWER / max(excess, tool), 0.5)
    return found


def _usable(bounds: Bounds, share: float) -> list[AxisLimits]:
    """Return the limits of the axes for lines and slews; they keep those of the tool too."""
    tool = bounds.tool
    return [
        axis._replace(
            velocity=share * min(_SPEED_SHARE * axis.velocity, _TOOL_SHARE * tool.velocity),
            acceleration=share**2 * min(axis.acceleration, _TOOL_SHARE * tool.acceleration),
            jerk=share**3 * min(axis.jerk, _TOOL_SHARE * tool.jerk),
        )
        for axis in bounds.axes
    ]


def _attempt(gimbal: Gimbal, path: TimedPath, bounds: Bounds, axes: Sequence[AxisLimits]) -> Timed:
    start = path.start
    near = np.array(gimbal.home()) if start is None else start
    sky = lines_of(gimbal, path.q, bounds.period, axes, gimbal.on_target, near=near)
    if not sky.lines:
        branches = np.array(gimbal.solutions(row_of(path.q[0])))
        refuse_angle(wrapped(branches), gimbal.axes, 0.0)
    entry = _entry(sky, path, axes)
    if not np.any(np.isfinite(entry)):
        raise StartError(
            "the path does not begin at the axis angles the gimbal is commanded to be at"
        )
    plan = scheduled(sky, bounds.period, axes, gimbal.on_target, counts=path.counts, entry=entry)
    if plan is None:
        raise PlanError(
            "the axes can neither follow the path nor rejoin it after a slew; give it more time"
        )
    joints = _laid(gimbal, sky, plan, bounds.period, axes)
    lead = 0
    if path.has_lead_in:
        before = _lead_in(joints, joints[0] if start is None else start, bounds.period, axes)
        lead = len(before)
        joints = np.concatenate([before, joints])
    rest = _width(axes, bounds.period)
    joints = np.concatenate([joints, np.repeat(joints[-1:], rest, axis=0)])
    return Timed(_rounded(joints, axes, bounds.period), lead, rest)


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
    gimbal: Gimbal, sky: Sky, plan: Schedule, period: float, axes: Sequence[AxisLimits]
) -> Floats:
    """Return the axis angles of a schedule, with corners."""
    joints = sky.lines[plan.line].joints.copy()
    for crossing in plan.crossings:
        first, last = crossing.first, crossing.last
        goal = sky.lines[crossing.goal].joints
        joints[last:] = goal[last:]
        joints[first : last + 1] = _crossed(gimbal, sky, crossing, period, axes)
    return joints


def _crossed(
    gimbal: Gimbal, sky: Sky, crossing: Crossing, period: float, axes: Sequence[AxisLimits]
) -> Floats:
    """Return the axis angles of a slew: the outer axis at an even rate, the others at their best.

    If the inner axes are too slow for the best angles, they stay on their line or turn evenly.
    """
    first, last = crossing.first, crossing.last
    origin, goal = (sky.lines[place].joints for place in (crossing.origin, crossing.goal))
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
    steps = np.diff(_rounded(joints, axes, period), axis=0)
    is_slow = np.all(np.abs(steps) <= speed * period * (1.0 + _ROUNDING))
    return bool(is_slow and np.all(np.abs(np.diff(steps, axis=0)) <= force * period**2))


def _lead_in(joints: Floats, start: Floats, period: float, axes: Sequence[AxisLimits]) -> Floats:
    """Return the axis angles before a path: at rest, slewing, and then at the rate of the path."""
    low, high, speed = np.array([(axis.low, axis.high, axis.velocity) for axis in axes]).T
    width = _width(axes, period)
    rate = joints[1] - joints[0]
    run_up = np.clip(joints[0] - rate * np.arange(width, 0, -1.0)[:, None], low, high)
    longest = float(np.max(np.abs(run_up[0] - start) / (speed * period)))
    slew = np.linspace(start, run_up[0], math.ceil(longest) + 2)
    return np.concatenate([np.repeat(slew[:1], width, axis=0), slew[:-1], run_up])


def _width(axes: Sequence[AxisLimits], period: float) -> int:
    """Return the samples to each side within which the largest corner is rounded."""
    wide = [_widths(2.0 * axis.velocity * period, axis, period) for axis in axes]
    return max(sum(one) for one in wide) + 1


def _widths(bend: float, axis: AxisLimits, period: float) -> tuple[int, int]:
    """Return the widths of both averages that round a corner of *bend* rad a sample."""
    force, jerk = axis.acceleration * period**2, axis.jerk * period**3
    first = math.ceil(0.5 * bend / force)
    second = max(_LEAST_ROUNDING, math.ceil(force / jerk) if math.isfinite(jerk) else 0)
    return first, second


def _rounded(joints: Floats, axes: Sequence[AxisLimits], period: float) -> Floats:
    """Return axis angles with rounded corners, unchanged away from them."""
    found = joints.copy()
    for place, axis in enumerate(axes):
        line = joints[:, place]
        bends = np.abs(np.diff(line, 2))
        corners = np.flatnonzero(bends > _CORNER * axis.acceleration * period**2) + 1
        for begin, end in _groups(corners, 2 * _width(axes, period)):
            bend = float(np.max(bends[begin - 1 : end]))
            first, second = _widths(bend, axis, period)
            reach = 2 * (first + second) + 2
            a, b = max(0, begin - reach), min(len(line), end + reach + 1)
            part = line[a:b]
            calm = smooth(smooth(part, first), second)
            fade = np.minimum(np.arange(b - a), np.arange(b - a)[::-1]) / max(1, first + second)
            found[a:b, place] = part + quintic(fade) * (calm - part)
    return found


def _groups(places: np.ndarray, apart: int) -> list[tuple[int, int]]:
    """Return first and last of each group of *places* that are at most *apart* from one another."""
    if not len(places):
        return []
    cuts = np.flatnonzero(np.diff(places) > apart)
    begins, ends = [0, *(cuts + 1).tolist()], [*cuts.tolist(), len(places) - 1]
    return [(int(places[a]), int(places[b])) for a, b in zip(begins, ends, strict=True)]
