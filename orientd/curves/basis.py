r"""B-spline bases on their knot spans, summed to the cumulative bases of Kim, Kim and Shin (1995).

Every basis function is represented on each span by its Bernstein coefficients.  There the
recurrence of Cox and de Boor only adds positive terms, so the values are precise for any order and
any ratio of knot intervals.  Derivatives have their own formulas.  Differences of the values would
cancel on spans much shorter than their neighbours.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from orientd.kernels import fill_basis
from orientd.rotation import Floats

Indices = NDArray[np.intp]
"""Integer indices into an array."""


@dataclass(frozen=True)
class CumulativeBasis:
    r"""The cumulative basis functions that vary on each knot span, with two derivatives.

    On span *s* they are the *m* functions :math:`\tilde B_{i,k}` with *i* from ``first[s]`` to
    ``first[s] + m - 1`` (*i* counts from 1, as in the paper).  Earlier functions are 1 there and
    later ones 0.

    Attributes:
        breaks: start and end of the spans, in seconds, shape ``(S + 1,)``.
        first: index of the first function that varies, shape ``(S,)``.
        values: Bernstein coefficients of the functions, shape ``(S, m, m + 1)``.
        rates: Bernstein coefficients of their derivatives, in 1/s, shape ``(S, m, m)``.
        curvatures: Bernstein coefficients of their second derivatives, in 1/s^2, shape ``(S, m,
            max(m - 1, 1))``.
    """

    breaks: Floats
    first: Indices
    values: Floats
    rates: Floats
    curvatures: Floats

    def at(self, span: Indices, times: Floats) -> Floats:
        """Return values, first and second derivatives at *times* in given spans, ``(3, m, n)``."""
        start, end = self.breaks[span], self.breaks[span + 1]
        u = (times - start) / (end - start)
        found: Floats = np.empty((3, self.values.shape[1], len(times)))
        for order, coefficients in enumerate((self.values, self.rates, self.curvatures)):
            weights = bernstein(coefficients.shape[-1] - 1, u)
            np.einsum("nmd,dn->mn", coefficients[span], weights, out=found[order])
        return found


def bernstein(degree: int, u: Floats) -> Floats:
    """Return ``C(degree, j) u^j (1 - u)^(degree - j)`` in row *j*, shape ``(degree + 1, n)``."""
    weights: Floats = np.zeros((degree + 1, len(u)))
    weights[0] = 1.0
    rest = 1.0 - u
    for level in range(1, degree + 1):
        weights[1 : level + 1] = u * weights[:level] + rest * weights[1 : level + 1]
        weights[0] *= rest
    return weights


def cumulative_basis(knots: Floats, order: int) -> CumulativeBasis:
    r"""Return the cumulative B-spline basis of an order over a knot vector.

    .. math:: \tilde B_{i,k} = \sum_{j \ge i} B_{j,k}, \qquad
              \tilde B_{i,k}' = \frac{k - 1}{t_{i+k-1} - t_i} B_{i,k-1}

    Kim, Kim and Shin (1995), sec. 5.3, after de Boor (1978).  Three corrections of the text:

    - The intervals of :math:`B_{i,1}` are half-open, the last one closed.  Open ones sum to 0 at a
      knot.
    - The sum runs to *i + k - 2* on the support, not to *i + k*.
    - The "further reduction" of the derivative to :math:`B_{i,k-1}` holds only for knots one apart.

    Args:
        knots: non-decreasing, at least ``2 * order`` of them.
        order: degree plus one, at least 2.

    Returns:
        The basis on the spans of non-zero length between ``knots[order - 1]`` and
        ``knots[-order]``.
    """
    spans = np.arange(order - 1, len(knots) - order)
    spans = spans[knots[spans + 1] > knots[spans]]
    count, functions = len(spans), order - 1
    basis = CumulativeBasis(
        breaks=np.append(knots[spans], knots[len(knots) - order]),
        first=spans - order + 2,
        values=np.empty((count, functions, order)),
        rates=np.empty((count, functions, functions)),
        curvatures=np.empty((count, functions, max(functions - 1, 1))),
    )
    vector = np.ascontiguousarray(knots, dtype=np.float64)
    fill_basis(spans, vector, order, basis.values, basis.rates, basis.curvatures)
    return basis
