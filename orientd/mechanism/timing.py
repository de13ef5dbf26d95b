"""Smooth changes in time: ramps of path times, and rounded corners of axis angles.

A moving average turns a corner into a parabola, and a second one bounds the jerk.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from orientd.curves.quintic import smooth_ramp, smooth_step
from orientd.driver import AxisLimits
from orientd.rotation import Floats

_CORNER = 0.5
"""Share of the acceleration limit from which a bend is rounded."""
_KINK = 0.02
"""Share of the velocity limit by which it changes in a sample, from which a bend is rounded."""
_LEAST_ROUNDING = 2


def ramp_times(elapsed: Floats, ramp: float) -> Floats:
    """Return the path times of a path whose speed rises from 0 to 1 as a quintic over *ramp* s."""
    return ramp * smooth_ramp(elapsed / ramp)


def run_through(slow: Floats, times: Floats) -> Floats:
    """Return the place on a path at *times*, for a given slowness.

    Its derivative is continuous, so that of the path is too.

    Args:
        slow: time per step at each sample, linear between them, positive, shape ``(n,)``.
        times: in the unit of *slow*, from 0 on.

    Returns:
        Places in samples, at most the last.
    """
    reached = np.concatenate([[0.0], np.cumsum((slow[1:] + slow[:-1]) / 2.0)])
    first = np.clip(np.searchsorted(reached, times, side="right") - 1, 0, len(slow) - 2)
    since = np.minimum(times, reached[-1]) - reached[first]
    begin, rise = slow[first], slow[first + 1] - slow[first]
    # Within a step, time is a parabola of the place; this form of its root needs no special case.
    root = np.sqrt(np.maximum(begin * begin + 2.0 * rise * since, 0.0))
    places: Floats = first + 2.0 * since / (begin + root)
    return places


def calmed(pace: Floats, width: int) -> Floats:
    """Return a smooth pace that never exceeds *pace*, shape ``(n,)``.

    Args:
        pace: of each sample, shape ``(n,)``.
        width: samples on each side over which it is averaged.
    """
    padded = np.pad(pace, 2 * width, mode="edge")
    # The average of the minimum around each sample.
    least = np.lib.stride_tricks.sliding_window_view(padded, 2 * width + 1).min(axis=1)
    kernel = np.hanning(2 * width + 3)[1:-1]
    return np.convolve(least, kernel / kernel.sum(), mode="valid")


def smooth(line: Floats, width: int) -> Floats:
    """Average over *width* samples on both sides, keeping the ends; bends become parabolas.

    A line of slopes within v then has second differences within 2 v / (2 *width* + 1).

    Args:
        line: shape ``(n,)``.
        width: samples to each side.
    """
    width = min(width, len(line) - 1)
    if width < 1:
        return line.copy()
    padded = np.pad(line, width, mode="reflect", reflect_type="odd")
    total = np.concatenate([[0.0], np.cumsum(padded)])
    averaged: Floats = (total[2 * width + 1 :] - total[: -2 * width - 1]) / (2 * width + 1)
    return averaged


def width(axes: Sequence[AxisLimits], period: float) -> int:
    """Return the samples to each side within which the largest corner is rounded."""
    wide = [_widths(2.0 * axis.velocity * period, axis, period) for axis in axes]
    return max(sum(one) for one in wide) + 1


def _widths(bend: float, axis: AxisLimits, period: float) -> tuple[int, int]:
    """Return the widths of both averages that round a corner of *bend* rad a sample."""
    force, jerk = axis.acceleration * period**2, axis.jerk * period**3
    first = math.ceil(0.5 * bend / force)
    second = max(_LEAST_ROUNDING, math.ceil(force / jerk) if math.isfinite(jerk) else 0)
    return first, second


def rounded(joints: Floats, axes: Sequence[AxisLimits], period: float) -> Floats:
    """Return axis angles with rounded corners, unchanged away from them."""
    found = joints.copy()
    for place, axis in enumerate(axes):
        line = joints[:, place]
        bends = np.abs(np.diff(line, 2))
        least = period * min(_CORNER * axis.acceleration * period, _KINK * axis.velocity)
        corners = np.flatnonzero(bends > least) + 1
        for begin, end in _groups(corners, 2 * width(axes, period)):
            bend = float(np.max(bends[begin - 1 : end]))
            first, second = _widths(bend, axis, period)
            reach = 2 * (first + second) + 2
            a, b = max(0, begin - reach), min(len(line), end + reach + 1)
            part = line[a:b]
            calm = smooth(smooth(part, first), second)
            fade = np.minimum(np.arange(b - a), np.arange(b - a)[::-1]) / max(1, first + second)
            found[a:b, place] = part + smooth_step(fade) * (calm - part)
    return found


def _groups(places: np.ndarray, apart: int) -> list[tuple[int, int]]:
    """Return first and last of each group of *places* that are at most *apart* from one another."""
    if not len(places):
        return []
    cuts = np.flatnonzero(np.diff(places) > apart)
    begins, ends = [0, *(cuts + 1).tolist()], [*cuts.tolist(), len(places) - 1]
    return [(int(places[a]), int(places[b])) for a, b in zip(begins, ends, strict=True)]
