"""Stops on a path: the path slows down, the axes slew at rest, the path goes on.

Everything here has continuous acceleration: quintic ramps of the path's clock, quintic slews.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from orientd.rotation.quaternion import Floats
from orientd_dynamixel.certificate import AxisLimits, Slew

_PEAK_SPEED = 1.875
"""Of the quintic from rest to rest, in lengths a duration."""
_PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)
"""Of the same, in lengths a squared duration."""


@dataclass(frozen=True)
class Timeline:
    """A path with stops.

    Attributes:
        times: s, uniform, shape ``(n,)``.
        angles: rad, shape ``(n, axes)``.
        path_times: where the path is, in its own time, s, shape ``(n,)``.
        is_slewing: whether the path stands still for a slew, shape ``(n,)``.
        slews: in order.
    """

    times: Floats
    angles: Floats
    path_times: Floats
    is_slewing: np.ndarray[tuple[int], np.dtype[np.bool_]]
    slews: tuple[Slew, ...]


def quintic(u: Floats) -> Floats:
    """Return the quintic from 0 to 1 that is at rest, with no acceleration, at both ends."""
    u = np.clip(u, 0.0, 1.0)
    return u * u * u * (10.0 + u * (6.0 * u - 15.0))


def slew_duration(before: Floats, after: Floats, limits: Sequence[AxisLimits]) -> float:
    """Return how long the quintic slew between two sets of axis angles takes at least, s."""
    needed = 0.0
    for gap, limit in zip(np.abs(after - before), limits, strict=True):
        needed = max(
            needed,
            _PEAK_SPEED * float(gap) / limit.velocity,
            math.sqrt(_PEAK_ACCELERATION * float(gap) / limit.acceleration),
        )
    return needed


def _ramp_times(elapsed: Floats, ramp: float) -> Floats:
    """Return the way of a clock whose speed rises from 0 to 1 as a quintic over *ramp* seconds."""
    u = np.clip(elapsed / ramp, 0.0, 1.0)
    # The integral of quintic(u).
    way: Floats = ramp * u**4 * (2.5 + u * (u - 3.0)) + np.maximum(0.0, elapsed - ramp)
    return way


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
        forward = _ramp_times(elapsed, ramp)
        backward = length - _ramp_times(total - elapsed, ramp)
        return np.where(elapsed < total / 2, forward, backward)
    if is_left:
        return np.minimum(length, _ramp_times(elapsed, ramp))
    way: Floats = length - _ramp_times(total - elapsed, ramp)
    return way


def with_stops(
    angles: Floats,
    period: float,
    slews: Sequence[int],
    limits: Sequence[AxisLimits],
    *,
    ramp: float = 0.5,
) -> Timeline:
    """Return a path that stops before each sample of *slews* and slews to it.

    Args:
        angles: rad, shape ``(n, axes)``, with a jump before each of *slews*.
        period: s.
        slews: indices.
        limits: of every axis.
        ramp: how long the path takes to stop, s.
    """
    pieces: list[Floats] = []
    path_pieces: list[Floats] = []
    slewing: list[bool] = []
    found: list[Slew] = []
    bounds = [0, *slews, len(angles)]
    elapsed = 0
    for number, (first, last) in enumerate(pairwise(bounds)):
        part = angles[first:last]
        clock = _clock(
            (len(part) - 1) * period, ramp, is_left=number > 0,
            is_right=number < len(slews), period=period,
        )  # fmt: skip
        grid = np.arange(len(part)) * period
        pieces.append(
            np.stack([np.interp(clock, grid, part[:, a]) for a in range(part.shape[1])], axis=1)
        )
        path_pieces.append(first * period + clock)
        slewing += [False] * len(clock)
        elapsed += len(clock)
        if number < len(slews):
            before, after = angles[last - 1], angles[last]
            count = max(1, int(np.ceil(slew_duration(before, after, limits) / period)))
            share = quintic(np.arange(1, count) / count)
            pieces.append(before + share[:, None] * (after - before))
            path_pieces.append(np.full(count - 1, (last - 1) * period))
            slewing += [True] * (count - 1)
            start = (elapsed - 1) * period
            found.append(
                Slew(start, start + count * period, (last - 1) * period,
                     tuple(map(float, before)), tuple(map(float, after)))
            )  # fmt: skip
            elapsed += count - 1
    whole = np.concatenate(pieces)
    return Timeline(
        period * np.arange(len(whole), dtype=np.float64), whole, np.concatenate(path_pieces),
        np.array(slewing), tuple(found),
    )  # fmt: skip
