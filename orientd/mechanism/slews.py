"""Stops on a gimbal's path: the path slows down, the axes slew at rest, the path continues.

All motions in this module have continuous acceleration.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from orientd.curves.quintic import smooth_step
from orientd.driver import AxisLimits
from orientd.errors import PlanError
from orientd.kernels import solve_banded
from orientd.mechanism.arrays import orientations
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.joint_path import Bounds, ToolLimits, axis_peaks, excess_of
from orientd.mechanism.timing import calmed, ramp_times, run_through
from orientd.rotation import Floats, angle, conjugate, log, multiply

_RAMP = 0.5
"""Least time of a stop, s."""
_RAMP_SHARE = 0.5
"""Share of the tool's acceleration that a stop may add to the acceleration of the path."""
_FASTEST, _HARDEST = 1.875, 5.7735
"""Largest slope and curvature of the quintic from 0 to 1."""
_CRAWL_STEPS = 8.0
"""Steps up to this many times an axis' largest step count as a path that is too fast."""
_FINER = 8
"""Steps between two samples of a slow section, for a smooth pace."""
_ATTEMPTS = 40
_SLOWER = 1.005
"""Least factor by which a slew that exceeds a limit is made longer."""
_LEAST_PERIODS = 3
"""Periods in which the acceleration of a slew changes at least."""
_RESERVE = 0.97
"""Share of the fastest slew that keeps the tool's limits; the rest is for stops on it."""
_UNLIMITED = 1e12
_POINTS, _STEP = 129, 0.05
"""Steps at which the turn of the tool is checked, plus one for each such step of an axis, rad."""


@dataclass(frozen=True, slots=True)
class Slew:
    """A stop of the path in which the axes change branch or unwind.

    It may also be a slow section of the path, from rest to rest, because an axis is too slow for
    it. The axes then stay on the path.

    Attributes:
        start: s.
        end: s.
        before: axis angles, rad.
        after: axis angles, rad.
        is_on_path: whether this is a slow section, on the path.
        error: largest deviation from the path, rad.
    """

    start: float
    end: float
    before: tuple[float, ...]
    after: tuple[float, ...]
    is_on_path: bool = False
    error: float = 0.0

    @property
    def duration(self) -> float:
        """Duration, s."""
        return self.end - self.start


class Stopped(NamedTuple):
    """A path with stops, on a uniform grid.

    Attributes:
        joints: rad, shape ``(n, axes)``.
        path_times: time of each sample on the path, s, shape ``(n,)``.
        slews: in order.
    """

    joints: Floats
    path_times: Floats
    slews: tuple[Slew, ...]


def slew_times(gaps: Floats, bounds: Bounds) -> Floats:
    """Return the approximate duration of slews over *gaps*, s.

    Args:
        gaps: of the axis angles, rad, shape ``(n, axes)``.
        bounds: limits of the plan.
    """
    # The axes turn the tool by at most the sum of their angles.
    columns = [*np.moveaxis(gaps, -1, 0), np.sum(gaps, axis=-1)]
    all_of_them: tuple[AxisLimits | ToolLimits, ...] = (*bounds.axes, bounds.tool)
    longest: Floats = np.zeros(gaps.shape[:-1])
    for gap, one in zip(columns, all_of_them, strict=True):
        speed, force = min(one.velocity, _UNLIMITED), min(one.acceleration, _UNLIMITED)
        ramp = _FASTEST * speed / force
        # A short distance, without a phase at full speed, is two ramps.
        is_long = gap > ramp * speed
        lasts = np.where(is_long, gap / speed + ramp, 2.0 * np.sqrt(_FASTEST * gap / force))
        longest = np.maximum(longest, lasts)
    return longest


def stop_time(q: Floats, bounds: Bounds) -> float:
    """Return a suitable duration for a stop anywhere on a path of orientations, s."""
    if len(q) < 2:
        return _RAMP
    fastest = float(np.max(angle(q[:-1], q[1:]))) / bounds.period
    return max(_RAMP, _FASTEST * fastest / (_RAMP_SHARE * bounds.tool.acceleration))


def straight(
    gimbal: Gimbal, here: Floats, there: Floats, bounds: Bounds, *, least: float = 0.0
) -> Floats:
    """Return the fastest joint motion of all axes from rest to rest within the limits.

    Args:
        gimbal: the gimbal.
        here: axis angles at the first sample, rad, shape ``(axes,)``.
        there: axis angles at the last sample.
        bounds: limits of the plan.
        least: least duration, s.

    Returns:
        Axis angles, shape ``(n, axes)``.

    Raises:
        PlanError: no duration keeps the limits.
    """
    period, gap = bounds.period, there - here
    points = _POINTS + round(float(np.max(np.abs(gap))) / _STEP)
    shares = np.linspace(0.0, 1.0, points)
    speed, force, jerk = _rates(gimbal, here + shares[:, None] * gap, bounds)
    stretch = 1.0
    for _ in range(_ATTEMPTS):
        boxes = _double_s(speed / stretch, force / stretch**2, jerk / stretch**3, period)
        count = math.ceil(max(float(boxes.sum()), least, 2.0 * period) / period - 1e-9)
        elapsed = period * np.arange(count + 1, dtype=np.float64)
        gone = _progress(elapsed, boxes * (elapsed[-1] / boxes.sum()))
        joints: Floats = here + gone[:, None] * gap
        joints[0], joints[-1] = here, there
        more = _excess(gimbal, joints, bounds)
        if more <= 1.0:
            return joints
        stretch *= max(more, _SLOWER)
    raise PlanError("no slew of the axes keeps the limits of the tool")


def _rates(gimbal: Gimbal, joints: Floats, bounds: Bounds) -> tuple[float, float, float]:
    """Return velocity, acceleration and jerk of a distance of 1 that keep all limits, or nearly."""
    axes, tool = bounds.axes, bounds.tool
    step = 1.0 / (len(joints) - 1)
    slope = np.max(np.abs(np.diff(joints, axis=0)), axis=0) / step
    q = orientations(gimbal, joints)
    turn = float(np.max(np.linalg.norm(log(multiply(conjugate(q[:-1]), q[1:])), axis=1))) / step
    slopes = np.maximum([*slope, turn], 1e-12)
    velocity = float(np.min([*(one.velocity for one in axes), tool.velocity] / slopes))
    force = float(np.min([*(one.acceleration for one in axes), tool.acceleration] / slopes))
    jerk = float(np.min([*(one.jerk for one in axes), tool.jerk] / slopes))
    return velocity, force, jerk


def _double_s(speed: float, force: float, jerk: float, period: float) -> Floats:
    """Return the widths of three boxes whose convolution covers a distance of 1 soonest, s.

    That is the double S: velocity, acceleration and jerk are at most the inverses of the running
    products of the widths.  The last box is at least some periods wide, and so continuous.
    """
    least = _LEAST_PERIODS * period
    first, second, third = 1.0 / speed, speed / force, max(force / jerk, least)
    if second > first:
        # It never reaches its velocity.
        first = second = 1.0 / math.sqrt(force)
        third = max(1.0 / (jerk * first * second), least)
    if third > second and third > least:
        # It never reaches its acceleration.
        second = third = math.sqrt(1.0 / (jerk * first))
        if second > first:
            first = second = third = 1.0 / math.cbrt(jerk)
    return np.array([first, max(second, least), max(third, least)])


def _progress(times: Floats, boxes: Floats) -> Floats:
    """Return the integral of the convolution of three boxes of area 1 at *times*, from 0 to 1."""
    total = np.zeros(len(times))
    for chosen in product((0, 1), repeat=3):
        begin = float(np.dot(chosen, boxes))
        total += (-1) ** sum(chosen) * np.maximum(times - begin, 0.0) ** 3
    gone: Floats = np.clip(total / (6.0 * np.prod(boxes)), 0.0, 1.0)
    return gone


def _excess(gimbal: Gimbal, joints: Floats, bounds: Bounds) -> float:
    """Return the factor by which a motion from rest to rest must take longer to keep all limits."""
    period, axes, tool = bounds
    held = np.concatenate([joints, joints[-1:], joints[-1:]])
    by_axes = excess_of(axis_peaks(held, period, axes, np.repeat(joints[:1], 3, axis=0)))
    return max(by_axes, tool.excess(orientations(gimbal, joints), period) / _RESERVE)


def with_stops(
    gimbal: Gimbal,
    joints: Floats,
    slews: Sequence[int],
    bounds: Bounds,
    *,
    ramp: float = _RAMP,
    is_moving: bool = False,
) -> Stopped:
    """Return a path that stops before each sample of *slews* and slews to it.

    Args:
        gimbal: the gimbal.
        joints: rad, shape ``(n, axes)``, with a jump before each of *slews*.
        slews: indices.
        bounds: limits of the plan.
        ramp: duration of a stop, s.
        is_moving: whether the path begins in motion.

    Raises:
        PlanError: the path begins in motion and would have to stop sooner than it can.
    """
    period = bounds.period
    events = _events(gimbal, joints, slews, bounds, ramp)
    if not events:
        return Stopped(joints, period * np.arange(len(joints), dtype=np.float64), ())
    room = events[0][0] * period
    if is_moving and room < ramp / 2:
        raise PlanError(
            f"the axes would have to stop for a change of branch {room:.3f} s on, and the path "
            f"needs {ramp / 2:g} s to stop; stop first"
        )
    pieces: list[Floats] = []
    path_pieces: list[Floats] = []
    found: list[Slew] = []
    parts = [(-1, 0, False), *events, (len(joints) - 1, len(joints), False)]
    for number, ((_, first, _), (last, after, is_crawl)) in enumerate(pairwise(parts)):
        ends = number > 0, number < len(events)
        clock = _clock((last - first) * period, ramp, period, *ends)
        pieces.append(_between(joints[first : last + 1], clock / period))
        path_pieces.append(first * period + clock)
        if number == len(events):
            break
        if is_crawl:
            inside, at = _crawl(gimbal, joints[last : after + 1], bounds)
            path_times = (last + at[1:-1]) * period
        else:
            inside = straight(gimbal, joints[last], joints[after], bounds)
            path_times = np.full(len(inside) - 2, last * period)
        start = (sum(map(len, pieces)) - 1) * period
        before, then = tuple(joints[last].tolist()), tuple(joints[after].tolist())
        found.append(Slew(start, start + (len(inside) - 1) * period, before, then, is_crawl))
        pieces.append(inside[1:-1])
        path_pieces.append(path_times)
    # Where two pieces meet, the same time is computed twice.
    path_times = np.maximum.accumulate(np.concatenate(path_pieces))
    return Stopped(np.concatenate(pieces), path_times, tuple(found))


def _events(
    gimbal: Gimbal, joints: Floats, slews: Sequence[int], bounds: Bounds, ramp: float
) -> list[tuple[int, int, bool]]:
    """Return ``(last before, first after, whether it is a slow section)`` of each stop.

    A step that is slightly too large means that the path is too fast there, and neighbouring ones
    form one slow section.  A large step is a change of branch or turn.  At the pole it is a turn of
    the outer axis.
    """
    found: list[tuple[int, int, bool]] = []
    for k in slews:
        steps = np.abs(joints[k] - joints[k - 1]) / bounds.longest_step
        is_small = bool(np.max(steps) <= _CRAWL_STEPS)
        q = gimbal.orientation(tuple(joints[k - 1].tolist()))
        is_crawl = is_small and not gimbal.is_at_pole(q)
        if (
            is_crawl
            and found
            and found[-1][2]
            and (k - 1 - found[-1][1]) * bounds.period < 2 * ramp
        ):
            found[-1] = (found[-1][0], k, True)
        else:
            found.append((k - 1, k, is_crawl))
    return found


def _clock(length: float, ramp: float, period: float, is_left: bool, is_right: bool) -> Floats:
    """Return path times, from 0 to *length*, of a section between stops, sampled every period."""
    ends = is_left + is_right
    if length < ramp / 2 * ends:
        # Too short for full speed: once from rest to rest, no faster than the path itself.
        need = max(_FASTEST * length, math.sqrt(_HARDEST / _FASTEST * length * ramp))
        count = max(1, math.ceil(need / period))
        return length * smooth_step(np.arange(count + 1) / count)
    total = length + ramp / 2 * ends
    elapsed = np.minimum(np.arange(math.ceil(total / period) + 1) * period, total)
    forward = np.minimum(length, ramp_times(elapsed, ramp))
    backward: Floats = length - ramp_times(total - elapsed, ramp)
    if is_left and is_right:
        return np.where(elapsed < total / 2, forward, backward)
    return forward if is_left else backward


def _between(samples: Floats, at: Floats) -> Floats:
    """Return the natural cubic spline through samples at given places.

    Args:
        samples: shape ``(n, axes)``.
        at: places, in samples, shape ``(m,)``.
    """
    count = len(samples)
    if count == 1:
        return np.repeat(samples, len(at), axis=0)
    # A slope and its two neighbours make the second derivatives equal on both sides.
    slopes = np.diff(samples[[0, *range(count), -1]], axis=0)
    slopes = 3.0 * (slopes[1:] + slopes[:-1])
    band = np.repeat([[1.0], [4.0], [1.0]], count, axis=1)
    band[1, [0, -1]] = 2.0
    solve_banded(band, 1, 1, slopes)
    left = np.clip(np.floor(at).astype(int), 0, count - 2)
    u = (at - left)[:, None]
    p, q = samples[left], samples[left + 1]
    m, n = slopes[left], slopes[left + 1]
    values: Floats = p + u * u * (3 - 2 * u) * (q - p) + u * (1 - u) * ((1 - u) * m - u * n)
    return values


def _crawl(gimbal: Gimbal, part: Floats, bounds: Bounds) -> tuple[Floats, Floats]:
    """Return axis angles, and their places in *part*, for a slow section from rest to rest."""
    # Each step takes as long as its slowest axis needs, and at least as long as on the path.
    steps = _FINER * (len(part) - 1)
    fine = np.abs(np.diff(_between(part, np.arange(steps + 1) / _FINER), axis=0))
    pace = _FINER / np.maximum(1.0, np.max(_FINER * fine / bounds.longest_step, axis=1))
    pace = np.minimum(np.concatenate([pace[:1], pace]), np.concatenate([pace, pace[-1:]]))
    slow = 1.0 / calmed(pace, 2 * _FINER)
    lasts = float(np.sum(slow[1:] + slow[:-1])) / 2.0
    count = max(2, math.ceil(_FASTEST * lasts))
    for _ in range(_ATTEMPTS):
        at = run_through(slow, lasts * smooth_step(np.arange(count + 1) / count)) / _FINER
        joints = _between(part, at)
        if _excess(gimbal, joints, bounds) <= 1.0:
            break
        count = math.ceil(count * 1.2)
    return joints, at
