r"""The effort of a cumulative B-spline as a function of its increments, and what binds them.

The acceleration on a knot span depends on the increments of that span only, not on the orientation
it starts from.  So with the increments :math:`w` as unknowns, the effort is a sum over spans of
squares of few of them, and each keyframe is one equation, the telescoped product of
:mod:`orientd.curves.interpolating`.  A Gauss-Newton step :math:`\delta`, the minimum of
the linearised squares under the linearised equations :math:`A \delta = -c`, solves

.. math:: \begin{pmatrix} J^T J & A^T \\ A & 0 \end{pmatrix}
          \begin{pmatrix} \delta \\ \lambda \end{pmatrix} =
          - \begin{pmatrix} J^T r \\ c \end{pmatrix}

a banded system once each multiplier stands among the increments that its equation binds.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from orientd.curves.construct import CumulativeBasis, Indices, Path, solve_banded
from orientd.kernels import linearise_effort
from orientd.rotation import Floats, between

SLACK = 1e-3
"""Relative; the nodes see a curve that is not their spline with an error."""

ROUNDING = 1e-20


@dataclass(frozen=True)
class EndRows:
    """Linear conditions on pairs of increments, one in each row.

    Attributes:
        index: which increments, shape ``(e, 2)``.
        factors: what they are multiplied by, shape ``(e, 2)``.
        known: what that amounts to, half-angle vectors, shape ``(e, 3)``.
    """

    index: Indices
    factors: Floats
    known: Floats

    def errors(self, increments: Floats) -> Floats:
        """Return by how much the conditions are missed, shape ``(e, 3)``."""
        reached: Floats = np.einsum("ef,efi->ei", self.factors, increments[self.index])
        return reached - self.known

    def imposed(self, increments: Floats) -> Floats:
        """Return the increments with those that a row alone settles in their place."""
        is_alone = self.factors[:, 1] == 0.0
        exact = increments.copy()
        exact[self.index[is_alone, 0]] = self.known[is_alone] / self.factors[is_alone, :1]
        return exact


@dataclass(frozen=True)
class Linearised:
    """Effort and equations at some increments, with their derivatives.

    Attributes:
        effort: half the integral of squared torque.
        gradient: of each span by its increments, shape ``(S, 3 m)``.
        squares: the Gauss-Newton matrix of each span, shape ``(S, 3 m, 3 m)``.
        bound: derivatives of the keyframe equations, shape ``(N, 3, 3 F)``.
        missed: errors of all equations, those of the ends last, shape ``(N + e, 3)``.
    """

    effort: float
    gradient: Floats
    squares: Floats
    bound: Floats
    missed: Floats


class EffortEquations:
    """What a curve of least effort minimises and keeps.

    Args:
        basis: the cumulative basis functions on each span.
        places: the span that begins at each keyframe, the number of spans for the last one.
        keys: keyframes, with the signs wanted, shape ``(N + 1, 4)``.
        ends: conditions at the ends.
        inertia: shape ``(3, 3)``; without it effort is squared acceleration.
    """

    def __init__(
        self,
        *,
        basis: CumulativeBasis,
        places: Indices,
        keys: Floats,
        ends: EndRows,
        inertia: Floats | None,
    ) -> None:
        self.count = int(basis.first[-1]) + basis.values.shape[1] - 1
        self.ends = ends
        self.inertia = inertia
        self._window = basis.first[:, None] - 1 + np.arange(basis.values.shape[1])
        index, share = keyframe_factors(basis, places)
        self._index, self._share = np.ascontiguousarray(index), np.ascontiguousarray(share)
        self._steps = between(keys[:-1], keys[1:])
        self._at_nodes, self._node_times, self._node_weights = _rule(basis)
        self._layout = _Layout(self._window, self._index, ends, self.count)

    def linearised(self, increments: Floats) -> Linearised:
        """Return effort, equations and derivatives, increments of shape ``(count, 3)``."""
        spans, functions = self._window.shape
        count, factors = self._index.shape
        gradient, squares, bound, missed = (
            np.empty((spans, 3 * functions)),
            np.empty((spans, 3 * functions, 3 * functions)),
            np.empty((count, 3, 3 * factors)),
            np.empty((count, 3)),
        )
        effort = linearise_effort(
            np.ascontiguousarray(increments),
            self._window.ravel(),
            self._at_nodes,
            np.sqrt(self._node_weights),
            np.empty((0, 3)) if self.inertia is None else self.inertia,
            self._index.ravel(),
            self._share,
            self._steps,
            gradient,
            squares,
            bound,
            missed,
        )
        missed = np.concatenate([missed, self.ends.errors(increments)])
        return Linearised(effort, gradient, squares, bound, missed)

    def is_wide(self, angle: float, most: int) -> bool:
        """Return whether some of at most so many keyframes are farther apart than an angle, rad."""
        apart = 2.0 * np.arccos(np.minimum(np.abs(self._steps[:, 0]), 1.0))
        return len(apart) < most and bool(np.any(apart > angle))

    def of_acceleration(self) -> EffortEquations:
        """Return the same equations where effort is squared acceleration."""
        other = copy(self)
        other.inertia = None
        return other

    def is_better(self, increments: Floats, path: Path) -> bool:
        """Tell whether increments take no more effort than a curve, rounding apart."""
        _, omega, torque = path(self._node_times)
        if self.inertia is not None:
            torque = torque @ self.inertia + np.cross(omega, omega @ self.inertia)
        theirs = 0.5 * float(np.sum(self._node_weights[:, None] * torque**2))
        rounding = ROUNDING * float(np.sum(increments**2)) / float(np.min(self._node_weights)) ** 3
        return self.linearised(increments).effort <= (1.0 + SLACK) * theirs + rounding

    def step(self, here: Linearised) -> tuple[Floats, Floats]:
        """Return the Gauss-Newton step, and the multipliers of the equations.

        Raises:
            numpy.linalg.LinAlgError: the system is singular.
        """
        return self._layout.solve(here, np.abs(self._share))


def keyframe_factors(basis: CumulativeBasis, places: Indices) -> tuple[Indices, Floats]:
    """Return increments and shares of the factors that lead from each keyframe to the next.

    What is under way at the first keyframe is undone from the right, what has been passed at the
    second completed, and what is under way there begun.

    Returns:
        Both of shape ``(N, F)``; shares are zero where an interval has fewer factors.
    """
    functions = basis.values.shape[1]
    first = basis.first - 1
    here, last = places[:-1], len(first) - 1
    there = np.minimum(places[1:], last)
    undone, begun = basis.values[here, :, 0], basis.values[there, :, 0]
    begun[-1] = basis.values[last, :, -1]
    start, stop = first[here], first[there]
    index = [start + f for f in range(functions - 1, -1, -1)]
    share = [-undone[:, f] for f in range(functions - 1, 0, -1)]
    share.append(np.where(stop > start, 1.0, 0.0) - undone[:, 0])
    for more in range(1, int(np.max(stop - start))):
        is_passed = start + more < stop
        index.append(np.where(is_passed, start + more, start))
        share.append(np.where(is_passed, 1.0, 0.0))
    for f in range(functions):
        index.append(stop + f)
        share.append(begun[:, f])
    is_used = np.any(np.stack(share) != 0.0, axis=1)
    return np.stack(index)[is_used].T, np.stack(share)[is_used].T


def _rule(basis: CumulativeBasis) -> tuple[Floats, Floats, Floats]:
    """Return the basis ``(3, m, n)`` at the nodes of Gauss's rule on each span, nodes, weights."""
    nodes, weights = np.polynomial.legendre.leggauss(basis.values.shape[1] + 1)
    h = np.diff(basis.breaks)[:, None]
    times = (basis.breaks[:-1, None] + 0.5 * h * (1.0 + nodes)).ravel()
    span = np.repeat(np.arange(len(h)), len(nodes))
    return basis.at(span, times), times, (0.5 * h * weights).ravel()


class _Layout:
    """Where the blocks of the system stand in its band."""

    def __init__(self, window: Indices, index: Indices, ends: EndRows, count: int) -> None:
        self._window, self._index, self._ends, self._count = window, index, ends, count
        middles = 0.5 * (index.min(axis=1) + index.max(axis=1)) + 0.25
        order = np.concatenate([np.arange(count), middles, ends.index.mean(axis=1) + 0.25])
        self._place = np.empty(len(order), dtype=np.intp)
        self._place[np.argsort(order, kind="stable")] = np.arange(len(order))
        of_increments, of_equations = self._place[:count], self._place[count:]
        spans = _components(of_increments[window])
        bound, keyframes = _components(of_increments[index]), of_equations[: len(index), None]
        tied, conditions = of_increments[ends.index], of_equations[len(index) :, None]
        pairs = [
            _pairs(spans, spans),
            _pairs(_components(keyframes), bound),
            # A condition ties each component of an increment by the same factor.
            (
                np.repeat(3 * conditions[:, :, None] + np.arange(3), 2, axis=1),
                3 * tied[:, :, None] + np.arange(3),
            ),
        ]
        rows = [row.ravel() for row, _ in pairs] + [column.ravel() for _, column in pairs[1:]]
        columns = [column.ravel() for _, column in pairs] + [row.ravel() for row, _ in pairs[1:]]
        row, column = np.concatenate(rows), np.concatenate(columns)
        self._reach = int(np.max(np.abs(row - column)))
        self._band = (self._reach + row - column) * 3 * len(order) + column
        self._row_places, self._column_places = row // 3, column // 3

    def solve(self, here: Linearised, shares: Floats) -> tuple[Floats, Floats]:
        """Return step and multipliers, the unknowns scaled so that rounding treats all alike."""
        count, total = self._count, len(self._place)
        right = np.zeros((total, 3))
        np.subtract.at(
            right,
            self._place[self._window],
            here.gradient.reshape(*self._window.shape, 3),
        )
        right[self._place[count:]] = -here.missed
        scale = self._scale(here.squares, shares)
        ties = np.repeat(self._ends.factors.ravel(), 3)
        bound = here.bound.ravel()
        entries = np.concatenate([here.squares.ravel(), bound, ties, bound, ties])
        entries *= scale[self._row_places] * scale[self._column_places]
        size = (2 * self._reach + 1) * 3 * total
        band: Floats = np.bincount(self._band, entries, minlength=size).astype(np.float64)
        band = band.reshape(-1, 3 * total)
        solution = solve_banded(self._reach, self._reach, band, (scale[:, None] * right).ravel())
        found = (scale[:, None] * solution.reshape(-1, 3))[self._place]
        return found[:count], found[count:]

    def _scale(self, squares: Floats, shares: Floats) -> Floats:
        """Return by what to multiply rows and columns; the same for the components of a vector."""
        count = self._count
        traces = np.einsum("sii->si", squares).reshape(*self._window.shape, 3).sum(axis=2)
        stiffness = np.bincount(self._window.ravel(), traces.ravel(), minlength=count)
        of_increments = 1.0 / np.sqrt(stiffness)
        of_keyframes = 1.0 / np.max(shares * of_increments[self._index], axis=1)
        factors = np.abs(self._ends.factors) * of_increments[self._ends.index]
        scale: Floats = np.empty(len(self._place))
        scale[self._place] = np.concatenate(
            [of_increments, of_keyframes, 1.0 / np.max(factors, axis=1, initial=0.0)]
        )
        return scale


def _components(places: Indices) -> Indices:
    """Return the numbers of the components of vectors at places, ``(n, k)`` to ``(n, 3 k)``."""
    numbers: Indices = (3 * places[..., None] + np.arange(3)).reshape(len(places), -1)
    return numbers


def _pairs(rows: Indices, columns: Indices) -> tuple[Indices, Indices]:
    """Return row and column of every entry of dense blocks."""
    shape = (len(rows), rows.shape[1], columns.shape[1])
    return (
        np.broadcast_to(rows[:, :, None], shape),
        np.broadcast_to(columns[:, None, :], shape),
    )
