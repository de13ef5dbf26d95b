r"""Cubic splines in a vector space by their slopes: interpolation with tension at the points.

The curve of least

.. math:: \int \|c''\|^2 dt + \sum_i \nu_i \|c'(t_i)\|^2

through given points is a cubic in each interval with continuous slopes :math:`m_i`, which satisfy

.. math:: \frac{2 m_{i-1} + 4 m_i}{h_{i-1}} + \frac{4 m_i + 2 m_{i+1}}{h_i} + \nu_i m_i =
          \frac{6 \Delta_{i-1}}{h_{i-1}^2} + \frac{6 \Delta_i}{h_i^2}

(Nielson, 1986).  Without tension it is the natural cubic spline.
"""

from __future__ import annotations

import numpy as np

from orientd.curves.construct.banded import solve_banded
from orientd.curves.construct.jets import Jet, rates, unit
from orientd.curves.contract import Curve, Samples
from orientd.errors import PlanError
from orientd.rotation import Floats


def spline_slopes(points: Floats, times: Floats, tension: Floats | float) -> Floats:
    """Return the slopes of the spline at its points.

    Args:
        points: shape ``(n, d)``.
        times: increasing instants, shape ``(n,)``.
        tension: not negative, one for all points or shape ``(n,)``.

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


class NormalizedSpline(Curve):
    r"""A spline of the four components, divided by its length: what two families share.

    Args:
        keys: checked and aligned quaternions, shape ``(n, 4)``.
        instants: of the keyframes.
        tension: at each keyframe.
        continuity: what holds at the keyframes.
    """

    def __init__(
        self, *, keys: Floats, instants: Floats, tension: Floats | float, continuity: int
    ) -> None:
        super().__init__(knots=instants, continuity=continuity)
        self._keys = keys
        self._key_slopes = spline_slopes(keys, instants, tension)

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
