r"""Position curves in three dimensions of the same kinds as the cumulative orientation curves.

.. math:: p(t) = p_0 + \sum_i \Delta p_i\, \tilde B_{i,k}(t)

Kim, Kim and Shin (1995), sec. 4.2: the curve whose orientation analogue has quaternion products
for the sum.  The two share knots and basis, so a body moves and turns to one rhythm.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves import (
    CumulativeBasis,
    TelescopedEquations,
    begun_shares,
    check_integer,
    check_interval,
    check_vector,
    cumulative_basis,
    end_rows,
    interpolation_knots,
    resolve_knots,
)
from orientd.rotation import Floats


class PositionSpline:
    """A B-spline of positions, held by its increments.

    Args:
        basis: cumulative basis functions, span by span.
        start: control points before the varying ones of each span, m, shape ``(spans, 3)``.
        increments: from each control point to the next, m.
    """

    def __init__(self, *, basis: CumulativeBasis, start: Floats, increments: Floats) -> None:
        self._basis, self._start = basis, start
        window = basis.first[:, None] - 1 + np.arange(basis.values.shape[1])
        self._steps = increments[window]

    @property
    def domain(self) -> tuple[float, float]:
        """The first and the last instant, in seconds."""
        return float(self._basis.breaks[0]), float(self._basis.breaks[-1])

    def evaluate(self, times: ArrayLike) -> tuple[Floats, Floats, Floats]:
        """Return position, velocity and acceleration in m, m/s and m/s^2, shape ``(n, 3)``.

        Raises:
            ValueError: an instant is outside the domain.
        """
        instants = np.asarray(times, dtype=np.float64)
        start, end = self.domain
        slack = 1e-14 * max(abs(start), abs(end))
        if not np.all((instants >= start - slack) & (instants <= end + slack)):
            raise ValueError(f"times must be in the domain [{start!r}, {end!r}] s, got {times!r}")
        instants = np.clip(instants, start, end)
        span = np.searchsorted(self._basis.breaks[1:-1], instants, side="right")
        functions = self._basis.at(span, instants)
        moved = np.einsum("dmn,nmc->dnc", functions, self._steps[span])
        return self._start[span] + moved[0], moved[1], moved[2]


def blended_positions(
    control: ArrayLike, order: int = 4, knots: ArrayLike | None = None
) -> PositionSpline:
    """Return the B-spline of control points, as ``kks_bspline`` is of control quaternions.

    Args:
        control: control points, m, shape ``(n, 3)``, at least *order*.
        order: degree plus one, at least 2.
        knots: ``n + order`` non-decreasing instants, or uniform ones, one second apart, that make
            the curve start at 0.

    Raises:
        ValueError: a parameter is not as said.
    """
    k = check_integer(order, "order", minimum=2)
    points = check_points(control, "control", k)
    basis = cumulative_basis(resolve_knots(knots, len(points), k), k)
    return PositionSpline(
        basis=basis, start=points[basis.first - 1], increments=np.diff(points, axis=0)
    )


def hermite_positions(
    p0: ArrayLike, p1: ArrayLike, v0: ArrayLike, v1: ArrayLike, t0: float = 0.0, t1: float = 1.0
) -> PositionSpline:
    """Return the cubic Hermite curve of two positions and velocities, as ``kks_hermite`` is.

    Args:
        p0: position at *t0*, m.
        p1: position at *t1*, m.
        v0: velocity at *t0*, m/s.
        v1: velocity at *t1*, m/s.
        t0: first instant, s.
        t1: last instant, s.

    Raises:
        ValueError: a parameter is not as said.
    """
    start, end = check_interval(t0, t1)
    third = (end - start) / 3.0
    first, last = check_vector(p0, "p0"), check_vector(p1, "p1")
    leaving, arriving = check_vector(v0, "v0"), check_vector(v1, "v1")
    control = np.stack([first, first + third * leaving, last - third * arriving, last])
    return blended_positions(control, 4, np.repeat([start, end], 4))


def interpolated_positions(
    points: ArrayLike,
    times: Floats,
    order: int = 4,
    start: ArrayLike | None = None,
    end: ArrayLike | None = None,
) -> PositionSpline:
    """Return the B-spline through positions, as ``kks_interpolating`` is through orientations.

    Args:
        points: positions, m, shape ``(n, 3)``, at least two.
        times: increasing instants, shape ``(n,)``.
        order: degree plus one, 3 to 6.
        start: velocity and, for orders 5 and 6, acceleration at the first position, shape
            ``(c, 3)``; without it the end is natural: no acceleration and, for those orders, no
            jerk.
        end: the same at the last position.

    Raises:
        ValueError: a parameter is not as said.
    """
    k = check_integer(order, "order", minimum=3)
    if k > 6:
        raise ValueError(f"order must be 3, 4, 5 or 6, got {order!r}")
    p = check_points(points, "points", 2)
    if len(times) != len(p):
        raise ValueError(f"times must have one number for each of the {len(p)} points")
    basis = cumulative_basis(interpolation_knots(times, k), k)
    shares = begun_shares(basis, times)
    count = basis.values.shape[1] // 2
    head, head_known = end_rows(basis, _derivatives(start, "start", count), is_end=False)
    tail, tail_known = end_rows(basis, _derivatives(end, "end", count), is_end=True)
    increments = TelescopedEquations(
        shares=shares,
        steps=np.diff(p, axis=0),
        head=head,
        head_known=head_known,
        tail=tail,
        tail_known=tail_known,
    ).linear_solution()
    spans = np.arange(len(basis.values))
    base = p[spans].copy()
    for f in range(shares.shape[1]):
        base -= shares[spans, f, None] * increments[spans + f]
    return PositionSpline(basis=basis, start=base, increments=increments)


def check_points(value: ArrayLike, name: str, minimum: int) -> Floats:
    """Return checked positions, shape ``(n, 3)``.

    Raises:
        ValueError: they are not at least *minimum* finite points.
    """
    expected = f"a list of at least {minimum} finite points (x, y, z)"
    try:
        points = np.array(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must be {expected}, got {value!r}") from error
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < minimum:
        raise ValueError(f"{name} must be {expected}, got an array of shape {points.shape}")
    if not np.all(np.isfinite(points)):
        raise ValueError(f"{name} must be {expected}, got one that is not finite")
    return points


def _derivatives(value: ArrayLike | None, name: str, count: int) -> Floats | None:
    if value is None:
        return None
    given = check_points(np.atleast_2d(np.asarray(value)), name, 1)
    if len(given) > count:
        raise ValueError(f"{name} must be at most {count} vectors for this order, got {len(given)}")
    return np.concatenate([given, np.zeros((count - len(given), 3))])
