r"""A curve on an uneven clock: the same orientations, at a rate that changes along it.

The curve's own parameter *s* is a function of time in two steps.  The outer one,
:math:`\sigma(t)`, is a quintic Hermite spline, twice continuously differentiable.  The inner one,
:math:`s(\sigma)`, is fixed and lets a device leave rest: where the angular velocity of the curve
falls to zero like *s*, but a motion from rest turns by an angle like :math:`t^3`, *s* must grow
like :math:`\sigma^{3/2}`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.curves.contract import Curve, Samples
from orientd.rotation import Floats

_NEAREST = 1e-9  # to an end of [0, 1], where the second derivative of the unit map is infinite
_NEWTON_STEPS = 60


def unit_map(u: Floats, powers: tuple[float, float]) -> tuple[Floats, Floats, Floats]:
    r"""Return a map of [0, 1] onto itself that starts and ends with given powers, and derivatives.

    .. math:: m'(u) \propto u^{p_0 - 1} (1 - u)^{p_1 - 1}

    Args:
        u: in [0, 1].
        powers: :math:`p_0` and :math:`p_1`, each 1 or 3/2.
    """
    if powers not in ((1.0, 1.0), (1.5, 1.0), (1.0, 1.5), (1.5, 1.5)):
        raise ValueError(f"powers must each be 1 or 3/2, got {powers}")
    u = np.clip(u, 0.0, 1.0)
    v = 1.0 - u
    if powers == (1.0, 1.0):
        return u, np.ones_like(u), np.zeros_like(u)
    if powers == (1.5, 1.0):
        return u**1.5, 1.5 * np.sqrt(u), 0.75 * _inverse_root(u)
    if powers == (1.0, 1.5):
        return 1.0 - v**1.5, 1.5 * np.sqrt(v), -0.75 * _inverse_root(v)
    phi = np.arcsin(np.sqrt(u))
    return (
        2.0 / np.pi * (phi - 0.25 * np.sin(4.0 * phi)),
        8.0 / np.pi * np.sqrt(u * v),
        4.0 / np.pi * (v - u) * _inverse_root(u * v),
    )


def _inverse_root(u: Floats) -> Floats:
    """Return ``u ** -0.5``, or 0 at the end: what it is multiplied by falls to zero faster."""
    inverse: Floats = np.zeros_like(u)
    return np.divide(1.0, np.sqrt(u), out=inverse, where=u > _NEAREST)


@dataclass(frozen=True, slots=True, eq=False)
class TimeMap:
    """A parameter by time.

    Attributes:
        times: of the nodes, increasing from 0, s, shape ``(n,)``.
        nodes: of the outer function there, from 0 to 1: value, first and second derivative by
            time, shape ``(3, n)``.
        first: parameter at time 0.
        length: how far the parameter goes.
        powers: of the inner function at both ends.
    """

    times: Floats
    nodes: Floats
    first: float
    length: float
    powers: tuple[float, float]

    def __call__(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the parameter and its first two derivatives by time."""
        u, rate, change = self._outer(times)
        s, slope, bend = unit_map(u, self.powers)
        return (
            self.first + self.length * s,
            self.length * slope * rate,
            self.length * (bend * rate**2 + slope * change),
        )

    def times_of(self, parameters: Floats) -> Floats:
        """Return when the parameter has given values, by bisection and Newton's method."""
        goal = (parameters - self.first) / self.length
        at_nodes = unit_map(self.nodes[0], self.powers)[0]
        where = np.clip(np.searchsorted(at_nodes, goal, side="right") - 1, 0, len(self.times) - 2)
        low, high = self.times[where].copy(), self.times[where + 1].copy()
        t = 0.5 * (low + high)
        for _ in range(_NEWTON_STEPS):
            s, slope, _ = self(t)
            miss = (s - self.first) / self.length - goal
            high = np.where(miss >= 0.0, t, high)
            low = np.where(miss <= 0.0, t, low)
            with np.errstate(divide="ignore", invalid="ignore"):
                ahead = t - miss * self.length / slope
            ahead = np.where((ahead > low) & (ahead < high), ahead, 0.5 * (low + high))
            if np.array_equal(ahead, t):
                break
            t = ahead
        t[goal <= 0.0], t[goal >= 1.0] = self.times[0], self.times[-1]
        return t

    def _outer(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        where = np.clip(
            np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2
        )
        h = self.times[where + 1] - self.times[where]
        x = (times - self.times[where]) / h
        value, rate, change = self.nodes[:, where]
        value_1, rate_1, change_1 = self.nodes[:, where + 1]
        # The quintic from its value, derivatives and what is missing at the far end.
        a = value_1 - value - h * (rate + 0.5 * h * change)
        b = h * (rate_1 - rate - h * change)
        c = h * h * (change_1 - change)
        c3 = 10.0 * a - 4.0 * b + 0.5 * c
        c4 = -15.0 * a + 7.0 * b - c
        c5 = 6.0 * a - 3.0 * b + 0.5 * c
        cube = x**3
        return (
            value + h * x * (rate + 0.5 * h * x * change) + cube * (c3 + x * (c4 + x * c5)),
            rate + h * x * change + x * x / h * (3 * c3 + x * (4 * c4 + 5 * x * c5)),
            change + x / h**2 * (6 * c3 + x * (12 * c4 + 20 * x * c5)),
        )


class Retimed(Curve):
    """Run through *curve* as *warp* says.

    Args:
        curve: any curve.
        warp: gives its parameter; covers its whole domain.
    """

    def __init__(self, curve: Curve, warp: TimeMap) -> None:
        self._curve = curve
        self._warp = warp
        knots = warp.times_of(curve.knots)
        super().__init__(knots=knots, continuity=curve.continuity)

    def _sample(self, times: Floats) -> Samples:
        s, rate, change = self._warp(times)
        first, last = self._curve.domain
        q, omega, alpha = self._curve.evaluate(np.clip(s, first, last))
        return (
            q,
            omega * rate[:, None],
            alpha * rate[:, None] ** 2 + omega * change[:, None],
        )
