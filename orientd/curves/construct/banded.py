"""Banded linear systems given as blocks, for constructions that couple neighbouring keyframes."""

from __future__ import annotations

import numpy as np

from orientd.curves.construct.basis import Indices
from orientd.kernels import solve_banded as solve
from orientd.rotation import Floats


def solve_blocks(blocks: Floats, rows: Indices, columns: Indices, right: Floats) -> Floats:
    """Solve a square system whose matrix is a sum of small blocks near the diagonal.

    Columns outside the matrix are dropped, so that the first and last keyframe need no blocks of
    another shape.

    Args:
        blocks: shape ``(n, p, q)``.
        rows: the first row of each block, shape ``(n,)``.
        columns: the first column of each block; may lie outside the matrix.
        right: the right side, shape ``(size,)`` or ``(size, k)``.

    Returns:
        The solution, shaped like *right*.  Time and memory grow linearly with *size*.

    Raises:
        numpy.linalg.LinAlgError: the matrix is singular.
    """
    size = len(right)
    _, height, width = blocks.shape
    lower = int(np.max(rows + height - 1 - np.maximum(columns, 0), initial=0))
    upper = int(np.max(columns + width - 1 - rows, initial=0))
    lower, upper = min(lower, size - 1), min(upper, size - 1)
    band: Floats = np.zeros((lower + upper + 1, size))
    for r in range(height):
        for c in range(width):
            row, column = rows + r, columns + c
            inside = (column >= 0) & (column < size) & (row < size)
            diagonal = upper + row - column
            np.add.at(band, (diagonal[inside], column[inside]), blocks[inside, r, c])
    return solve_banded(lower, upper, band, right)


def solve_banded(lower: int, upper: int, band: Floats, right: Floats) -> Floats:
    """Solve a banded system.

    Args:
        lower: how many diagonals below the main one.
        upper: how many above it.
        band: the diagonals from the uppermost to the lowest, an entry in its column, shape
            ``(lower + upper + 1, size)``.
        right: the right side, shape ``(size,)`` or ``(size, k)``.

    Raises:
        numpy.linalg.LinAlgError: the matrix is singular or not finite.
    """
    solution = np.array(right, dtype=np.float64)
    if not solve(band, lower, upper, solution.reshape(len(right), -1)):
        raise np.linalg.LinAlgError("singular matrix")
    return solution
