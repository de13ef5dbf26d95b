"""The shortest line through a tube: the taut string, which has the least peak slope as well."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.rotation import Floats


def taut_string(low: ArrayLike, high: ArrayLike, start: float, end: float) -> Floats:
    """Return the shortest line between two bounds, on a uniform grid.

    Of all lines through the tube it has the least sum of every convex function of the slope, so the
    least peak slope too (Davies and Kovac 2001, section 2; Grasmair 2007).

    Args:
        low: lower bounds, shape ``(n,)``; may be ``-inf``.
        high: upper bounds, shape ``(n,)``; may be ``inf``.
        start: value at the first sample, where the bounds are not looked at.
        end: value at the last sample, likewise.

    Returns:
        The line, shape ``(n,)``.

    Raises:
        ValueError: the tube is closed somewhere: a lower bound lies above the upper one.
    """
    low = np.array(low, dtype=np.float64)
    high = np.array(high, dtype=np.float64)
    low[[0, -1]] = high[[0, -1]] = start, end
    if np.any(low > high):
        raise ValueError(f"the tube is closed at sample {int(np.argmax(low > high))}")
    count = len(low)
    line = np.empty(count)
    line[0] = start
    at = 0
    while at < count - 1:
        # Slopes from here that stay inside the tube up to each sample; the string bends at the
        # bound that was the tightest when none is left.
        run = np.arange(1, count - at)
        least = np.maximum.accumulate((low[at + 1 :] - line[at]) / run)
        most = np.minimum.accumulate((high[at + 1 :] - line[at]) / run)
        closed = np.nonzero(least > most)[0]
        if closed.size == 0:
            to, value = count - 1, end
        else:
            first = int(closed[0])
            rises = (low[at + 1 + first] - line[at]) / run[first] > most[first - 1]
            bound, slopes = (high, most) if rises else (low, least)
            tightest = slopes[first - 1]
            inside = (bound[at + 1 : at + 1 + first] - line[at]) / run[:first]
            to = at + 1 + int(np.nonzero(inside == tightest)[0][-1])
            value = bound[to]
        line[at + 1 : to + 1] = line[at] + (value - line[at]) * np.arange(1, to - at + 1) / (
            to - at
        )
        at = to
    return line


def smooth(line: Floats, width: int) -> Floats:
    """Average over *width* samples to both sides, the ends kept; bends become parabolas.

    A line of slopes within v has second differences within 2 v / (2 *width* + 1) afterwards.

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
