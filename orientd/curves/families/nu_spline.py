"""The normalised nu-spline: a cubic spline in four dimensions with tension at the keyframes."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import Jet, rates, solve_banded, unit
from orientd.curves.contract import Curve, Samples, takes_common_names
from orientd.curves.keyframes import ParameterError, check_aligned, resolve_times
from orientd.errors import PlanError
from orientd.rotation import Floats


class NuSpline(Curve):
    r"""Interpolate quaternions by a cubic spline with tension, made unit.

    .. math:: \min \int \|c''\|^2 dt + \sum_i \nu_i \|c'(t_i)\|^2, \qquad q = c / \|c\|

    Nielson (1986; 1993, sec. 2.2).  Tension slows the curve at its keyframe and pulls kinks out.
    The acceleration jumps there by :math:`\nu_i` times the velocity, along it: the path has
    continuous curvature (G2) while the motion is C1; without tension it is C2.

    Picture: ``orientd plot nu_spline``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        nu: tension, not negative, in 1/s: one number, or one for each keyframe, the ends
            included.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
    """

    name = "nu_spline"
    summary = "normalised cubic spline with tension at the keyframes"
    source = "Nielson 1986; Nielson 1993, sec. 2.2"
    interpolates = True
    takes: ClassVar[tuple[str, ...]] = ("keys", "times", "nu", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        nu: float | ArrayLike = 0.0,
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align)
        tension = check_tension(nu, len(q))
        instants = resolve_times(times, q)
        super().__init__(knots=instants, continuity=1 if np.any(tension[1:-1] > 0.0) else 2)
        self._keys = q
        self._key_slopes = spline_slopes(q, instants, tension)

    def _sample(self, times: Floats) -> Samples:
        span = self._segments(times)
        c = hermite_jet(self._keys, self._key_slopes, self._knots, span, times)
        square = np.sum(c.value * c.value, axis=-1)
        if not np.all(square > 1e-24):
            instant = float(times[int(np.argmin(square))])
            raise PlanError(
                f"the spline passes through zero at t = {instant!r} s and has no direction there; "
                "put a keyframe in between"
            )
        return rates(unit(c))


def check_tension(nu: object, count: int) -> Floats:
    """Return a tension for each of *count* keyframes.

    Raises:
        ValueError: *nu* is neither one number nor one for each keyframe, or one is negative or
            not finite.
    """
    expected = f"a number or one for each of the {count} keyframes, not negative"
    try:
        array = np.asarray(nu)
    except ValueError as error:
        raise ParameterError("nu", f"nu must be {expected}, got {nu!r}") from error
    if array.dtype.kind not in "iuf" or array.shape not in ((), (count,)):
        raise ParameterError("nu", f"nu must be {expected}, got {nu!r}")
    tension: Floats = np.full(count, array, dtype=np.float64)
    if not np.all(np.isfinite(tension) & (tension >= 0.0)):
        raise ParameterError("nu", f"nu must be {expected}, got {nu!r}")
    return tension


def spline_slopes(points: Floats, times: Floats, tension: Floats) -> Floats:
    r"""Return the slopes :math:`m_i` of the spline at its points.

    It is a cubic in each interval, and the slopes are continuous, as they satisfy

    .. math:: \frac{2 m_{i-1} + 4 m_i}{h_{i-1}} + \frac{4 m_i + 2 m_{i+1}}{h_i} + \nu_i m_i =
              \frac{6 \Delta_{i-1}}{h_{i-1}^2} + \frac{6 \Delta_i}{h_i^2}

    (Nielson, 1986).  Without tension it is the natural cubic spline.

    Args:
        points: shape ``(n, d)``.
        times: increasing instants, shape ``(n,)``.
        tension: not negative, shape ``(n,)``.

    Returns:
        Shape ``(n, d)``.  Time and memory grow linearly.
    """
    h = np.diff(times)
    pull = 6.0 * np.diff(points, axis=0) / (h * h)[:, None]
    bands = np.zeros((3, len(points)))
    bands[0, 1:] = bands[2, :-1] = 2.0 / h
    bands[1] = tension
    bands[1, :-1] += 4.0 / h
    bands[1, 1:] += 4.0 / h
    right = np.zeros_like(points)
    right[:-1] += pull
    right[1:] += pull
    return solve_banded(1, 1, bands, right)


def hermite_jet(
    points: Floats, slopes: Floats, times: Floats, span: np.ndarray, instants: Floats
) -> Jet:
    """Return value, velocity and acceleration of the cubics with given end values and slopes.

    Args:
        points: values at *times*, shape ``(n, d)``.
        slopes: derivatives at *times*.
        times: the break points.
        span: index of the interval of each instant.
        instants: where to evaluate, shape ``(m,)``.
    """
    h = (times[span + 1] - times[span])[:, None]
    u = (instants - times[span])[:, None] / h
    step = points[span + 1] - points[span]
    leave, arrive = h * slopes[span] - step, h * slopes[span + 1] - step
    rest = 1.0 - u
    value = points[span] + u * (step + rest * (rest * leave - u * arrive))
    first = step + rest * (1.0 - 3.0 * u) * leave + u * (3.0 * u - 2.0) * arrive
    second = (6.0 * u - 4.0) * leave + (6.0 * u - 2.0) * arrive
    return Jet(value, first / h, second / (h * h))
