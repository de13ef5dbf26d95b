r"""The search for the first tangent of a circle spline (Nielson, 1993, criteria 13 and 14).

Every tangent length of the spline is a function of the first tangent *T* alone:
:math:`\tau_i = \tfrac12 d_i / w_i`, :math:`w_i = p_i \cdot T`, with fixed vectors :math:`p_i` (the
pulls).  So a criterion is a sum over segments of functions of :math:`\tau_i`:

* 13, the length of the polygon of shoulder points,
  :math:`|\tau_1| + \sum |\tau_i + \tau_{i+1}| + |\tau_n|`, which is :math:`2 \sum \tau_i` where no
  weight is negative.  There it has one minimum: its square-root scaled form
  :math:`\tfrac12 \|x\|^2 + \sum d_i / (p_i \cdot x)` is strictly convex on the cone of such *x*.
* 14, the squared distances of the arcs' middles from their shoulder points,
  :math:`\sum \tau_i^2 (\tau_i - k_i)/(\tau_i + k_i)` with :math:`k_i = \tfrac12 d_i`, which may
  have several minima.
"""

from __future__ import annotations

import numpy as np

from orientd.rotation import Floats

GRID = 600
STARTS = 16
ITERATIONS = 100


def best_direction(
    pulls: Floats, chords: Floats, criterion: int, *, is_restricted: bool
) -> Floats | None:
    """Return the first tangent with the least criterion found, as a vector of the first basis.

    Args:
        pulls: vectors whose products with the tangent are the weights, shape ``(n, 3)``.
        chords: distances between neighbouring keyframes, shape ``(n,)``.
        criterion: 13 or 14.
        is_restricted: whether all weights must be positive.

    Returns:
        A unit vector, shape ``(3,)``; nothing if none makes all weights positive and that is
        asked for.
    """
    objective = _Objective(pulls, 0.5 * chords, criterion, is_restricted=is_restricted)
    starts = _hemisphere(GRID)
    if is_restricted:
        center = _inside_cone(pulls)
        if center is None:
            return None
        starts = np.concatenate([center[None], starts if criterion == 14 else starts[:0]])
    values = np.array([objective.value(x) for x in starts])
    best: Floats = starts[0]
    least = np.inf
    for place in np.argsort(values, kind="stable")[:STARTS]:
        if not np.isfinite(values[place]):
            break
        found, value = objective.descend(starts[place])
        if value < least * (1.0 - 1e-12):
            best, least = found, value
    return best


def frame_of(q: Floats) -> Floats:
    """Return an orthonormal frame of four dimensions that turns with the keyframes.

    Its first vector is the first keyframe, the second points to the second one, the third is
    found from those that follow, so that a search in this frame has the same result whatever the
    frames the orientations are given in.

    Args:
        q: unit quaternions, shape ``(n, 4)``.

    Returns:
        Columns, shape ``(4, 4)``, of positive determinant.
    """
    vectors = [q[0]]
    for candidate in (*q[1:], *np.eye(4)):
        rest = candidate - sum(float(candidate @ v) * v for v in vectors)
        length = float(np.linalg.norm(rest))
        if length > 1e-6:
            rest = rest / length
            rest = rest - sum(float(rest @ v) * v for v in vectors)
            vectors.append(rest / np.linalg.norm(rest))
        if len(vectors) == 3:
            break
    rows = np.array(vectors)
    last = [-((-1.0) ** k) * np.linalg.det(np.delete(rows, k, axis=1)) for k in range(4)]
    frame: Floats = np.column_stack([*vectors, last])
    return frame


class _Objective:
    """A criterion as a function of the first tangent, with its derivatives on the unit sphere."""

    def __init__(
        self, pulls: Floats, halves: Floats, criterion: int, *, is_restricted: bool
    ) -> None:
        self._pulls, self._halves = pulls, halves
        self._criterion, self._is_restricted = criterion, is_restricted

    def value(self, x: Floats) -> float:
        """Return the criterion for a unit vector, infinite where it is not allowed."""
        weights = self._pulls @ x
        is_allowed = np.all(weights > 0.0) if self._is_restricted else weights[0] > 0.0
        if not is_allowed or np.any(weights == 0.0):
            return np.inf
        return float(np.sum(self._terms(self._halves / weights)[0]))

    def descend(self, x: Floats) -> tuple[Floats, float]:
        """Return the minimum that a damped Newton method reaches, and its value."""
        value = self.value(x)
        for _ in range(ITERATIONS):
            gradient, curvature, tangents = self._derivatives(x)
            lowest = float(np.linalg.eigvalsh(curvature)[0])
            size = float(np.trace(np.abs(curvature)))
            if lowest < 1e-6 * size:
                curvature = curvature + (1e-3 * size - lowest) * np.eye(2)
            step = -np.linalg.solve(curvature, gradient)
            length = float(np.linalg.norm(step))
            share = min(1.0, 0.5 / length) if length > 0.0 else 1.0
            while True:
                moved = x + tangents @ (share * step)
                moved /= np.linalg.norm(moved)
                reached = self.value(moved)
                if reached <= value + 1e-15 * abs(value) or not share * length >= 1e-14:
                    break
                share *= 0.5
            if not reached <= value + 1e-15 * abs(value):
                break
            x, value = moved, reached
            if length < 1e-13:
                break
        return x, value

    def _terms(self, lengths: Floats) -> tuple[Floats, Floats, Floats]:
        """Return what each tangent length adds to the criterion, with two derivatives."""
        if self._criterion == 13:
            joints = np.sign(lengths[:-1] + lengths[1:])
            slopes = np.concatenate([np.sign(lengths[:1]), joints]) + np.concatenate(
                [joints, np.sign(lengths[-1:])]
            )
            return slopes * lengths, slopes, np.zeros_like(slopes)
        k = self._halves
        total = lengths + k
        value = lengths * lengths * (lengths - k) / total
        # t^2 (t - k)/(t + k) = t^2 - 2 k t + 2 k^2 - 2 k^3/(t + k)
        first = 2.0 * lengths - 2.0 * k + 2.0 * k**3 / total**2
        second = 2.0 - 4.0 * k**3 / total**3
        return value, first, second

    def _derivatives(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Return gradient and Hessian in the tangent plane at *x*, and a basis of that plane."""
        other = np.eye(3)[int(np.argmin(np.abs(x)))]
        side = np.cross(x, other)
        side /= np.linalg.norm(side)
        tangents = np.stack([side, np.cross(x, side)], axis=1)
        weights = self._pulls @ x
        lengths = self._halves / weights
        across = (self._pulls @ tangents) / weights[:, None]
        _, first, second = self._terms(lengths)
        gradient = -(first * lengths) @ across
        bend = second * lengths * lengths + 2.0 * first * lengths
        curvature = across.T @ (bend[:, None] * across) + np.sum(first * lengths) * np.eye(2)
        return gradient, curvature, tangents


def _hemisphere(count: int) -> Floats:
    """Return directions spread evenly over the half sphere around the first axis."""
    height = (np.arange(count) + 0.5) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    radius = np.sqrt(1.0 - height * height)
    return np.stack([height, radius * np.cos(turn), radius * np.sin(turn)], axis=1)


def _inside_cone(pulls: Floats) -> Floats | None:
    """Return a unit vector well inside the cone of positive weights, if there is one."""
    from scipy.optimize import linprog

    unit = pulls / np.sqrt(np.sum(pulls * pulls, axis=-1))[:, None]
    found = linprog(
        [0.0, 0.0, 0.0, -1.0],
        A_ub=np.column_stack([-unit, np.ones(len(unit))]),
        b_ub=np.zeros(len(unit)),
        bounds=[(-1.0, 1.0)] * 3 + [(None, 1.0)],
        method="highs",
    )
    if found.x is None or found.x[3] <= 1e-9:
        return None
    center: Floats = found.x[:3] / np.linalg.norm(found.x[:3])
    return center if np.all(pulls @ center > 0.0) else None
