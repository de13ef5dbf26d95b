r"""Newton's method: damped, along a homotopy, and from many starts in parallel.

Families provide equations and this module solves them.  *Equations* map a state to its error and to
a function that computes the Newton step there.  So a family may solve dense, banded or block
systems, and trial states cost no linear algebra.  A state is anything that *move* can move by a
step: a vector, orientations with their right increments, or a record of several.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from orientd import kernels
from orientd.curves.basis import Indices
from orientd.rotation import Floats

State = TypeVar("State")

Linearised = tuple[Floats, Callable[[], Floats]]
"""The error of a state, and a function that returns the Newton step from there."""

SUFFICIENT = 1e-3
"""Share of the decrease promised by the linearised error that a damped step must achieve."""

SMALLEST_SHARE = 1e-5
"""A damped step shorter than this share of Newton's step means that the search is stuck."""

SHARES = np.append(0.25 ** np.arange(13.0), 0.0)
"""Shares of a step that a descent tries in parallel."""

SETTLED = 1e-9
"""A descent ends with a step of this length."""

_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def largest(step: Floats) -> float:
    """Return the largest component of a step, as an absolute value."""
    return float(np.max(np.abs(step), initial=0.0))


def add(state: Floats, step: Floats) -> Floats:
    """Move a state in a vector space."""
    moved: Floats = state + step
    return moved


def newton(
    equations: Callable[[State], Linearised],
    guess: State,
    *,
    move: Callable[[State, Floats], State] = add,  # type: ignore[assignment]  # of arrays
    size: Callable[[Floats], float] = largest,
    tolerance: float = 1e-8,
    iterations: int = 40,
    longest: float = 1.0,
) -> State | None:
    """Return the root near a guess by Newton's method, or ``None`` if it does not converge.

    Args:
        equations: the error of a state and the step to solve it.
        guess: initial state.
        move: applies a step to a state; addition by default.
        size: the length of a step.
        tolerance: size of the last step.  The remaining error is its square.
        iterations: most iterations.
        longest: steps are cut to this size, then halved until they lower the sum of squared errors.
    """
    error, solve = equations(guess)
    for _ in range(iterations):
        try:
            step = solve()
        except np.linalg.LinAlgError:
            return None
        length = size(step)
        if length <= tolerance:
            return move(guess, step)
        share = min(1.0, longest / length)
        before = float(np.sum(error * error))
        while True:
            moved = move(guess, share * step)
            error, solve = equations(moved)
            if np.sum(error * error) <= (1.0 - SUFFICIENT * share) * before:
                break
            share *= 0.5
            # A NaN step ends the search too.
            if not share >= SMALLEST_SHARE:
                return None
        guess = moved
    return None


def homotopy(
    solve: Callable[[float, Floats], Floats | None],
    start: Floats,
    rate: Floats,
    *,
    smallest: float = 1e-3,
) -> tuple[Floats, float]:
    """Follow a solution while a parameter goes from 0 to 1, halving steps that fail.

    Args:
        solve: returns the solution at a parameter near a guess, or ``None``.
        start: the solution at 0.
        rate: its derivative by the parameter there, for the first guess.  The first step goes to 1.
            Later guesses extrapolate the last two solutions.
        smallest: step of the parameter below which it gives up.

    Returns:
        The last solution, and its parameter: 1 unless it gave up.
    """
    reached, stride = 0.0, 1.0
    while reached < 1.0 and stride >= smallest:
        target = min(1.0, reached + stride)
        found = solve(target, start + (target - reached) * rate)
        if found is None:
            stride *= 0.5
        else:
            rate = (found - start) / (target - reached)
            start, reached, stride = found, target, 2.0 * (target - reached)
    return start, reached


def multistart(
    values: Callable[[Floats], Floats],
    derivatives: Callable[[Floats], tuple[Floats, Floats]],
    starts: Floats,
    *,
    move: Callable[[Floats, Floats], Floats],
    count: int = 16,
    iterations: int = 40,
) -> tuple[Floats, float]:
    """Return the lowest minimum reached from the best of many starts, and its value.

    The descents run in parallel: every function takes states with a leading axis ``s``.  Each takes
    Newton steps with a positive curvature, scaled by the best of a few shares.

    Args:
        values: the function to minimise, ``(s,)``; infinite for states that are not allowed.
        derivatives: gradient ``(s, d)`` and Hessian ``(s, d, d)`` with respect to steps of *move*.
        starts: initial states, shape ``(n, k)``.
        move: maps states and steps ``(s, d)`` to states.
        count: number of descents, from the starts with the lowest values.
        iterations: most iterations.
    """
    worth = values(starts)
    order = np.argsort(worth, kind="stable")
    best, least = starts[order[0]], float(worth[order[0]])
    x = starts[order[:count]][np.isfinite(worth[order[:count]])]
    for _ in range(iterations if len(x) else 0):
        gradient, hessian = derivatives(x)
        curvatures, axes = np.linalg.eigh(hessian)
        floor = 1e-6 * np.max(np.abs(curvatures), axis=1, keepdims=True) + 1e-12
        along = np.einsum("sij,si->sj", axes, gradient) / np.maximum(np.abs(curvatures), floor)
        step = -np.einsum("sij,sj->si", axes, along)
        length = np.sqrt(np.sum(step * step, axis=1, keepdims=True))
        step *= np.minimum(1.0, 0.5 / np.where(length > 0.0, length, 1.0))
        tried = move(
            np.repeat(x, len(SHARES), axis=0),
            (SHARES[:, None] * step[:, None]).reshape(-1, step.shape[1]),
        )
        reached = values(tried).reshape(len(x), -1)
        # The first of equally good shares, so that a search can move along a flat minimum.
        lowest = reached.min(axis=1, keepdims=True)
        chosen = np.argmax(reached <= lowest + 1e-14 * np.abs(lowest), axis=1)
        x = tried.reshape(len(x), len(SHARES), -1)[np.arange(len(x)), chosen]
        place = int(np.argmin(lowest))
        if lowest[place, 0] <= least:
            best, least = x[place], float(lowest[place, 0])
        if np.max(length[:, 0] * SHARES[chosen]) < SETTLED:
            break
    return best, least


def differences(
    values: Callable[[Floats], Floats],
    move: Callable[[Floats, Floats], Floats],
    dimensions: int,
    nudge: float = 1e-4,
) -> Callable[[Floats], tuple[Floats, Floats]]:
    """Return gradient and Hessian for a multistart, by differences of fourth and second order.

    Args:
        values: as in :func:`multistart`.
        move: as in :func:`multistart`.
        dimensions: of a step, *d*.
        nudge: step size of the differences.
    """
    axes = np.eye(dimensions)
    row, column = np.triu_indices(dimensions, 1)
    pairs = axes[row] + axes[column]
    steps = np.concatenate([0.0 * axes[:1], axes, -axes, 2.0 * axes, -2.0 * axes, pairs, -pairs])
    places = np.cumsum([1, *[dimensions] * 4, len(row)])

    def derivatives(x: Floats) -> tuple[Floats, Floats]:
        around = np.repeat(x, len(steps), axis=0)
        reached = values(move(around, np.tile(nudge * steps, (len(x), 1)))).reshape(len(x), -1)
        here, up, down, far_up, far_down, both_up, both_down = np.split(reached, places, axis=1)
        gradient = (8.0 * (up - down) - (far_up - far_down)) / (12.0 * nudge)
        bend = (up + down - 2.0 * here) / nudge**2
        hessian = bend[:, None] * axes
        mixed = (both_up + both_down - 2.0 * here) / nudge**2 - bend[:, row] - bend[:, column]
        hessian[:, row, column] = hessian[:, column, row] = 0.5 * mixed
        return gradient, hessian

    return derivatives


def cross(a: Floats, b: Floats) -> Floats:
    """Return cross products, several times as fast as NumPy for a few thousand vectors."""
    product: Floats = a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT]
    return product


def solve_blocks(blocks: Floats, rows: Indices, columns: Indices, right: Floats) -> Floats:
    """Solve a square system whose matrix is a sum of small blocks near the diagonal.

    Columns outside the matrix are dropped, so that the blocks of the first and last keyframe have
    the same shape as others.

    Args:
        blocks: shape ``(n, p, q)``.
        rows: the first row of each block, shape ``(n,)``.
        columns: the first column of each block; may lie outside the matrix.
        right: the right side, shape ``(size,)``.

    Returns:
        The solution, shaped like *right*.  Time and memory grow linearly with *size*.

    Raises:
        numpy.linalg.LinAlgError: the matrix is singular.
    """
    _, height, width = blocks.shape
    row = np.broadcast_to(rows[:, None, None] + np.arange(height)[:, None], blocks.shape)
    column = np.broadcast_to(columns[:, None, None] + np.arange(width), blocks.shape)
    inside = (column >= 0) & (column < len(right)) & (row < len(right))
    return solve_entries(row[inside], column[inside], blocks[inside], right)


def solve_entries(row: Indices, column: Indices, entries: Floats, right: Floats) -> Floats:
    """Solve a square system given by entries near the diagonal; entries at one place add up."""
    lower, upper = (int(np.max(one, initial=0)) for one in (row - column, column - row))
    places = (upper + row - column) * len(right) + column
    band = np.bincount(places, entries, minlength=(lower + upper + 1) * len(right))
    return solve_banded(lower, upper, band.reshape(-1, len(right)).astype(np.float64), right)


def solve_banded(lower: int, upper: int, band: Floats, right: Floats) -> Floats:
    """Solve a banded system.

    Args:
        lower: number of diagonals below the main one.
        upper: number of diagonals above it.
        band: the diagonals from the uppermost to the lowest, each entry in its column, shape
            ``(lower + upper + 1, size)``.
        right: the right side, shape ``(size,)`` or ``(size, k)``.

    Raises:
        numpy.linalg.LinAlgError: the matrix is singular or not finite.
    """
    solution = np.array(right, dtype=np.float64)
    if not kernels.solve_banded(band, lower, upper, solution.reshape(len(right), -1)):
        raise np.linalg.LinAlgError("singular matrix")
    return solution
