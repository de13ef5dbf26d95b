"""Place short labels next to points, clear of each other and of the lines."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from orientd.rotation import Floats

_DIRECTIONS = np.radians([20.0, 90.0, 160.0, -20.0, -90.0, -160.0, 55.0, 125.0, -55.0, -125.0])
_REACHES = (1.0, 1.7)


def places(anchors: Floats, sizes: Floats, obstacles: Floats, *, gap: float) -> Floats:
    """Return centres for labels next to their anchors.

    Each label in turn takes the place around its anchor that covers the fewest obstacles and
    no label already placed; of equals, the one farthest from the origin.

    Args:
        anchors: points that labels belong to, shape ``(n, 2)``.
        sizes: width and height of the labels, shape ``(n, 2)``.
        obstacles: points better left uncovered, shape ``(m, 2)``.
        gap: from an anchor to the edge of its label.

    Returns:
        Shape ``(n, 2)``; not a number for a label that has no place clear of the others.
    """
    placed: list[tuple[Floats, Floats]] = []
    found: Floats = np.empty((len(anchors), 2))
    for index, (anchor, size) in enumerate(zip(anchors, sizes, strict=True)):
        best, least = np.full(2, np.nan), np.inf
        for reach in _REACHES:
            for direction in _DIRECTIONS:
                step = np.array([np.cos(direction), np.sin(direction)])
                candidate = anchor + step * (gap * reach + 0.5 * size)
                cost = 0.4 * reach - 0.1 * float(step @ _unit(anchor))
                is_covered = np.all(np.abs(obstacles - candidate) < 0.5 * size, axis=-1)
                cost += np.count_nonzero(is_covered)
                if any(
                    np.all(np.abs(candidate - other) < 0.5 * (size + extent))
                    for other, extent in placed
                ):
                    continue
                if cost < least:
                    best, least = candidate, cost
        found[index] = best
        if np.isfinite(least):
            placed.append((best, size))
    return found


def grouped(points: Floats, nearness: float) -> list[list[int]]:
    """Return the indices of *points* (shape ``(n, 2)``) in groups that lie on top of each other.

    >>> grouped(np.array([[0.0, 0.0], [1.0, 0.0], [0.01, 0.0]]), 0.1)
    [[0, 2], [1]]
    """
    groups: list[list[int]] = []
    for index, point in enumerate(points):
        for group in groups:
            if np.hypot(*(points[group[0]] - point)) < nearness:
                group.append(index)
                break
        else:
            groups.append([index])
    return groups


def enumeration(numbers: Sequence[int]) -> str:
    """Return numbers with runs of three and more drawn together.

    >>> enumeration([1, 2, 3, 4, 8, 10, 11])
    '1–4, 8, 10, 11'
    """
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(
        f"{run[0]}–{run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs
    )


def _unit(vector: Floats) -> Floats:
    length = float(np.hypot(*vector))
    return vector / length if length > 0.0 else vector
