r"""The cumulative B-spline of least effort through keyframes: closed form, near the optimum.

The acceleration on a knot span depends only on the increments of that span, not on its initial
orientation.  With the increments :math:`w` as unknowns, the effort is therefore a sum over spans of
squares of few of them.  Each keyframe gives one equation, the telescoped product of
:mod:`orientd.curves.interpolating`.  A Gauss-Newton step :math:`\delta`, the minimum of
the linearised squares under the linearised equations :math:`A \delta = -c`, solves

.. math:: \begin{pmatrix} J^T J & A^T \\ A & 0 \end{pmatrix}
          \begin{pmatrix} \delta \\ \lambda \end{pmatrix} =
          - \begin{pmatrix} J^T r \\ c \end{pmatrix}

This system is banded if each multiplier is placed among the increments of its equation.  It ignores
the curvature of residuals and equations.  Near the solution, a step therefore shrinks the error by
a factor that grows with the turn between keyframes: 0.03 at 45 degrees, 0.15 at 90, 0.5 at 170.
Anderson's mixing (1965; Walker and Ni, 2011) of the last few steps halves the number of steps for a
tiny least-squares problem.  Some cases converge only with it.  Far from the solution, a step must
lower the effort plus the errors of the equations, each weighted more than its multiplier.  This is
the exact penalty of Han (1977).

The search begins at a cumulative spline in finer knots.  A cumulative spline is not one over finer
knots, as it would be in Euclidean space, but close to one.  Its control quaternions are estimated
from the curve and its acceleration.  If the estimate misses the keyframes by far, the search also
tries the spline of the finer knots through points of the curve.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.basis import CumulativeBasis, Indices, cumulative_basis
from orientd.curves.contract import Ends, WithEndStates
from orientd.curves.interpolating import interpolate
from orientd.curves.keyframes import ParameterError, check_integer, check_numbers
from orientd.curves.newton import solve_entries
from orientd.curves.products import Path, Product, product_trajectory
from orientd.curves.starts import start_path
from orientd.errors import PlanError
from orientd.kernels import linearise_effort
from orientd.rotation import (
    Floats,
    angle,
    between,
    exp_half,
    log_half,
    multiply,
    rotate,
)

DIVISIONS = (2, 4)
"""Factors of the number of spans, tried until the effort is below that of the initial spline.

A spline that turns by radians in a span is not close to one over finer knots.
"""

FEWEST = 2
"""Initial number of spans: with more, the search converges less often."""

WIDE = 2.2
"""Rad between keyframes beyond which the torque varies so much that two more spans are used."""

LARGE = 2.0
"""Rad between keyframes beyond which the torque has several minima.

In 4 of a hundred sets of 150 degrees they were up to 50 % apart.
"""

FEW = 10
"""Most keyframes for a second search, to bound its time."""

WORSE = 1e-3
"""Relative tolerance of a curve that is not the problem's spline."""

FAR = 0.1
"""Rad of half angle; if an estimate misses a keyframe by more, another start is tried too."""

ROUNDING = 1e-20

ITERATIONS = 100

DEPTH = 4
"""Number of earlier steps in the mixing."""

SETTLED = 1e-6
"""Relative size of the last step: the effort is then stationary to its square.

The equations hold to the square of the step too.
"""

SMALL = 1e-4
"""Rad; smaller steps are taken unchecked, since their gain is near rounding."""

SMALLEST_SHARE = 1e-4
SLACK = 1e-10

_MORE = "add keyframes, lower the end velocities or make neighbouring intervals more alike"


class MinimumEffort(Product, WithEndStates):
    r"""Pass through keyframes with little torque: the spline of least effort on a grid.

    .. math:: q(t) = q_0 \prod_j \exp\bigl(w_j \tilde B_{j,k}(t)\bigr), \qquad
              \min_w \int \|I \dot\Omega + \Omega \times I \Omega\|^2 dt

    Kim, Kim and Shin (1995), sec. 7, leave this problem open.  Barr, Currin, Gabriel and Hughes
    (1992) solve it for points on a grid.  Here each interval between keyframes is divided in equal
    spans, so that the cumulative B-spline has more increments *w* than the keyframes determine.
    The free ones minimise the integral: of squared torque for an inertia *I*, of squared angular
    acceleration without one. Derivatives are those of Sommer et al. (2020).  A Gauss-Newton step is
    one banded system, so the build time is proportional to the number of keyframes.

    For acceleration, a cubic is within 0.8 % (two spans) or 0.3 % (three) of the least possible
    integral (``min_acceleration``) for steps up to 170 degrees.  ``c2_cumulative`` takes up to 10 %
    more. With steps of 10 degrees all three agree to 0.02 %.  Torque varies more within an
    interval.  It needs order 6, and two more spans if keyframes are far apart.  With steps of up to
    170 degrees, two spans are then within 1 % and three within 0.5 %.  A cubic of two spans takes
    10 % more, and ``c2_cumulative`` even more.

    The result is a stationary curve near the cumulative spline; large steps may have better ones
    further away.  For torque, with up to ten keyframes more than 2 rad apart, a second search
    starts from the least acceleration, and the better result counts.  With a fast end the curve
    adds whole turns if that takes less effort.  The method accepts no requested turns, because they
    are no minimum and would unwind.

    * ``"natural"``: free velocity and no acceleration.  With an inertia both are free, and the
      torque there is small; the best possible curve ends without torque.
    * ``"clamped"``: the angular velocity given;
    * ``"state"``: angular velocity and acceleration given.

    Picture: ``orientd plot minimum_effort``.

    Args:
        inertia: about the body's axes, kg m^2, symmetric and positive definite, shape ``(3, 3)``,
            or principal moments, shape ``(3,)``.
        order: degree of the spline plus one, 4 to 6; by default 4 for acceleration, 6 for torque.
        smoothness: number of continuous derivatives at the keyframes, 2 to ``order - 2``, which is
            their number between keyframes.  More cost 1 to 3 % of effort.
        spans: of the spline between two keyframes, 2 to 8.  The default is 2, or 3 for torque with
            the default *order*.  It grows if the effort would exceed that of ``c2_cumulative``, as
            may happen with several radians in a span.

    Raises:
        PlanError: the search does not converge.
    """

    name = "minimum_effort"
    summary = "C2 spline of least squared acceleration or torque, end velocities met"
    source = "Kim, Kim and Shin 1995, sec. 7; Sommer et al. 2020"
    meets_end_accelerations = True
    own: ClassVar[Mapping[str, Any]] = {
        "inertia": None,
        "order": None,
        "smoothness": 2,
        "spans": None,
    }

    def _solve(
        self,
        q: Floats,
        instants: Floats,
        ends: Ends,
        *,
        inertia: ArrayLike | None,
        order: int | None,
        smoothness: int,
        spans: int | None,
    ) -> None:
        matrix = None if inertia is None else check_inertia(inertia)
        usual, usual_spans = (4, 2) if matrix is None else (6, 2 if order else 3)
        k = usual if order is None else check_integer(order, "order", minimum=4, maximum=6)
        smooth = check_integer(smoothness, "smoothness", minimum=2, maximum=k - 2)
        pieces = (
            usual_spans if spans is None else check_integer(spans, "spans", minimum=2, maximum=8)
        )
        first, last = ends
        path, q = start_path(q, instants, first[0], last[0])
        has_acceleration = first[1] is not None or last[1] is not None

        # The search begins with few spans, and adds more to its result.
        is_wide = matrix is not None and bool(np.any(angle(q[1:], q[:-1]) > WIDE))
        wanted = pieces + 2 * is_wide
        near, best = path, None
        error = PlanError(
            f"no curve of less effort than c2_cumulative was found: take more spans, {_MORE}"
        )
        for count in sorted({FEWEST, wanted, *(more * pieces for more in DIVISIONS)}):
            problem = EffortProblem(q, instants, k, smooth, ends, matrix, count)
            try:
                if near is path:
                    solved = problem.solved(path)
                else:
                    solved = problem.least_effort(refined(near, problem.knots, k))
            except PlanError as failed:
                error = failed
                continue
            near = problem.path(solved)
            # The initial spline has no conditions on accelerations at its ends.
            if has_acceleration or problem.is_better(solved, path):
                best = problem, solved
                if count >= wanted:
                    break
        if best is None:
            raise error
        problem, solved = best
        controls = problem.controls(solved)
        self._set_controls(problem.basis, controls, solved, smooth, ends)


@dataclass(frozen=True)
class Linearised:
    """Effort and equations at given increments, with their derivatives.

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

    def merit(self, weights: Floats) -> float:
        """Return the effort plus the errors of the equations, each with its weight."""
        return self.effort + float(weights @ np.sqrt(np.sum(self.missed**2, axis=1)))


class EffortProblem:
    """The increments of least effort on a grid of equal spans between keyframes.

    Attributes:
        knots: of the spline, s.
        basis: the cumulative basis functions on each span.
        inertia: shape ``(3, 3)``; without it effort is squared acceleration.
    """

    def __init__(
        self,
        keys: Floats,
        instants: Floats,
        order: int,
        smoothness: int,
        ends: Ends,
        inertia: Floats | None,
        spans: int,
    ) -> None:
        """Set up the problem for *keys* with their final signs and *spans* per interval."""
        self.knots = effort_knots(instants, order, spans, order - 1 - smoothness)
        self.basis = basis = cumulative_basis(self.knots, order)
        self.inertia = inertia
        self._keys, self._order = keys, order
        self._velocities = (ends[0][0], None), (ends[1][0], None)
        self._steps = between(keys[:-1], keys[1:])
        places = np.minimum(spans * np.arange(len(instants)), len(basis.first))
        self._starts = places[:-1]
        self._window = basis.first[:, None] - 1 + np.arange(order - 1)
        index, share = keyframe_factors(basis, places)
        self._index, self._share = np.ascontiguousarray(index), np.ascontiguousarray(share)
        self._tied, self._factors, self._known = _end_rows(basis, ends, is_free=inertia is not None)
        nodes, weights = np.polynomial.legendre.leggauss(order)
        h = np.diff(basis.breaks)[:, None]
        self._times = (basis.breaks[:-1, None] + 0.5 * h * (1.0 + nodes)).ravel()
        self._at_nodes = basis.at(np.repeat(np.arange(len(h)), order), self._times)
        self._weights = (0.5 * h * weights).ravel()
        self._lay_out()

    def linearised(self, increments: Floats) -> Linearised:
        """Return effort, equations and derivatives, increments of shape ``(count, 3)``."""
        spans, width = len(self._window), 3 * self._window.shape[1]
        count, factors = self._index.shape
        gradient, squares = np.empty((spans, width)), np.empty((spans, width, width))
        bound, missed = np.empty((count, 3, 3 * factors)), np.empty((count, 3))
        effort = linearise_effort(
            np.ascontiguousarray(increments),
            self._window.ravel(),
            self._at_nodes,
            np.sqrt(self._weights),
            np.empty((0, 3)) if self.inertia is None else self.inertia,
            self._index.ravel(),
            self._share,
            self._steps,
            *(gradient, squares, bound, missed),
        )
        reached = np.einsum("ef,efi->ei", self._factors, increments[self._tied])
        missed = np.concatenate([missed, reached - self._known])
        return Linearised(effort, gradient, squares, bound, missed)

    def is_better(self, increments: Floats, path: Path) -> bool:
        """Return whether increments take no more effort than a curve, apart from rounding."""
        _, omega, torque = path(self._times)
        if self.inertia is not None:
            torque = torque @ self.inertia + np.cross(omega, omega @ self.inertia)
        theirs = 0.5 * float(np.sum(self._weights[:, None] * torque**2))
        rounding = ROUNDING * float(np.sum(increments**2)) / float(np.min(self._weights)) ** 3
        return self.linearised(increments).effort <= (1.0 + WORSE) * theirs + rounding

    def solved(self, path: Path) -> Floats:
        """Return increments of stationary effort near a curve, the best ones found.

        For torque, a second search starts from the least acceleration.  It runs if keyframes are
        few and far apart, or if the first one fails.

        Raises:
            PlanError: the search does not converge.
        """
        guesses, inertia = [refined(path, self.knots, self._order)], self.inertia
        missed = self.linearised(guesses[0]).missed
        if self._order == 4 and np.max(np.sum(missed * missed, axis=1)) > FAR**2:
            breaks = self.basis.breaks
            with suppress(PlanError):
                spline = interpolate(path(breaks)[0].copy(), breaks, 4, self._velocities)
                guesses.append(spline[1][2])
        found: list[Floats] = []
        problems: list[PlanError] = []
        for guess in guesses:
            try:
                found.append(self.least_effort(guess))
            except PlanError as error:
                problems.append(error)
        apart = 2.0 * np.arccos(np.minimum(np.abs(self._steps[:, 0]), 1.0))
        is_violent = len(apart) < FEW and bool(np.any(apart > LARGE))
        if inertia is not None and (not found or is_violent):
            with suppress(PlanError):
                self.inertia = None
                eased = self.least_effort(guesses[0])
                self.inertia = inertia
                found.append(self.least_effort(eased))
            self.inertia = inertia
        if not found:
            raise problems[0]
        return min(found, key=lambda one: self.linearised(one).effort)

    def least_effort(self, increments: Floats) -> Floats:
        """Return increments of stationary effort near a guess, shape ``(count, 3)``.

        Raises:
            PlanError: the search does not converge.
        """
        here = self.linearised(increments)
        weights = np.zeros(len(here.missed))
        history: list[tuple[Floats, Floats, Linearised]] = []
        for _ in range(ITERATIONS):
            try:
                step, multipliers = self._step(here)
            except (np.linalg.LinAlgError, ValueError):
                break
            size = _longest(step)
            if not np.isfinite(size):
                break
            weights = np.maximum(weights, 2.0 * np.sqrt(np.sum(multipliers**2, axis=1)))
            is_settled = size <= SETTLED * _longest(increments + step)
            if not is_settled:
                # A mixed step may miss the keyframes by the square of its length, which the next
                # step corrects.  So it need not be better than the worst of the mixed steps.
                history = [*history[-DEPTH:], (increments, step, here)]
                moved = _mixed(history)
                there = self.linearised(increments + moved)
                if there.merit(weights) <= max(one.merit(weights) for *_, one in history):
                    increments, here = increments + moved, there
                    continue
                history = []
            before, share = here.merit(weights), 1.0
            there = self.linearised(increments + step)
            while size > SMALL and not there.merit(weights) <= before + SLACK * abs(before):
                share *= 0.5
                if share < SMALLEST_SHARE:
                    break
                there = self.linearised(increments + share * step)
            if share < SMALLEST_SHARE:
                break
            increments, here = increments + share * step, there
            if is_settled:
                return increments
        raise PlanError(
            "no curve of least effort was found through the keyframes: the search does not settle; "
            + _MORE
        )

    def _lay_out(self) -> None:
        """Set the positions of the blocks of the system in its band."""
        index, tied = self._index, self._tied
        count = int(self._window.max()) + 1
        middles = 0.5 * (index.min(axis=1) + index.max(axis=1)) + 0.25
        order = np.concatenate([np.arange(count), middles, tied.mean(axis=1) + 0.25])
        self._count, self._place = count, np.empty(len(order), dtype=np.intp)
        self._place[np.argsort(order, kind="stable")] = np.arange(len(order))

        def components(numbers: Indices) -> Indices:
            found: Indices = 3 * self._place[numbers][..., None] + np.arange(3)
            return found.reshape(len(numbers), 3 * numbers.shape[1])

        equations = np.arange(count, len(order))[:, None]
        spans = components(self._window)
        blocks = [
            (spans, spans),
            (components(equations[: len(index)]), components(index)),
            (components(equations[len(index) :]), components(tied)),
        ]
        rows = [np.repeat(one, other.shape[1], axis=1).ravel() for one, other in blocks]
        columns = [np.tile(other, one.shape[1]).ravel() for one, other in blocks]
        self._row = np.concatenate([*rows, *columns[1:]])
        self._column = np.concatenate([*columns, *rows[1:]])
        self._ties = np.einsum("ef,ij->eifj", self._factors, np.eye(3)).ravel()

    def _step(self, here: Linearised) -> tuple[Floats, Floats]:
        """Return the Gauss-Newton step, and the multipliers of the equations."""
        size = 3 * len(self._place)
        right = np.zeros((len(self._place), 3))
        np.subtract.at(
            right, self._place[self._window], here.gradient.reshape(*self._window.shape, 3)
        )
        right[self._place[self._count :]] = -here.missed
        bound = [here.bound.ravel(), self._ties]
        entries = np.concatenate([here.squares.ravel(), *bound, *bound])
        # The unknowns are scaled so that rounding treats them equally.
        is_diagonal = self._row == self._column
        scale = np.bincount(self._row[is_diagonal], entries[is_diagonal], minlength=size)
        is_free = scale > 0.0
        scale[is_free] = 1.0 / np.sqrt(scale[is_free])
        reached = np.zeros(size)
        np.maximum.at(reached, self._row, np.abs(entries) * scale[self._column])
        scale[~is_free] = 1.0 / reached[~is_free]
        entries *= scale[self._row] * scale[self._column]
        solution = scale * solve_entries(self._row, self._column, entries, scale * right.ravel())
        found = solution.reshape(-1, 3)[self._place]
        return found[: self._count], found[self._count :]

    def controls(self, solved: Floats) -> Floats:
        """Return the control quaternions; those before a span follow from the keyframes."""
        basis, here = self.basis, self._starts
        first = basis.first - 1
        controls: Floats = np.zeros((len(solved) + 1, 4))
        before = self._keys[:-1]
        for f in reversed(range(basis.values.shape[1])):
            undone = -basis.values[here, f, 0, None] * solved[first[here] + f]
            before = multiply(before, exp_half(undone))
        controls[first[here]] = before
        for span in np.setdiff1d(np.arange(len(first)), here):
            j = int(first[span])
            controls[j] = multiply(controls[j - 1], exp_half(solved[j - 1]))
        return controls

    def path(self, solved: Floats) -> Path:
        """Return the path of increments."""
        first = self.basis.first - 1
        parts = self.controls(solved)[first], first, solved, self.basis.values
        return product_trajectory(self.basis.breaks, parts).sample


def check_inertia(inertia: ArrayLike) -> Floats:
    """Return an inertia over its largest moment, which does not change the minimum."""
    expected = "three moments or a symmetric positive definite 3x3 matrix"
    matrix = check_numbers(inertia, "inertia", expected)
    if matrix.shape == (3,):
        matrix = np.diag(matrix)
    is_matrix = matrix.shape == (3, 3) and bool(np.isfinite(matrix).all())
    moments = np.linalg.eigvalsh(matrix) if is_matrix else np.zeros(3)
    if not moments[0] > 0.0 or np.max(np.abs(matrix - matrix.T)) > 1e-9 * moments[-1]:
        raise ParameterError("inertia", f"inertia must be {expected}, got {inertia!r}")
    scaled: Floats = 0.5 * (matrix + matrix.T) / moments[-1]
    return scaled


def effort_knots(instants: Floats, order: int, spans: int, multiplicity: int) -> Floats:
    """Return the knots: each interval in equal spans, with the given multiplicity at keyframes.

    >>> effort_knots(np.array([0.0, 1.0, 3.0]), 4, 2, 1).tolist()
    [0.0, 0.0, 0.0, 0.0, 0.5, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0]
    """
    shares = np.arange(spans) / spans
    inner = instants[:-1, None] + np.diff(instants)[:, None] * shares
    repeated = np.repeat(inner, [multiplicity] + [1] * (spans - 1), axis=1).ravel()
    ends = np.repeat(instants[0], order), np.repeat(instants[-1], order)
    return np.concatenate([ends[0], repeated[multiplicity:], ends[1]])


def _end_rows(
    basis: CumulativeBasis, ends: Ends, *, is_free: bool
) -> tuple[Indices, Floats, Floats]:
    """Return linear conditions on pairs of the outermost increments, one in each row.

    Returns:
        Indices of the increments, and their factors, shape ``(e, 2)`` each; the right sides,
        half-angle vectors, shape ``(e, 3)``.
    """
    final = int(basis.first[-1]) + basis.values.shape[1] - 2
    rows: list[tuple[tuple[int, int], ArrayLike, Floats]] = []
    for (omega, alpha), outer, inner in ((ends[0], 0, 1), (ends[1], final, final - 1)):
        # Only the outermost function has a slope; only it and the next one have a curvature.
        side = slice(None) if outer == 0 else slice(None, None, -1)
        span, place = (0, 0) if outer == 0 else (-1, -1)
        slope = basis.rates[span, side, place][0]
        curvatures = basis.curvatures[span, side, place][:2]
        if omega is None:
            if not is_free:
                scaled = curvatures / np.max(np.abs(curvatures))
                rows.append(((outer, inner), scaled, np.zeros(3)))
            continue
        settled = omega / (2.0 * slope)
        rows.append(((outer, outer), (1.0, 0.0), settled))
        if alpha is not None:
            # Seen from the end, the rotation of the last factor precedes the others.
            half = 0.5 * alpha if outer == 0 else rotate(exp_half(settled), 0.5 * alpha)
            known = (half - curvatures[0] * settled) / curvatures[1]
            rows.append(((inner, inner), (1.0, 0.0), known))
    index, factors, known = zip(*rows, strict=True) if rows else ((), (), ())
    return (
        np.array(index, dtype=np.intp).reshape(-1, 2),
        np.array(factors, dtype=np.float64).reshape(-1, 2),
        np.array(known, dtype=np.float64).reshape(-1, 3),
    )


def keyframe_factors(basis: CumulativeBasis, places: Indices) -> tuple[Indices, Floats]:
    """Return increments and shares of the factors between each keyframe and the next.

    The partial factors at the first keyframe are undone from the right.  Those passed before the
    second keyframe are completed, and those partial there are begun.  Shares are zero if an
    interval has fewer factors.
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


def refined(path: Path, knots: Floats, order: int) -> Floats:
    r"""Return the increments of a spline close to a curve, half-angle vectors.

    The control point of a spline for knots :math:`t_1, \dots, t_{k-1}` with mean *m* and variance
    *s* is, up to third derivatives, :math:`f(m) - \tfrac{s}{2 (k - 2)} f''(m)`.
    """
    own = np.lib.stride_tricks.sliding_window_view(knots[1:-1], order - 1)
    middle = np.clip(own.mean(axis=1), knots[0], knots[-1])
    spread = np.var(own, axis=1)[:, None] / (order - 2)
    q, omega, alpha = path(middle)
    controls = multiply(q, exp_half(-0.25 * spread * alpha))
    shortest = log_half(between(controls[:-1], controls[1:]))
    # Whole turns between two control quaternions show only in the velocity.
    expected = 0.25 * np.diff(middle)[:, None] * (omega[:-1] + omega[1:])
    lengths = np.sqrt(np.sum(shortest**2, axis=1, keepdims=True))
    axes = shortest / np.where(lengths > 0.0, lengths, 1.0)
    ahead = np.sum(axes * expected, axis=1, keepdims=True) - lengths
    found: Floats = shortest + 2.0 * math.pi * np.round(ahead / (2.0 * math.pi)) * axes
    return found


def _mixed(history: list[tuple[Floats, Floats, Linearised]]) -> Floats:
    """Return the step to the point where linear steps would vanish."""
    increments = np.array([one.ravel() for one, *_ in history])
    steps = np.array([step.ravel() for _, step, _ in history])
    moved, changed = np.diff(increments, axis=0).T, np.diff(steps, axis=0).T
    mixture = np.linalg.lstsq(changed, steps[-1], rcond=1e-8)[0]
    found: Floats = steps[-1] - (moved + changed) @ mixture
    return found.reshape(-1, 3)


def _longest(vectors: Floats) -> float:
    return float(np.sqrt(np.max(np.sum(vectors * vectors, axis=1))))
