r"""The fastest way along a path: how quickly to run through it, node by node.

A path has a parameter :math:`\sigma`, and :math:`y = \dot\sigma^2` is sought as a function of it.
What is limited is then a vector of the form (Bobrow, Dubowsky and Gibson 1985)

.. math::
    p' \sqrt y, \qquad
    p'' y + \tfrac12 p' y', \qquad
    \sqrt y\,(p''' y + \tfrac32 p'' y' + \tfrac12 p' y''),

and the duration is :math:`\int d\sigma / \sqrt y`.  Without the jerk this is a convex problem in
*y* (Verscheure, Demeulenaere, Swevers, De Schutter and Diehl 2009, IEEE TAC 54); a limit of the
jerk, :math:`|p''' y + \dots| \le J y^{-1/2}`, is convex on the left and convex on the right, and
the tangent of the right side is an inner approximation (Debrouwere et al. 2013, IEEE TRO 29).

*y* is a uniform cubic B-spline with a knot at every node, and what is limited is looked at there
and half way between.  The problem is solved by a logarithmic barrier with Newton's method, the
tangents taken anew in every step; each Hessian has seven diagonals, so a step costs time
proportional to the number of nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orientd.planner.timing.timing import Indices
from orientd.rotation import Floats

_GAP = 2e-5
"""Share of the duration that the barrier may cost in the end."""

_REDUCTION = 0.1  # of the barrier's weight from one round to the next
_MOST_STEPS = 120
_ROUND_STEPS = 12
_DECREMENT = 0.05  # of a round's barrier weight, squared
_TO_BOUNDARY = 0.98
_LIFTS = (1e-13, 1e-11, 1e-9, 1e-7, 1e-5)  # of the Hessian's diagonal, against rounding
_INSIDE = 0.998  # share of the limits up to which they need not be moved out
_STRETCH = 1.05  # how far beyond the largest share they are moved


@dataclass(frozen=True, slots=True, eq=False)
class Bound:
    """A limit on the length of a vector that is linear in *y* and its derivatives.

    Attributes:
        columns: of *y*, *y'* and *y''*, in units of the limit, shape ``(3, m, k)``.
        is_jerk: whether the limit goes with ``y ** -0.5``.
        places: where it is to be kept, increasing; ``None`` is everywhere.
    """

    columns: Floats
    is_jerk: bool
    places: Indices | None = None

    def gram(self) -> Floats:
        """Return the products of the columns with one another, shape ``(3, 3, m)``."""
        gram: Floats = np.einsum("ank,bnk->abn", self.columns, self.columns)
        return gram


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """What is given at an end that moves.

    Attributes:
        square: *y* there.
        slope: *y'* there.
    """

    square: float
    slope: float


class ProfileError(ArithmeticError):
    """No profile inside the limits was found."""


class Profile:
    """A cubic B-spline *y* over nodes a *step* apart.

    Attributes:
        step: from node to node.
        coefficients: of the B-splines, shape ``(n + 2,)``.
    """

    def __init__(self, step: float, coefficients: Floats) -> None:
        self.step = step
        self.coefficients = coefficients

    def at(self, share: float) -> Floats:
        """Return *y*, *y'* and *y''* at a *share* of the way from each node to the next.

        A share of 0 gives all nodes, shape ``(3, n)``, any other one less.
        """
        c, rows = self.coefficients, _rows(share, self.step)
        count = len(c) - (2 if share == 0.0 else 3)
        windows = np.stack([c[k : k + count] for k in range(3 if share == 0.0 else 4)])
        values: Floats = rows[:, : len(windows)] @ windows
        return values


def _rows(u: float, step: float) -> Floats:
    """Return how value and derivatives come from the coefficients around, shape ``(3, 4)``."""
    value = [(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3]
    slope = [-((1 - u) ** 2), 3 * u**2 - 4 * u, -3 * u**2 + 2 * u + 1, u**2]
    bend = [1 - u, 3 * u - 2, 1 - 3 * u, u]
    return np.array([np.array(value) / 6, np.array(slope) / (2 * step), np.array(bend) / step**2])


def fastest_profile(
    step: float,
    highest: Floats,
    bounds: Sequence[Bound],
    guess: Floats,
    *,
    start: End | None = None,
    end: End | None = None,
) -> Profile:
    """Return the profile of the shortest duration inside the bounds.

    Args:
        step: from node to node.
        highest: largest *y*, finite, at the nodes and half way between them, shape ``(2n - 1,)``.
        bounds: to keep at the same places.
        guess: coefficients to begin with, shape ``(n + 2,)``, positive; need not keep anything.
        start: what is given at the first node; ``None`` leaves it free.
        end: the same at the last node.

    Raises:
        ProfileError: none was found.
    """
    # A step that ends in overflow is none: what is not finite counts as outside.
    with np.errstate(all="ignore"):
        return _Search(step, highest, bounds, start, end).run(guess)


class _Search:
    """The barrier method of :func:`fastest_profile`."""

    def __init__(
        self,
        step: float,
        highest: Floats,
        bounds: Sequence[Bound],
        start: End | None,
        end: End | None,
    ) -> None:
        self._step, self._highest, self._bounds = step, highest, bounds
        self._start, self._end = start, end
        self._grams = [bound.gram() for bound in bounds]
        self._rows = _rows(0.0, step), _rows(0.5, step)
        self._weights = np.full(len(highest), step / 3)
        self._weights[1::2] = 2 * step / 3
        self._weights[[0, -1]] = step / 6
        self.steps = 0

    def run(self, guess: Floats) -> Profile:
        c = self._with_ends(guess)
        z = self._at_points(c)
        if not np.all(z[0] > 0.0):
            raise ProfileError("the guess is not positive")
        segment = self._stretch(z)
        degree = len(z[0]) + 2 * sum(gram.shape[2] for gram in self._grams)
        weight = self._duration(z) / degree
        while True:
            c, z = self._centre(c, z, weight, segment)
            if segment > 1.0:
                # Limits that were moved out for the guess are moved in again as it improves.
                segment = min(self._stretch(z), max(1.0, 0.999 * segment))
            elif weight * degree <= _GAP * self._duration(z):
                return Profile(self._step, c)
            else:
                weight *= _REDUCTION
            if self.steps > _MOST_STEPS:
                if segment > 1.0:
                    raise ProfileError("the limits leave no way along the path")
                return Profile(self._step, c)

    def _stretch(self, z: Floats) -> float:
        """Return by what factor to move the limits out, so that *z* is well inside."""
        share = self._largest_share(z)
        return 1.0 if share < _INSIDE else _STRETCH * share

    def _centre(self, c: Floats, z: Floats, weight: float, segment: float) -> tuple[Floats, Floats]:
        """Take Newton steps on duration and barrier."""
        cost = self._cost(z, weight, segment)
        for _ in range(_ROUND_STEPS):
            self.steps += 1
            direction, decrement = self._newton(z, weight, segment)
            if decrement <= _DECREMENT * weight:
                break
            dz = self._at_points(direction)
            length = 1.0
            for _ in range(40):
                ahead = z + length * dz
                new = self._cost(ahead, weight, segment)
                if new <= cost - 0.1 * length * decrement:
                    break
                length *= 0.5
            else:
                break
            c, z, cost = c + length * direction, ahead, new
        return c, z

    def _newton(self, z: Floats, weight: float, segment: float) -> tuple[Floats, float]:
        """Return the step of Newton's method and its decrement, squared."""
        y = z[0]
        gradient = np.zeros((3, len(y)))
        hessian = np.zeros((3, 3, len(y)))
        gradient[0] = -0.5 * self._weights * y**-1.5
        hessian[0, 0] = 0.75 * self._weights * y**-2.5
        room = self._highest * segment - y
        gradient[0] += weight / room
        hessian[0, 0] += weight / room**2
        for bound, gram in zip(self._bounds, self._grams, strict=True):
            at = slice(None) if bound.places is None else bound.places
            here = z[:, at]
            pull = np.einsum("abn,bn->an", gram, here)
            slack, change, square = self._slack(bound, here, pull, segment)
            # Of L(y)^2 - |v|^2, with the tangent of L in the Hessian.
            g = -2.0 * pull
            g[0] += change
            gradient[:, at] -= weight / slack * g
            hessian[:, :, at] += weight * (g[:, None] * g[None] / slack**2 + 2.0 * gram / slack)
            hessian[0, 0, at] -= weight * 2.0 * square / slack
        return self._solve(gradient, hessian)

    def _slack(
        self, bound: Bound, z: Floats, pull: Floats, segment: float
    ) -> tuple[Floats, Floats | float, Floats | float]:
        """Return ``L^2 - |v|^2``, the slope of ``L^2`` and the square of the slope of ``L``."""
        length = np.einsum("an,an->n", z, pull)
        if not bound.is_jerk:
            return segment**2 - length, 0.0, 0.0
        y = z[0]
        squared = segment**2 / y
        return squared - length, -squared / y, 0.25 * squared / y**2

    def _cost(self, z: Floats, weight: float, segment: float) -> float:
        """Return duration and barrier, infinite outside."""
        y = z[0]
        room = self._highest * segment - y
        if not (np.all(y > 0.0) and np.all(room > 0.0)):
            return np.inf
        barrier = np.log(room).sum()
        for bound, gram in zip(self._bounds, self._grams, strict=True):
            here = z if bound.places is None else z[:, bound.places]
            pull = np.einsum("abn,bn->an", gram, here)
            slack, _, _ = self._slack(bound, here, pull, segment)
            if not np.all(slack > 0.0):
                return np.inf
            barrier += np.log(slack).sum()
        return float(self._duration(z) - weight * barrier)

    def _duration(self, z: Floats) -> float:
        return float(np.sum(self._weights / np.sqrt(z[0])))

    def _largest_share(self, z: Floats) -> float:
        """Return by what factor the limits would have to be higher."""
        share = float(np.max(z[0] / self._highest))
        for bound, gram in zip(self._bounds, self._grams, strict=True):
            here = z if bound.places is None else z[:, bound.places]
            length = np.sqrt(np.maximum(np.einsum("abn,an,bn->n", gram, here, here), 0.0))
            if bound.is_jerk:
                length *= np.sqrt(here[0])
            share = max(share, float(length.max()))
        return share

    # Ends and linear algebra

    def _at_points(self, c: Floats) -> Floats:
        count = len(c) - 3
        z = np.empty((3, 2 * count + 1))
        at_nodes, between = self._rows
        z[:, ::2] = at_nodes[:, :3] @ np.stack([c[k : k + count + 1] for k in range(3)])
        z[:, 1::2] = between @ np.stack([c[k : k + count] for k in range(4)])
        return z

    def _with_ends(self, c: Floats) -> Floats:
        c = c.copy()
        h = self._step
        if self._start is not None:
            c[0] = c[2] - 2 * h * self._start.slope
            c[1] = (6 * self._start.square - c[0] - c[2]) / 4
        if self._end is not None:
            c[-1] = c[-3] + 2 * h * self._end.slope
            c[-2] = (6 * self._end.square - c[-1] - c[-3]) / 4
        return c

    def _solve(self, gradient: Floats, hessian: Floats) -> tuple[Floats, float]:
        from scipy.linalg import LinAlgError, solveh_banded

        nodes = (gradient.shape[1] + 1) // 2
        # Upper form: band[3 - (j - i), j] is the entry of row i and column j.
        band, right = np.zeros((4, nodes + 2)), np.zeros(nodes + 2)
        for first, width in ((0, 3), (1, 4)):
            rows = self._rows[first][:, :width]
            local = np.einsum("ai,abn,bj->ijn", rows, hessian[..., first::2], rows, optimize=True)
            slope = rows.T @ gradient[:, first::2]
            count = slope.shape[1]
            for i in range(width):
                right[i : i + count] -= slope[i]
                for j in range(i, width):
                    band[3 - (j - i), j : j + count] += local[i, j]
        if self._start is not None:
            _tie(band, right)
        if self._end is not None:
            flipped, back = _flipped(band), right[::-1]
            _tie(flipped, back)
            band, right = _flipped(flipped), back[::-1]
        if not np.all(band[3] > 0.0):
            # Rounding has eaten up the curvature: there is no way on from here.
            return np.zeros(nodes + 2), 0.0
        scale = 1.0 / np.sqrt(band[3])
        for apart in range(4):
            band[3 - apart, apart:] *= scale[apart:] * scale[: len(scale) - apart]
        for lift in _LIFTS:
            band[3] += lift
            try:
                solution = solveh_banded(band, scale * right, check_finite=False)
            except LinAlgError:
                continue
            break
        else:
            raise ProfileError("the search broke down")
        direction: Floats = scale * solution
        decrement = float(direction @ right)
        if self._start is not None:
            direction[0], direction[1] = direction[2], -0.5 * direction[2]
        if self._end is not None:
            direction[-1], direction[-2] = direction[-3], -0.5 * direction[-3]
        return direction, decrement


_TIES = np.eye(6)[:, 2:]
_TIES[:2, 0] = 1.0, -0.5


def _tie(band: Floats, right: Floats) -> None:
    """Make the first two unknowns go with the third, as value and slope at the node say.

    With both given, a change *x* of the third changes the first by *x* and the second by -x/2.
    """
    corner = np.zeros((6, 6))
    for apart in range(4):
        for column in range(apart, 6):
            corner[column - apart, column] = corner[column, column - apart] = band[
                3 - apart, column
            ]
    tied = np.eye(6)
    tied[2:, 2:] = _TIES.T @ corner @ _TIES
    for apart in range(4):
        for column in range(apart, 6):
            band[3 - apart, column] = tied[column - apart, column]
    right[2] += right[0] - 0.5 * right[1]
    right[:2] = 0.0


def _flipped(band: Floats) -> Floats:
    """Return the band of the same matrix with rows and columns in reverse order."""
    flipped = np.zeros_like(band)
    for apart in range(len(band)):
        row = len(band) - 1 - apart
        flipped[row, apart:] = band[row, apart:][::-1]
    return flipped
