"""Dynamic programming over the angles of two axes.

The angles lie on a grid on which both axes turn by at most one cell in a step.  So the moves of a
step lead to the eight cells around, and a slew at full speed is a chain of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from orientd.driver import AxisLimits
from orientd.rotation import Floats

Bools = np.ndarray[Any, np.dtype[np.bool_]]
Indices = np.ndarray[Any, np.dtype[np.intp]]
Turns = np.ndarray[Any, np.dtype[np.int8]]

_CELL = np.radians(1.5)
"""Largest cell of the grid, rad."""
_MOST_STATES = 60_000_000
"""Cells times steps; each takes two bytes."""
_TRAVEL = 1e-4
"""Cost of a turn by a cell, in steps off the path."""


@dataclass(frozen=True, eq=False)
class AngleGrid:
    """Axis angles that both axes reach in whole steps.

    Attributes:
        low: first angles, rad, shape ``(2,)``.
        cell: distance of neighbours, rad, shape ``(2,)``.
        shape: number of angles of both axes.
        stride: samples of the path in a step.
    """

    low: Floats
    cell: Floats
    shape: tuple[int, ...]
    stride: int

    @classmethod
    def of(cls, joints: Floats, axes: Sequence[AxisLimits], period: float, count: int) -> AngleGrid:
        """Return the grid for about *count* samples on lines with *joints*, ``(lines, n, 2)``."""
        ends = np.array([(axis.low, axis.high) for axis in axes]).T
        low = np.maximum(ends[0], joints.min(axis=(0, 1)) - 2.0 * np.pi)
        high = np.minimum(ends[1], joints.max(axis=(0, 1)) + 2.0 * np.pi)
        speed = np.array([axis.velocity for axis in axes])
        step = _CELL / float(speed.max())
        states = np.prod((high - low) / (speed * step)) * count * period / step
        step *= max(1.0, np.cbrt(float(states) / _MOST_STATES))
        stride = max(1, int(step / period))
        cells = np.maximum(np.ceil((high - low) / (speed * stride * period)), 1.0)
        return cls(low, (high - low) / cells, tuple((cells + 1.0).astype(int)), stride)

    def cells(self, joints: Floats) -> Indices:
        """Return the nearest cells, shape ``(..., 2)``."""
        places = np.rint((joints - self.low) / np.maximum(self.cell, 1e-12)).astype(np.intp)
        return np.clip(places, 0, np.array(self.shape) - 1)

    def joints(self, cells: Indices) -> Floats:
        """Return axis angles, rad, shape ``(..., 2)``."""
        found: Floats = self.low + self.cell * cells
        return found

    @property
    def every(self) -> Floats:
        """All axis angles, rad, shape ``(n, 2)``."""
        return self.joints(np.argwhere(np.ones(self.shape, dtype=np.bool_)))


class GridLines(NamedTuple):
    """Where a chain may go at every step.

    Attributes:
        cells: of each line, shape ``(lines, n, 2)``.
        is_on: whether the gimbal can follow the line there, on target, shape ``(lines, n)``.
        price: of a step elsewhere, s, shape ``(n,)``.
        is_free: of each cell, whether it is outside of the cones, shape ``(parts, *grid)``.
        part: which of these holds at each step, shape ``(n,)``.
    """

    cells: Indices
    is_on: Bools
    price: Floats
    is_free: Bools
    part: Indices


def cheapest_chain(lines: GridLines, first: Floats, is_last: Bools) -> tuple[Indices, int] | None:
    """Return the cells of the chain with the least price, ``(n, 2)``, and its first line.

    Args:
        lines: where it may go.
        first: cost of beginning on each line.
        is_last: on which lines it may end.
    """
    count, shape = len(lines.price), lines.is_free.shape[1:]
    values = np.full(shape, np.inf, dtype=np.float32)
    for cell in lines.cells[is_last, -1]:
        values[tuple(cell)] = 0.0
    turns = np.zeros((2, count - 1, *shape), dtype=np.int8)
    for at in range(count - 2, -1, -1):
        for axis in (1, 0):
            values, turns[axis, at] = _stepped(values, axis, _TRAVEL * float(lines.price[at]))
        on = [tuple(cell) for cell in lines.cells[lines.is_on[:, at], at]]
        kept = [values[cell] for cell in on]
        values += np.float32(lines.price[at])
        values[~lines.is_free[lines.part[at]]] = np.inf
        for cell, value in zip(on, kept, strict=True):
            values[cell] = value
    begins = lines.cells[:, 0]
    cost = first + values[begins[:, 0], begins[:, 1]]
    line = int(np.argmin(cost))
    if not np.isfinite(cost[line]):
        return None
    cells = [begins[line]]
    for at in range(count - 1):
        i, j = cells[-1].tolist()
        i += int(turns[0, at, i, j])
        j += int(turns[1, at, i, j])
        cells.append(np.array([i, j]))
    return np.array(cells), line


def _stepped(values: Floats, axis: int, price: float) -> tuple[Floats, Turns]:
    """Return the least value within a step of an axis, and the step to it."""
    best, turn = values.copy(), np.zeros(values.shape, dtype=np.int8)
    for move in (-1, 1):
        here = [slice(None), slice(None)]
        there = [slice(None), slice(None)]
        here[axis], there[axis] = (
            (slice(1, None), slice(None, -1)) if move < 0 else (slice(None, -1), slice(1, None))
        )
        other = values[tuple(there)] + np.float32(price)
        is_better = other < best[tuple(here)]
        best[tuple(here)][is_better] = other[is_better]
        turn[tuple(here)][is_better] = move
    return best, turn
