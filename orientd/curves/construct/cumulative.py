r"""The curves that are one cumulative product: what the families of Kim, Kim and Shin share.

.. math:: q(t) = q_0 \prod_j \exp\bigl(w_j \tilde B_j(t)\bigr)

With :math:`w_j = \theta_j a_j`, :math:`|a_j| = 1`, and :math:`x_j = \theta_j \tilde B_j`, each
factor turns about a fixed axis, and body velocity and acceleration follow factor by factor
(compare Sommer et al., 2020, for the same recursion):

.. math::
    \omega &\leftarrow R_j^T \omega + 2 x_j' a_j \\
    \alpha &\leftarrow R_j^T \alpha + (R_j^T \omega) \times 2 x_j' a_j + 2 x_j'' a_j

where :math:`R_j` is the rotation of :math:`\exp(x_j a_j)`.  Increments are half-angle vectors of
any length: a length above pi is extra winding, which the control quaternions alone do not show.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct.basis import CumulativeBasis
from orientd.curves.construct.interpolation import Spline
from orientd.curves.contract import Curve, Samples, check_out, in_shape
from orientd.kernels import put_table, sample_cubic, sample_product
from orientd.rotation import Floats

TABLE_ROWS = 25
"""Numbers that a span of three cubic factors is sampled from: base quaternion, then for each factor
four Taylor coefficients of the half angle, the factorials divided out, and the unit axis."""

_FACTORIALS = np.array([1.0, 1.0, 2.0, 6.0])


class CumulativeCurve(Curve):
    """A cumulative product over a B-spline basis: what the families of Kim, Kim and Shin share.

    Args:
        basis: the cumulative basis functions that vary on each span.
        controls: control quaternions, shape ``(n + 1, 4)``, the signs as the product needs them.
        increments: half-angle vectors from each control quaternion to the next, ``(n, 3)``.
        continuity: what holds at the knots.
    """

    _table: Floats | None
    _at_ends: Floats | None = None

    def __init__(
        self, *, basis: CumulativeBasis, controls: Floats, increments: Floats, continuity: int
    ) -> None:
        functions = basis.values.shape[1]
        window = basis.first[:, None] - 1 + np.arange(functions)
        lengths = np.sqrt(np.sum(increments**2, axis=-1))
        axes = increments / np.where(lengths > 0.0, lengths, 1.0)[:, None]
        base = controls[window[:, 0]].T
        if functions <= 3:
            table: Floats = np.zeros((TABLE_ROWS, len(window)))
            table[:4] = base
            factors = table[4:].reshape(3, 7, -1)
            taylor = basis.taylor() * lengths[window][..., None] / _FACTORIALS
            factors[:functions, :4] = taylor.transpose(1, 2, 0)
            factors[:functions, 4:] = axes[window].transpose(1, 2, 0)
            self._set_table(basis.breaks, table, increments, continuity)
            return
        names = ("values", "rates", "curvatures")
        self._set_factors(
            replace(basis, **{name: np.ascontiguousarray(getattr(basis, name)) for name in names}),
            np.ascontiguousarray(base),
            np.ascontiguousarray(axes[window].transpose(1, 2, 0)),
            np.ascontiguousarray(lengths[window].T),
            increments,
            continuity,
        )

    def _set_factors(
        self,
        basis: CumulativeBasis,
        base: Floats,
        axes: Floats,
        lengths: Floats,
        increments: Floats,
        continuity: int,
    ) -> None:
        """Set up a curve of any factors; all arrays are C-contiguous.

        Args:
            basis: as for the constructor.
            base: the quaternion before the product of each span, shape ``(4, S)``.
            axes: unit axes of the factors, shape ``(m, 3, S)``.
            lengths: their half angles, shape ``(m, S)``.
            increments: as for the constructor.
            continuity: likewise.
        """
        super().__init__(knots=basis.breaks, continuity=continuity)
        self._table = None
        self._increments = increments
        self._basis, self._base, self._axes, self._lengths = basis, base, axes, lengths

    def _set_table(
        self, breaks: Floats, table: Floats, increments: Floats, continuity: int
    ) -> None:
        """Set up a curve of cubic factors.

        Args:
            breaks: where its spans begin and end, s, shape ``(S + 1,)``.
            table: base quaternion, and of each factor the coefficients of the half angle and the
                axis, shape ``(TABLE_ROWS, S)``.
            increments: as for the constructor.
            continuity: likewise.
        """
        super().__init__(knots=breaks, continuity=continuity)
        self._table = table
        self._increments = increments

    def _set_spline(self, spline: Spline) -> None:
        """Set up a cubic curve with simple knots."""
        breaks, base, increments, _ = spline
        table: Floats = np.empty((TABLE_ROWS, len(base)))
        put_table(breaks, base, increments, table)
        self._set_table(breaks, table, increments, 2)

    def _set_ends(self, rows: Floats) -> None:
        """Take note of what it is at both ends, shape ``(10, 2)``."""
        self._at_ends = rows

    def ends(self) -> Samples:
        """See :meth:`Curve.ends`."""
        rows = self._at_ends
        return super().ends() if rows is None else (rows[:4].T, rows[4:7].T, rows[7:].T)

    @property
    def increments(self) -> Floats:
        """Half-angle vectors from each control quaternion to the next; read only, ``(n, 3)``."""
        view = self._increments.view()
        view.setflags(write=False)
        return view

    @property
    def parts(self) -> tuple[Floats, ...]:
        """What the kernels sample it from.

        Breaks and table if its factors are cubic; breaks, base, axes, lengths and the coefficients
        of the basis otherwise.
        """
        if self._table is not None:
            return self._knots, self._table
        basis = self._basis
        factors = self._base, self._axes, self._lengths
        return self._knots, *factors, basis.values, basis.rates, basis.curvatures

    @property
    def spans_and_factors(self) -> tuple[int, int]:
        """How many spans it has, and how many factors unless these are cubic: then 0."""
        return len(self._knots) - 1, 0 if self._table is not None else len(self._lengths)

    @property
    def table(self) -> Floats | None:
        """What a curve of cubic factors is sampled from, ``(25, S)``; ``None`` for others."""
        return self._table

    def evaluate(self, times: ArrayLike, *, out: Floats | None = None) -> Samples:
        """See :meth:`Curve.evaluate`."""
        instants = np.asarray(times, dtype=np.float64)
        is_row = instants.ndim == 1
        flat = instants if is_row and instants.flags.c_contiguous else instants.ravel()
        if out is None:
            out = np.empty((10, len(flat)))
        else:
            check_out(out, len(flat))
        if self._table is not None:
            place = sample_cubic(flat, self._knots, self._table, self._slack, out)
        else:
            knots, base, axes, lengths, values, rates, curvatures = self.parts
            place = sample_product(
                flat, knots, base, axes, lengths, values, rates, curvatures, self._slack, out
            )
        if place >= 0:
            self._inside(flat)
        samples = out.T
        q, omega_body, alpha_body = samples[:, :4], samples[:, 4:7], samples[:, 7:]
        if is_row:
            return q, omega_body, alpha_body
        return in_shape(instants.shape, q, omega_body, alpha_body)

    def _sample(self, times: Floats) -> Samples:
        return self.evaluate(times)
