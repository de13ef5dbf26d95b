"""Stops on a gimbal's path: the path slows down, the axes slew at rest, the path goes on.

Everything here has continuous acceleration: quintic ramps of the path's time, quintic slews.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from orientd.driver import AxisLimits
from orientd.errors import PlanError
from orientd.mechanism.arrays import orientations
from orientd.mechanism.gimbal import Gimbal
from orientd.mechanism.joint_path import UNLIMITED, ToolLimits
from orientd.mechanism.timing import quintic, ramp_times, run_through
from orientd.rotation import Floats, angle

_RAMP = 0.5
"""How long the path takes to stop at least, s."""
_RAMP_SHARE = 0.5
"""Share of the tool's acceleration that a stop may take beside what the path itself needs."""
_PEAK_SPEED = 1.875
"""Of the quintic from rest to rest, in lengths a duration."""
_PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)
"""Of the same, in lengths a squared duration."""
_CRAWL_STEPS = 8.0
"""Up to so many times what an axis can turn in a sample, a step is a path that is too fast."""
_ATTEMPTS = 40
_RESERVE = 0.97
"""Share of the fastest slew that keeps the tool's limits; the rest is for stops on it."""
TILT = math.radians(2.0)
"""How far off the pole the tool is tilted to turn the outer axis there."""


@dataclass(frozen=True, slots=True)
class Slew:
    """A stop of the path in which the axes change branch or unwind.

    Or a stretch of it that is gone along slowly, from rest to rest, because an axis would have to
    hurry too much: then the path is not left.

    Attributes:
        start: s.
        end: s.
        before: axis angles, rad.
        after: axis angles, rad.
        is_on_path: whether the path is gone along slowly instead of being left.
        error: the largest angle by which the path is missed in it, rad.
    """

    start: float
    end: float
    before: tuple[float, ...]
    after: tuple[float, ...]
    is_on_path: bool = False
    error: float = 0.0

    @property
    def duration(self) -> float:
        """How long it lasts, s."""
        return self.end - self.start

    def off_by(self, error: float) -> Slew:
        """Return the same slew with another *error*."""
        return replace(self, error=error)


class Stopped(NamedTuple):
    """A path with stops, on a uniform grid.

    Attributes:
        joints: rad, shape ``(n, axes)``.
        path_times: where the path is, in its own time, s, shape ``(n,)``.
        slews: in order.
    """

    joints: Floats
    path_times: Floats
    slews: tuple[Slew, ...]


def slew_duration(before: Floats, after: Floats, limits: Sequence[AxisLimits]) -> float:
    """Return how long the quintic slew between two sets of axis angles takes at least, s."""
    return float(slew_times(np.abs(after - before)[None], limits)[0])


def slew_times(gaps: Floats, limits: Sequence[AxisLimits], tool: ToolLimits = UNLIMITED) -> Floats:
    """Return how long quintic slews over *gaps* take at least, s.

    Args:
        gaps: of the axis angles, rad, shape ``(n, axes)``.
        limits: of every axis.
        tool: what it keeps to; every axis turns it as quickly as itself.
    """
    speed = np.array([min(limit.velocity, tool.velocity) for limit in limits])
    force = np.array([min(limit.acceleration, tool.acceleration) for limit in limits])
    by_axis = np.maximum(_PEAK_SPEED * gaps / speed, np.sqrt(_PEAK_ACCELERATION * gaps / force))
    return np.asarray(np.max(by_axis, axis=-1), dtype=np.float64)


def stop_time(q: Floats, period: float, tool: ToolLimits) -> float:
    """Return how long a path of orientations should take to stop, wherever that is, s."""
    if len(q) < 2:
        return _RAMP
    fastest = float(np.max(angle(q[:-1], q[1:]))) / period
    return max(_RAMP, _PEAK_SPEED * fastest / (_RAMP_SHARE * tool.acceleration))


def _slew(
    gimbal: Gimbal,
    here: Floats,
    there: Floats,
    period: float,
    limits: Sequence[AxisLimits],
    tool: ToolLimits,
) -> Floats:
    """Return axis angles between *here* and *there*, as quick as the axes and the tool allow.

    At the pole itself an orientation says nothing of the outer angle, so the tool is tilted off it
    meanwhile: the driver would not see the axes turn.
    """
    tilt = np.zeros_like(here)
    if _is_at_pole(gimbal, here):
        middle = limits[1]
        tilt[1] = math.copysign(TILT, (middle.low + middle.high) / 2 - here[1])
    seconds = slew_duration(here, there, limits) + slew_duration(np.zeros_like(tilt), tilt, limits)
    speed = np.array([limit.velocity for limit in limits]) * period
    bend = np.array([limit.acceleration for limit in limits]) * period**2
    for _ in range(_ATTEMPTS):
        count = max(1, math.ceil(seconds / period))
        share = np.arange(count + 1) / count
        angles: Floats = here + quintic(share)[:, None] * (there - here)
        angles += (64.0 * (share * (1.0 - share)) ** 3)[:, None] * tilt
        held = np.concatenate([angles[:1], angles, angles[-1:]])
        more = max(
            _excess(gimbal, angles, period, tool),
            float(np.max(np.abs(np.diff(angles, axis=0)) / speed)),
            math.sqrt(float(np.max(np.abs(np.diff(held, 2, axis=0)) / bend))),
        )
        if more <= 1.0:
            break
        seconds = count * period * max(more, 1.01)
    return angles[1:-1]


def _clock(length: float, ramp: float, *, is_left: bool, is_right: bool, period: float) -> Floats:
    """Return path times, from 0 to *length*, of a stretch between stops, sampled every period."""
    if not (is_left or is_right):
        return period * np.arange(round(length / period) + 1, dtype=np.float64)
    ends = is_left + is_right
    if length < ramp / 2 * ends:
        # Too short to reach full speed: once from rest to rest, no faster than the path itself.
        need = max(_PEAK_SPEED * length, np.sqrt(_PEAK_ACCELERATION * length * ramp / _PEAK_SPEED))
        count = max(1, int(np.ceil(need / period)))
        return length * quintic(np.arange(count + 1) / count)
    total = length + ramp / 2 * ends
    count = int(np.ceil(total / period))
    elapsed = np.minimum(np.arange(count + 1) * period, total)
    if is_left and is_right:
        forward = ramp_times(elapsed, ramp)
        backward = length - ramp_times(total - elapsed, ramp)
        return np.where(elapsed < total / 2, forward, backward)
    if is_left:
        return np.minimum(length, ramp_times(elapsed, ramp))
    way: Floats = length - ramp_times(total - elapsed, ramp)
    return way


def _between(grid_values: Floats, at: Floats) -> Floats:
    """Return values between samples by cubic Hermite segments with central differences.

    Args:
        grid_values: shape ``(n, axes)``, one sample apart.
        at: where, in samples, shape ``(m,)``.
    """
    count = len(grid_values)
    if count == 1:
        return np.repeat(grid_values, len(at), axis=0)
    slopes = np.gradient(grid_values, axis=0)
    left = np.clip(np.floor(at).astype(int), 0, count - 2)
    u = (at - left)[:, None]
    p, q = grid_values[left], grid_values[left + 1]
    m, n = slopes[left], slopes[left + 1]
    way = u * u * (3 - 2 * u)
    values: Floats = p + way * (q - p) + u * (1 - u) * ((1 - u) * m - u * n)
    return values


def _crawl(
    gimbal: Gimbal, part: Floats, period: float, limits: Sequence[AxisLimits], tool: ToolLimits
) -> tuple[Floats, Floats]:
    """Return axis angles, and where in *part* they are, of going along it from rest to rest."""
    speed = np.array([limit.velocity for limit in limits]) * period
    # Each sample takes as long as the slowest axis needs on either side, no less than on the path.
    spans = np.maximum(1.0, np.max(np.abs(np.diff(part, axis=0)) / speed, axis=1))
    slow = np.maximum(np.concatenate([spans[:1], spans]), np.concatenate([spans, spans[-1:]]))
    lasts = float(np.sum(slow[1:] + slow[:-1])) / 2.0
    count = max(2, math.ceil(_PEAK_SPEED * lasts))
    most = np.array([limit.acceleration for limit in limits]) * period * period
    for _ in range(_ATTEMPTS):
        at = run_through(slow, lasts * quintic(np.arange(count + 1) / count))
        angles = _between(part, at)
        change = np.abs(np.diff(angles, axis=0))
        bend = np.abs(np.diff(angles, n=2, axis=0))
        is_slow = np.all(change <= speed) and np.all(bend <= most)
        if is_slow and _excess(gimbal, angles, period, tool) <= 1.0:
            break
        count = math.ceil(count * 1.2)
    return angles, at


def _excess(gimbal: Gimbal, joints: Floats, period: float, tool: ToolLimits) -> float:
    """Return how much longer axis angles must take for the tool to keep its limits."""
    return tool.excess(orientations(gimbal, joints), period) / _RESERVE


def _is_at_pole(gimbal: Gimbal, joints: Floats) -> bool:
    return gimbal.is_at_pole(gimbal.orientation(tuple(joints.tolist())))


def _events(
    gimbal: Gimbal,
    angles: Floats,
    period: float,
    slews: Sequence[int],
    limits: Sequence[AxisLimits],
    ramp: float,
) -> list[tuple[int, int, bool]]:
    """Return ``(last before, first after, whether it is a crawl)`` of each stop.

    A step that is a little too far belongs to a path that is too fast there, and neighbours of it
    are one stretch to be gone along slowly; a large one is a change of branch or turn.  At the pole
    it is a turn of the outer axis.
    """
    speed = np.array([limit.velocity for limit in limits]) * period
    found: list[tuple[int, int, bool]] = []
    for k in slews:
        is_small = bool(np.max(np.abs(angles[k] - angles[k - 1]) / speed) <= _CRAWL_STEPS)
        is_crawl = is_small and not _is_at_pole(gimbal, angles[k - 1])
        if is_crawl and found and found[-1][2] and (k - 1 - found[-1][1]) * period < 2 * ramp:
            found[-1] = (found[-1][0], k, True)
        else:
            found.append((k - 1, k, is_crawl))
    return found


def with_stops(
    gimbal: Gimbal,
    angles: Floats,
    period: float,
    slews: Sequence[int],
    limits: Sequence[AxisLimits],
    *,
    tool: ToolLimits = UNLIMITED,
    ramp: float = _RAMP,
    is_moving: bool = False,
) -> Stopped:
    """Return a path that stops before each sample of *slews* and slews to it.

    Args:
        gimbal: whose.
        angles: rad, shape ``(n, axes)``, with a jump before each of *slews*.
        period: s.
        slews: indices.
        limits: of every axis.
        tool: what it keeps to on a slew.
        ramp: how long the path takes to stop, s.
        is_moving: whether the path begins in motion.

    Raises:
        PlanError: it does, and would have to stop sooner than it can.
    """
    pieces: list[Floats] = []
    path_pieces: list[Floats] = []
    found: list[Slew] = []
    events = _events(gimbal, angles, period, slews, limits, ramp)
    room = (events[0][0] if events else len(angles)) * period
    if events and is_moving and room < ramp / 2:
        raise PlanError(
            f"the axes would have to stop for a change of branch {room:.3f} s on, and the path "
            f"needs {ramp / 2:g} s to stop; stop first"
        )
    bounds = [(-1, 0, False), *events, (len(angles) - 1, len(angles), False)]
    elapsed = 0
    for number, ((_, first, _), (last, after, is_crawl)) in enumerate(pairwise(bounds)):
        part = angles[first : last + 1]
        clock = _clock(
            (len(part) - 1) * period, ramp, is_left=number > 0,
            is_right=number < len(events), period=period,
        )  # fmt: skip
        is_plain = len(clock) == len(part) and not events
        pieces.append(part if is_plain else _between(part, clock / period))
        path_pieces.append(first * period + clock)
        elapsed += len(clock)
        if number == len(events):
            break
        if is_crawl:
            inside, at = _crawl(gimbal, angles[last : after + 1], period, limits, tool)
            inside, path_times = inside[1:-1], (last + at[1:-1]) * period
        else:
            here, there = angles[last], angles[after]
            inside = _slew(gimbal, here, there, period, limits, tool)
            path_times = np.full(len(inside), last * period)
        pieces.append(inside)
        path_pieces.append(path_times)
        start = (elapsed - 1) * period
        found.append(
            Slew(start, start + (len(inside) + 1) * period, tuple(map(float, angles[last])),
                 tuple(map(float, angles[after])), is_crawl)
        )  # fmt: skip
        elapsed += len(inside)
    # Where two pieces meet, the same time is calculated in two ways.
    path_times = np.maximum.accumulate(np.concatenate(path_pieces))
    return Stopped(np.concatenate(pieces), path_times, tuple(found))
