r"""The search for the first shoulder point of a spherical quadratic spline (Nielson, eqs. 20, 21).

The shoulder points follow from the first by :math:`M_{i+1} = q_{i+1} \exp(-\rho_i w_i)`,
:math:`w_i = \log(q_{i+1}^{-1} M_i)`, :math:`\rho_i = h_{i+1}/h_i`.  A body increment of
:math:`M_i` reaches :math:`M_{i+1}` through

.. math:: D_i = -\rho_i\, J_r(-2 \rho_i w_i)\, J_r^{-1}(2 w_i)

(:math:`J_r` the right Jacobian), an isometry for :math:`\rho_i = 1`; gradients come back along the
chain by its transposes.  Many candidates are worked on at once: the leading axis of every array
is the candidate.
"""

from __future__ import annotations

import numpy as np

from orientd.curves.construct.shoulder_search import frame_of
from orientd.rotation import (
    Floats,
    conjugate,
    exp_half,
    left_jacobian_inverse,
    log_half,
    multiply,
    right_jacobian,
    right_jacobian_inverse,
)

SCREENED = 512
WORK = 65536
"""Long chains are screened with fewer candidates, so that their number times length is this."""

KINKS = 64
STARTS = 10
LONGEST = 2000
"""Long chains descend from fewer starts, so that their number times length is this."""

ITERATIONS = 40
NUDGE = 1e-5
"""Half angle, rad, over which the Hessian is the difference of exact gradients; it steers the
search only."""


class ShoulderChain:
    """A criterion as a function of the first shoulder point.

    Args:
        q: keyframes, shape ``(n, 4)``.
        ratios: of each interval to the one before, shape ``(n - 2,)``.
        criterion: 20 or 21.
    """

    def __init__(self, q: Floats, ratios: Floats, criterion: int) -> None:
        self._q, self._ratios, self._criterion = q, ratios, criterion

    def best_first(self) -> Floats:
        """Return the first shoulder point with the least criterion found."""
        starts = np.concatenate([self._starts(), self._kinks()])
        values = self.values(starts)
        order = np.argsort(values, kind="stable")
        count = max(2, min(STARTS, LONGEST // len(self._q)))
        found, reached = self._descend(starts[order[:count]])
        candidates = np.concatenate([found, starts[order[:1]]])
        best: Floats = candidates[int(np.argmin([*reached, values[order[0]]]))]
        return best

    def values(self, first: Floats) -> Floats:
        """Return the criterion for candidates, shape ``(s, 4)`` to ``(s,)``."""
        points = self._chain(first)
        if self._criterion == 20:
            terms = np.linalg.norm(self._sides(points), axis=-1)
        else:
            terms = self._middle_distances(points) ** 2
        total: Floats = np.sum(terms, axis=1)
        return total

    def gradients(self, first: Floats) -> Floats:
        """Return the derivatives with respect to body increments of the candidates, ``(s, 3)``."""
        points = self._chain(first)
        local = self._polygon(points) if self._criterion == 20 else self._middles(points)
        w = log_half(multiply(conjugate(self._q[1:-1]), points[:, :-1]))
        ratio = self._ratios[:, None]
        carry = right_jacobian(-2.0 * ratio * w) @ right_jacobian_inverse(2.0 * w)
        carry *= -ratio[..., None]
        total = local[:, -1]
        for i in range(points.shape[1] - 2, -1, -1):
            total = local[:, i] + np.einsum("sji,sj->si", carry[:, i], total)
        return total

    def _chain(self, first: Floats) -> Floats:
        """Return all shoulder points of candidates, shape ``(s, n - 1, 4)``."""
        points = np.empty((len(first), len(self._q) - 1, 4))
        points[:, 0] = m = first
        for i, (key, ratio) in enumerate(zip(self._q[1:-1], self._ratios, strict=True)):
            apart = np.sqrt(np.sum((m - key) ** 2, axis=-1))
            together = np.sqrt(np.sum((m + key) ** 2, axis=-1))
            angle = 2.0 * np.arctan2(apart, together)
            sine = np.where(angle > 0.0, np.sin(angle), 1.0)
            back = np.where(angle > 0.0, -np.sin(ratio * angle) / sine, -ratio)
            ahead = np.where(angle > 0.0, np.sin((1.0 + ratio) * angle) / sine, 1.0 + ratio)
            m = back[:, None] * m + ahead[:, None] * key
            m = m / np.sqrt(np.sum(m * m, axis=-1, keepdims=True))
            points[:, i + 1] = m
        return points

    def _sides(self, points: Floats) -> Floats:
        """Return the sides of the polygon of shoulder points, shape ``(s, n, 3)``."""
        ends = np.broadcast_to(self._q[[0, -1]], (len(points), 2, 4))
        nodes = np.concatenate([ends[:, :1], points, ends[:, 1:]], axis=1)
        return log_half(multiply(conjugate(nodes[:, :-1]), nodes[:, 1:]))

    def _polygon(self, points: Floats) -> Floats:
        """Return the derivatives of the polygon's length at each shoulder point by itself."""
        sides = self._sides(points)
        lengths = np.linalg.norm(sides, axis=-1, keepdims=True)
        toward = sides / np.where(lengths > 0.0, lengths, 1.0)
        difference: Floats = toward[:, :-1] - toward[:, 1:]
        return difference

    def _middle_distances(self, points: Floats) -> Floats:
        r"""Return how far each shoulder point is from the middle of its segment.

        Seen from *M* the keyframes are :math:`\exp a` and :math:`\exp b`, and the middle lies
        towards :math:`\exp(a/2) + \exp(b/2)`.
        """
        seen = multiply(conjugate(points)[:, None], np.stack([self._q[:-1], self._q[1:]]))
        to_middle = log_half(np.sum(exp_half(0.5 * log_half(seen)), axis=1))
        distances: Floats = np.linalg.norm(to_middle, axis=-1)
        return distances

    def _middles(self, points: Floats) -> Floats:
        """Return the derivatives of the squared distances at each shoulder point by itself."""
        total = np.zeros_like(points)
        derivative = np.zeros((*points.shape, 3))
        for neighbours in (self._q[:-1], self._q[1:]):
            a = log_half(multiply(conjugate(points), neighbours))
            half = exp_half(0.5 * a)
            # exp(a) becomes exp(-e) exp(a) when M becomes M exp(e).
            inner = -0.5 * right_jacobian(a) @ left_jacobian_inverse(2.0 * a)
            pure = np.zeros((*a.shape[:-1], 3, 4))
            pure[..., 1:] = np.swapaxes(inner, -1, -2)
            derivative += np.swapaxes(multiply(half[..., None, :], pure), -1, -2)
            total += half
        c, v = total[..., 0], total[..., 1:]
        sine = np.linalg.norm(v, axis=-1)
        outward = v / np.where(sine > 0.0, sine, 1.0)[..., None]
        growth = np.einsum("...c,...cj->...j", outward, derivative[..., 1:, :])
        change = (c[..., None] * growth - sine[..., None] * derivative[..., 0, :]) / (
            c * c + sine * sine
        )[..., None]
        gradient: Floats = 2.0 * np.arctan2(sine, c)[..., None] * change
        return gradient

    def _starts(self) -> Floats:
        """Return candidates all over the sphere, and more of them near the first two keyframes."""
        generator = np.random.default_rng(20)
        frame = frame_of(self._q)
        count = max(64, min(SCREENED, WORK // len(self._q)))
        everywhere = generator.normal(size=(count, 4)) @ frame.T
        middle = self._q[0] + self._q[1]
        middle = middle / np.linalg.norm(middle) if np.any(np.abs(middle) > 1e-9) else frame[:, 1]
        spread = generator.uniform(0.0, 1.5, (count, 1)) * generator.normal(size=(count, 4))
        candidates = np.concatenate([middle[None], middle + spread @ frame.T, everywhere])
        starts: Floats = candidates / np.sqrt(np.sum(candidates**2, axis=-1, keepdims=True))
        return starts

    def _kinks(self) -> Floats:
        """Return the candidates whose chain puts a shoulder point on a keyframe.

        There the length of the polygon has a kink, which a descent does not settle in.
        """
        found = []
        for place in range(1, min(len(self._q) - 1, KINKS) if self._criterion == 20 else 0):
            point = self._q[place]
            for i in range(place - 2, -1, -1):
                w = log_half(multiply(conjugate(self._q[i + 1]), point))
                point = multiply(self._q[i + 1], exp_half(-w / self._ratios[i]))
            found.append(point)
        return np.array(found).reshape(-1, 4)

    def _descend(self, x: Floats) -> tuple[Floats, Floats]:
        """Return the minima that a damped Newton method reaches from each of several starts."""
        shares = np.concatenate([0.5 ** np.arange(12.0), [1e-5, 1e-7, 0.0]])
        steps = np.concatenate([NUDGE * np.eye(3), -NUDGE * np.eye(3)])
        values = self.values(x)
        for _ in range(ITERATIONS):
            nudged = multiply(x[:, None], exp_half(np.vstack([np.zeros(3), steps])))
            gradients = self.gradients(nudged.reshape(-1, 4)).reshape(-1, 7, 3)
            hessian = (gradients[:, 1:4] - gradients[:, 4:7]) / (2.0 * NUDGE)
            hessian = 0.5 * (hessian + np.swapaxes(hessian, 1, 2))
            eigenvalues, axes = np.linalg.eigh(hessian)
            floor = 1e-6 * np.max(np.abs(eigenvalues), axis=1, keepdims=True) + 1e-12
            curvature = np.maximum(np.abs(eigenvalues), floor)
            along = np.einsum("sij,si->sj", axes, gradients[:, 0])
            step = -np.einsum("sij,sj->si", axes, along / curvature)
            length = np.sqrt(np.sum(step * step, axis=1, keepdims=True))
            step *= np.minimum(1.0, 0.5 / np.where(length > 0.0, length, 1.0))
            tried = multiply(x[:, None], exp_half(shares[:, None] * step[:, None]))
            reached = self.values(tried.reshape(-1, 4)).reshape(len(x), -1)
            # The first share that is as good as any, so that a flat minimum is stepped into.
            best = np.argmax(reached <= reached.min(axis=1, keepdims=True) * (1.0 + 1e-14), axis=1)
            rows = np.arange(len(x))
            x, values = tried[rows, best], reached[rows, best]
            x = x / np.sqrt(np.sum(x * x, axis=1, keepdims=True))
            if np.max(length[:, 0] * shares[best]) < 1e-12:
                break
        return x, values
