"""Rounded corners of axis angles.

A moving average turns a corner into a parabola, and a second one bounds the jerk.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from orientd.curves.quintic import smooth_step
from orientd.driver import AxisLimits
from orientd.rotation import Floats

_CORNER = 0.5
"""Share of the acceleration limit from which a bend is rounded."""
_KINK = 0.02
"""Share of the velocity limit by which it changes in a sample, from which a bend is rounded."""
_LEAST_ROUNDING = 2


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
