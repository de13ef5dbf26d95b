r"""Products of exponentials: one construction, defined by knots and increments.

.. math:: q(t) = q_0 \prod_j \exp\bigl(w_j \tilde B_j(t)\bigr)

The functions :math:`\tilde B_j` are cumulative B-splines (Kim, Kim and Shin, 1995), each of which
rises from 0 to 1 over a few knots.  Increments :math:`w_j` are half-angle vectors of any length.
A length above pi is extra winding, which the control quaternions alone do not show.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.basis import CumulativeBasis, Indices, cumulative_basis
from orientd.curves.contract import FREE, Between, Curve, Drawn, DrawnOverKnots, Ends, Through
from orientd.curves.keyframes import (
    ParameterError,
    check_choice,
    check_integer,
    check_interval,
    check_number,
    check_vector,
    increments,
    inner_multiplicity,
)
from orientd.curves.trajectory import Samples, Trajectory
from orientd.rotation import Floats, between, conjugate, log_half, multiply, nearer_sign

PATHS = ("short", "long", "as_is", "complement")
_COINCIDENT = 1e-14
_CUTS = (0.01, 1), (0.1, 2)  # half angle in rad, and pieces of a span that it takes
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)

Parts = tuple[Floats, Indices, Floats, Floats]
"""The parts of a product.

The quaternion before the product of each span, ``(S, 4)``; the index of its first increment,
``(S,)``; all increments, half-angle vectors, ``(n, 3)``; and the Bernstein coefficients of its
functions, ``(S, m, m + 1)``.
"""

Path = Callable[[Floats], Samples]
"""Orientation, angular velocity and angular acceleration at given times."""


class Product(Curve):
    """A cumulative product over a B-spline basis."""

    def _set_parts(
        self,
        breaks: Floats,
        parts: Parts,
        continuity: int,
        ends: Ends | None = None,
    ) -> None:
        """Set up the curve over its spans, with the conditions at both ends."""
        self._set_knots(breaks, continuity)
        self._parts = parts
        self._ends = self._ends if ends is None else ends

    def _set_controls(
        self,
        basis: CumulativeBasis,
        controls: Floats,
        vectors: Floats,
        continuity: int,
        ends: Ends | None = None,
    ) -> None:
        """Set up the curve of control quaternions, ``(n + 1, 4)``, and increments, ``(n, 3)``."""
        first = np.ascontiguousarray(basis.first - 1, dtype=np.int64)
        parts = controls[first], first, np.ascontiguousarray(vectors), basis.values
        self._set_parts(basis.breaks, parts, continuity, ends)

    @property
    def parts(self) -> Parts:
        """The parts of the product; do not change them."""
        return self._parts

    @property
    def increments(self) -> Floats:
        """Half-angle vectors from each control quaternion to the next; read only, ``(n, 3)``."""
        view = self._parts[2].view()
        view.setflags(write=False)
        return view

    @cached_property
    def trajectory(self) -> Trajectory:
        """See :attr:`Curve.trajectory`: pieces as short as the largest increment requires."""
        return product_trajectory(self._knots, self._parts, self.continuity, self._ends)


def product_trajectory(
    breaks: Floats,
    parts: Parts,
    continuity: int = 2,
    ends: Ends = (FREE, FREE),
) -> Trajectory:
    """Return the trajectory of a product, which need not be a curve of a family."""
    largest = float(np.max(np.abs(parts[2])))
    cuts = next((count for most, count in _CUTS if largest < most), 4)
    return Trajectory.of_product(breaks, parts, ends=ends, continuity=continuity, cuts=cuts)


def squared_acceleration(path: Path, times: Floats) -> float:
    """Return the integral of squared angular acceleration, by Gauss's rule in each interval."""
    h = np.diff(times)[:, None]
    alpha = path((times[:-1, None] + 0.5 * h * (1.0 + _NODES)).ravel())[2]
    squares = np.sum(alpha * alpha, axis=1).reshape(len(h), -1)
    return float(np.sum(0.5 * h * _WEIGHTS * squares))


class Slerp(Product, Between):
    r"""Turn at constant angular velocity about one axis.

    .. math:: q(t) = q_0 \exp\bigl(u (\theta + n \pi) a\bigr), \quad u = (t - t_0) / (t_1 - t_0)

    with :math:`\theta a = \log(q_0^{-1} q_1)` in half angles (Shoemake, 1985).  Every uniform turn
    from one orientation to another about one axis has this form.  Nielson's (1993) spin of a whole
    turn prints :math:`\sqrt{2t - 4t^2}`.  Even if corrected to :math:`\sqrt{4t - 4t^2}`, it starts
    and ends with unbounded velocity.  Use ``spins=1`` and ``axis`` instead.

    Picture: ``orientd plot slerp``.

    Args:
        path: ``"short"`` and ``"long"`` choose the sign of *q1*; ``"as_is"`` keeps it;
            ``"complement"`` takes the rest of the great circle of ``"as_is"`` (course notes on
            quaternion interpolation).
        spins: whole turns to add, negative ones in the opposite direction.
        axis: body axis for equal orientations, which do not define one; otherwise unused.
    """

    name = "slerp"
    summary = "one great arc at constant velocity, with whole turns if wanted"
    source = "Shoemake 1985"
    own: ClassVar[Mapping[str, Any]] = {"path": "short", "spins": 0, "axis": None}

    def _solve(
        self,
        start: Floats,
        end: Floats,
        interval: tuple[float, float],
        *,
        path: str,
        spins: int,
        axis: ArrayLike | None,
    ) -> None:
        path = check_choice(path, "path", PATHS)
        turns = check_integer(spins, "spins")
        relative = between(start, end)
        if path in ("short", "long"):
            relative *= nearer_sign(*relative.tolist()) * (1.0 if path == "short" else -1.0)
        angle = math.atan2(float(np.linalg.norm(relative[1:])), float(relative[0]))
        angle += turns * math.pi - (2.0 * math.pi if path == "complement" else 0.0)
        direction = log_half(relative)
        given = None if axis is None else check_vector(axis, "axis")
        if np.linalg.norm(relative[1:]) <= _COINCIDENT and abs(angle) > _COINCIDENT:
            if given is None or not given.any():
                raise ParameterError(
                    "axis",
                    "axis must be given, and not zero, for a turn between orientations that "
                    f"coincide, got {axis!r}",
                )
            direction = given
        length = float(np.linalg.norm(direction))
        increment = direction * (angle / length if length > 0.0 else 0.0)
        self._set_controls(
            cumulative_basis(np.repeat(interval, 2), 2), np.stack([start, end]), increment[None], 2
        )


class PiecewiseSlerp(Product, Through):
    r"""Join keyframes by great arcs; the angular velocity jumps at every keyframe.

    .. math:: q(t) = q_i \exp\bigl(u \log(q_i^{-1} q_{i+1})\bigr), \quad
              u = (t - t_i) / (t_{i+1} - t_i)

    Shoemake (1985); Kim, Kim and Shin (1995), sec. 4.1.  The ramp printed there rises on ``[i-1,
    i]`` although the text has the arc from ``q_i`` to ``q_{i+1}``: read ``q_i exp(w_{i+1}
    alpha_{i+1})``.

    Picture: ``orientd plot piecewise_slerp``.

    Example:
        >>> curve = PiecewiseSlerp(keys=[[1, 0, 0, 0], [0, 0, 0, 1]], times=[0.0, 2.0])
        >>> q, omega_body, alpha_body = curve.evaluate([1.0])
        >>> omega_body.round(6).tolist()
        [[0.0, 0.0, 1.570796]]
    """

    name = "piecewise_slerp"
    summary = "great arcs between keyframes, velocity jumps at each"
    source = "Shoemake 1985; Kim, Kim and Shin 1995, sec. 4.1"
    local = True

    def _solve(self, q: Floats, instants: Floats) -> None:
        knots = np.concatenate([instants[:1], instants, instants[-1:]])
        self._set_controls(cumulative_basis(knots, 2), q, increments(q), 0)


class KksBezier(Product, Drawn):
    r"""Blend control quaternions with the cumulative Bernstein basis.

    .. math:: q(t) = q_0 \prod_{i=1}^n
              \exp\bigl(\log(q_{i-1}^{-1} q_i)\, \tilde\beta_{i,n}(u)\bigr), \quad
              \tilde\beta_{i,n}(u) = \sum_{j=i}^n \tbinom{n}{j} (1-u)^{n-j} u^j

    Kim, Kim and Shin (1995), eqs. (9) and (10).  The appendix prints the exponent ``n-i`` for
    ``n-j`` in the basis; the body of the paper has it right.  "Order n" there is degree n.  The
    curve passes through the first and the last control quaternion.

    Picture: ``orientd plot kks_bezier``.
    """

    name = "kks_bezier"
    summary = "one smooth segment drawn by control orientations"
    source = "Kim, Kim and Shin 1995, eq. (10)"
    own: ClassVar[Mapping[str, Any]] = {"t0": 0.0, "t1": 1.0}

    def _solve(self, controls: Floats, *, t0: float, t1: float) -> None:
        knots = np.repeat(check_interval(t0, t1), len(controls))
        self._set_controls(
            cumulative_basis(knots, len(controls)), controls, increments(controls), 2
        )


class KksBspline(Product, DrawnOverKnots):
    r"""Blend control quaternions with the cumulative B-spline basis; control is local.

    .. math:: q(t) = q_{l-k+1} \prod_{i=l-k+2}^{l}
              \exp\bigl(\log(q_{i-1}^{-1} q_i)\, \tilde B_{i,k}(t)\bigr),
              \quad t_l \le t < t_{l+1}

    Kim, Kim and Shin (1995), sec. 5.3.  Moving control quaternion *l* changes the curve on
    :math:`[t_l, t_{l+k}]` only.  In places, the text names the increments and control quaternions
    of the span form one index too low; the formula itself is right.  The appendix defines the curve
    outside the domain by a power of the first quaternion.  This depends on the world frame, so
    times outside the domain are refused.

    Picture: ``orientd plot kks_bspline``.
    """

    name = "kks_bspline"
    summary = "C2 blending with local control; does not meet its control orientations"
    source = "Kim, Kim and Shin 1995, sec. 5.3"
    local = True

    def _solve(self, controls: Floats, order: int, vector: Floats) -> None:
        repeated = inner_multiplicity(vector, order)
        self._set_controls(
            cumulative_basis(vector, order),
            controls,
            increments(controls),
            order - 1 - repeated if repeated else 2,
        )


class KksUniform(Product, Drawn):
    r"""Blend control quaternions at equal intervals, through the first and the last.

    .. math:: q(t) = q_{-1} \prod_{i=0}^{n+1}
              \exp\bigl(\log(q_{i-1}^{-1} q_i) \, \tilde B_{i,4}(t)\bigr)

    The cumulative cubic B-spline over the knots :math:`t_i = i - 2`, with phantom control
    quaternions :math:`q_{-1} = q_0 q_1^{-1} q_0` and :math:`q_{n+1} = q_n q_{n-1}^{-1} q_n`, on
    :math:`[0, n]` (Kim, Kim and Shin, 1995, appendix).  The appendix prints the second phantom as
    :math:`q_n q_n^{-1} q_n`, with which the curve misses :math:`q_n`.  The curve approaches the
    inner control quaternions without passing through them.

    Picture: ``orientd plot kks_uniform``.

    Args:
        t1: end time, s; ``None`` puts the control quaternions one second apart.
    """

    name = "kks_uniform"
    summary = "C2 blending at one orientation a second, ends met"
    source = "Kim, Kim and Shin 1995, appendix"
    local = True
    own: ClassVar[Mapping[str, Any]] = {"t0": 0.0, "t1": None}

    def _solve(self, inner: Floats, *, t0: float, t1: float | None) -> None:
        controls = with_phantoms(inner)
        spans = len(inner) - 1
        start, end = check_interval(t0, check_number(t0, "t0") + spans if t1 is None else t1)
        knots = start + np.arange(-3.0, spans + 4.0) * ((end - start) / spans)
        knots[3 + spans] = end
        self._set_controls(cumulative_basis(knots, 4), controls, increments(controls), 2)


def with_phantoms(q: Floats) -> Floats:
    """Return keyframes with one more at each end: the neighbour reflected, ``q_0 q_1^-1 q_0``."""
    ends, neighbours = q[[0, -1]], q[[1, -2]]
    first, last = multiply(ends, multiply(conjugate(neighbours), ends))
    return np.concatenate([first[None], q, last[None]])
