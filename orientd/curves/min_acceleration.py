r"""The curve of least squared angular acceleration through keyframes (Barr et al.).

Newton's method on states along the curve finds it (multiple shooting).

Between keyframes such a curve satisfies :math:`\Omega''' = \Omega'' \times \Omega` in the body
frame (Noakes, Heinzinger and Paden, 1989, "Cubic splines on curved spaces").  That is, the second
derivative of the velocity is constant in the world frame.  With *p* the turn since the start of a
piece,

.. math:: p' = \tfrac12 p\, \Omega, \quad \Omega' = \alpha, \quad \alpha' = J, \quad
          J' = J \times \Omega

is solved by collocation at Gauss's nodes.  On a piece over which the curve turns by about a radian,
Picard's iteration solves its equations to rounding.

The unknowns are orientation, angular velocity, acceleration and its rate *J* at the ends of the
pieces. Every piece must end in the initial state of the next one.  At a keyframe the orientation is
given and *J* may jump instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from orientd.curves.contract import Ends, WithEndVelocities
from orientd.curves.minimum_effort import MinimumEffort
from orientd.curves.newton import Linearised, cross, newton, solve_blocks
from orientd.curves.products import Path
from orientd.curves.starts import spline_path
from orientd.curves.trajectory import Samples
from orientd.errors import PlanError
from orientd.rotation import (
    Floats,
    conjugate,
    exp_half,
    log_half,
    multiply,
    normalize,
    right_jacobian_inverse,
    rotate,
)

STRIDE = 1.2
"""Bounds for a piece, each in rad.

They apply to velocity, square root of acceleration and cube root of its rate, times the duration.
"""

REFINEMENTS = 4
MOST_PIECES = 200
"""Most pieces per keyframe; a guess that needs more has useless turns in each interval."""

ROUNDING = 1e-9
"""The search ends with a Newton step as small as this."""

NUDGE = 1e-7
"""Change of a piece for numerical derivatives."""

_STILL = np.array([1.0, 0.0, 0.0, 0.0])


class MinAcceleration(WithEndVelocities):
    r"""Interpolate keyframes with the least integral of squared angular acceleration.

    .. math:: \min \int \|\dot\Omega\|^2 dt \quad\Rightarrow\quad
              \dddot\Omega = \ddot\Omega \times \Omega \text{ between keyframes},
              \quad \Omega, \dot\Omega \text{ continuous at them}

    Barr, Currin, Gabriel and Hughes (1992); Nielson (1993), "The Minimum Tangential Acceleration
    Method".  The printed :math:`c \times c'' \times c` must be read as the part of *c''* along the
    sphere, :math:`c'' - (c \cdot c'') c`, whose norm is :math:`\|\dot\Omega\|/2`.

    The papers discretise the curve and use an optimiser.  Here the Euler equation of the problem
    (Noakes, Heinzinger and Paden, 1989) is solved to rounding, by collocation over pieces of about
    a radian. Newton's method solves for the states between all of them at once (multiple shooting).
    It starts from the spline of least effort with the same ends.

    The result is the stationary curve near that spline: large steps have several.  With a fast end
    it may add whole turns instead of winding back, which at 20 rad/s over intervals of 1 s lowers
    the integral by a factor of two to three.  Time grows linearly, some 1 to 5 ms a keyframe.

    Picture: ``orientd plot min_acceleration``.

    Args:
        start: ``"natural"``, no acceleration at the first keyframe, which is best for a free
            velocity, or ``"clamped"``, the velocity *omega_start* there.
        end: the same for the last keyframe and *omega_end*.

    Raises:
        PlanError: Newton's method does not converge to a stationary curve.
    """

    name = "min_acceleration"
    summary = "least integral of squared acceleration; the slowest to build"
    source = "Barr, Currin, Gabriel and Hughes 1992; Noakes, Heinzinger and Paden 1989"

    def _solve(self, q: Floats, instants: Floats, ends: Ends) -> None:
        self._set_knots(instants, 2)
        given = (q, instants, ends[0][0], ends[1][0])
        near = spline_path(MinimumEffort, *given)
        found = None if near is None else settled(near, *given)
        if found is None:
            raise PlanError(
                "no curve of least acceleration was found through the keyframes: Newton's method "
                "does not converge, or only over more pieces than are tried; add keyframes, lower "
                "the end velocities or make neighbouring intervals more alike"
            )
        self._nodes = found

    def _orientations(self, times: Floats) -> Floats:
        return self._nodes(times)[0]


class Rule(NamedTuple):
    """Collocation at Gauss's nodes, solved by rounds of Picard's iteration."""

    nodes: Floats
    weights: Floats
    integrals: Floats
    rounds: int

    @classmethod
    def of(cls, places: int, rounds: int) -> Rule:
        """Return the rule with a number of nodes."""
        nodes, weights = legendre.leggauss(places)
        integrated = legendre.legval(nodes, legendre.legint(np.eye(places), lbnd=-1.0))
        matrix = integrated.T @ np.linalg.inv(legendre.legvander(nodes, places - 1))
        return cls(nodes, weights, matrix, rounds)

    def run(self, parts: Floats, durations: Floats) -> tuple[Floats, Floats]:
        """Return the solution from the initial states of all pieces, shape ``(m, 9)``.

        Returns:
            Turn since the start, angular velocity, acceleration and its rate: at the nodes, shape
            ``(m, p, 13)``, and at the end, shape ``(m, 13)``.
        """
        half = 0.5 * durations[:, None, None]
        begun = np.concatenate([np.tile(_STILL, (len(parts), 1)), parts], axis=1)[:, None]
        state = np.repeat(begun, len(self.nodes), axis=1)
        for _ in range(self.rounds):
            state = begun + half * (self.integrals @ _rates(state))
        ends: Floats = begun[:, 0] + half[:, 0] * (self.weights @ _rates(state))
        return state, ends


def _rates(state: Floats) -> Floats:
    turn, omega, jerk = state[..., :4], state[..., 4:7], state[..., 10:]
    w, v, half = turn[..., :1], turn[..., 1:], 0.5 * omega
    rates: Floats = np.empty_like(state)
    rates[..., :1] = -np.sum(v * half, axis=-1, keepdims=True)
    rates[..., 1:4] = w * half + cross(v, half)
    rates[..., 4:10] = state[..., 7:]
    rates[..., 10:] = cross(jerk, omega)
    return rates


_FINE = Rule.of(14, 26)
_TO_SERIES = np.linalg.inv(legendre.legvander(_FINE.nodes, len(_FINE.nodes) - 1))
"""From values at the nodes to the coefficients of their Legendre series."""

_COARSE = Rule.of(7, 12)
"""For derivatives only; this precision costs Newton's method no extra step."""


@dataclass(frozen=True)
class Nodes:
    """States along a curve, including the keyframes.

    Attributes:
        times: shape ``(m + 1,)``.
        is_key: which of them are keyframes.
        q: orientations, shape ``(m + 1, 4)``.
        parts: angular velocity, acceleration and its rate, ``(m + 1, 9)``; the rate is that of the
            piece that begins at the node.
    """

    times: Floats
    is_key: NDArray[np.bool_]
    q: Floats
    parts: Floats

    def moved(self, step: Floats) -> Nodes:
        """Return the nodes moved by body increments and changes of state, ``(m + 1, 12)``."""
        q = normalize(multiply(self.q, exp_half(0.5 * step[:, :3])))
        return Nodes(self.times, self.is_key, q, self.parts + step[:, 3:])

    def is_close(self) -> bool:
        """Return whether the nodes are close enough for an exact collocation."""
        return bool(np.max(_pace(self.parts[:-1]) * np.diff(self.times)) <= 1.5 * STRIDE)

    def changes(self) -> Floats:
        """Return the derivatives of the pieces' final states by their initial states, (m, 12, 9).

        The rows are the turn, as a body increment, velocity, acceleration and its rate, the columns
        the last three.
        """
        h, parts = np.diff(self.times), self.parts[:-1]
        nudges = NUDGE / np.repeat(h[:, None] ** np.arange(3), 3, axis=1)
        around = np.concatenate([parts[None], parts + np.eye(9)[:, None] * nudges])
        ends = _COARSE.run(around.reshape(-1, 9), np.tile(h, 10))[1].reshape(10, -1, 13)
        turned = 2.0 * log_half(multiply(conjugate(ends[0, :, :4]), ends[1:, :, :4]))
        changed = np.concatenate([turned, ends[1:, :, 4:] - ends[0, :, 4:]], axis=-1)
        return np.moveaxis(changed / nudges.T[..., None], 0, -1)

    @cached_property
    def _series(self) -> Floats:
        """Legendre coefficients of turn, velocity and acceleration on each piece."""
        state = _FINE.run(self.parts[:-1], np.diff(self.times))[0]
        series: Floats = _TO_SERIES @ state[..., :10]
        return series

    def __call__(self, times: Floats) -> Samples:
        """Return orientation, angular velocity and angular acceleration at *times*."""
        piece = np.searchsorted(self.times[1:-1], times, side="right")
        begin, end = self.times[piece], self.times[piece + 1]
        u = (2.0 * times - begin - end) / (end - begin)
        values = legendre.legvander(u, self._series.shape[1] - 1)
        found = np.einsum("tp,tpc->tc", values, self._series[piece])
        return normalize(multiply(self.q[piece], found[:, :4])), found[:, 4:7], found[:, 7:]


def settled(
    path: Path, q: Floats, instants: Floats, first: Floats | None, last: Floats | None
) -> Nodes | None:
    """Return the stationary curve near a guess, and its nodes, or ``None`` if none is found."""
    for _ in range(REFINEMENTS):
        nodes = nodes_along(path, q, instants)
        if nodes is None:
            return None
        h = np.diff(nodes.times, append=2.0 * nodes.times[-1] - nodes.times[-2])[:, None]
        # The largest part of a step, as a turn over the adjacent piece.
        scale = np.repeat(h ** np.arange(4), 3, axis=1)
        found = newton(
            _equations(first, last),
            nodes,
            move=Nodes.moved,
            size=lambda step, scale=scale: float(np.max(np.abs(step * scale))),  # type: ignore[misc]
            tolerance=ROUNDING,
            iterations=30,
        )
        if found is None or found.is_close():
            return found
        path = found
    return None


def nodes_along(path: Path, q: Floats, knots: Floats) -> Nodes | None:
    """Return nodes on a guess, dense where it is fast; ``None`` if that takes too many."""
    h, count = np.diff(knots), 8
    times = knots[:-1, None] + h[:, None] * np.arange(count + 1) / count
    times[:, -1] = knots[1:]
    _, omega, alpha = path(times.ravel())
    omega, alpha = (part.reshape(len(h), count + 1, 3) for part in (omega, alpha))
    jerk = np.diff(alpha, axis=1, append=2.0 * alpha[:, -1:] - alpha[:, -2:-1])
    jerk *= (count / h)[:, None, None]
    paces = _pace(np.concatenate([omega, alpha, jerk], axis=-1))
    pieces = np.maximum(np.ceil(h * paces.max(axis=1) / STRIDE), 1.0)
    if not pieces.sum() < MOST_PIECES * len(q):
        return None
    counts = pieces.astype(np.intp)
    start = np.repeat(np.arange(len(h)), counts)
    number = np.arange(len(start)) - np.repeat(np.cumsum(counts) - counts, counts)
    nodes = np.append(knots[start] + h[start] * number / counts[start], knots[-1])
    is_key = np.append(number == 0, True)
    orientation, omega, alpha = path(nodes)
    orientation = np.array(orientation)
    # An odd number of whole turns away from a keyframe, the curve continues with the opposite sign.
    orientation[is_key] = q * np.sign(np.sum(q * orientation[is_key], axis=1, keepdims=True))
    rate = np.zeros_like(alpha)
    rate[:-1] = np.diff(alpha, axis=0) / np.diff(nodes)[:, None]
    return Nodes(nodes, is_key, orientation, np.concatenate([omega, alpha, rate], axis=1))


def _pace(parts: Floats) -> Floats:
    """Return the quantity that, times a duration, is compared with ``STRIDE``, in 1/s."""
    sizes = np.sqrt(np.sum(parts.reshape(*parts.shape[:-1], 3, 3) ** 2, axis=-1))
    fastest: Floats = np.max(sizes ** (1.0 / np.arange(1.0, 4.0)), axis=-1)
    return fastest


def _equations(first: Floats | None, last: Floats | None) -> Callable[[Nodes], Linearised]:
    """Return the continuity errors between neighbouring nodes, scaled by the time between."""
    at_start, at_end = 3 if first is not None else 6, 3 if last is not None else 6

    def equations(nodes: Nodes) -> Linearised:
        h = np.diff(nodes.times)[:, None]
        ends = _FINE.run(nodes.parts[:-1], h[:, 0])[1]
        turn = ends[:, :4]
        missed = 2.0 * log_half(multiply(conjugate(nodes.q[1:]), multiply(nodes.q[:-1], turn)))
        # At a keyframe the rate of acceleration may jump.
        free = nodes.is_key[1:, None]
        scales = np.concatenate([h, h**2, np.where(free, 0.0, h**3)], axis=1).repeat(3, axis=1)
        error = np.concatenate([missed, scales * (ends[:, 4:] - nodes.parts[1:])], axis=1)
        begun = nodes.parts[0, 3:6] if first is None else nodes.parts[0, :3] - first
        ended = nodes.parts[-1, 3:6] if last is None else nodes.parts[-1, :3] - last
        errors = np.concatenate([np.zeros(3), begun, error.ravel(), ended])

        def step() -> Floats:
            change, scale = nodes.changes(), scales[..., None]
            to_error = right_jacobian_inverse(missed)
            blocks = np.zeros((len(h), 12, 24))
            blocks[:, 0:3, 0:3] = to_error @ np.swapaxes(
                rotate(conjugate(turn)[:, None], np.eye(3)), 1, 2
            )
            blocks[:, 0:3, 3:12] = to_error @ change[:, :3]
            blocks[:, 0:3, 12:15] = -right_jacobian_inverse(-missed)
            blocks[:, 3:12, 3:12] = scale * change[:, 3:]
            blocks[:, 3:12, 15:24] = -scale * np.eye(9)
            blocks[:, 9:12, 12:15] = np.where(free[..., None], np.eye(3), 0.0)
            head, tail = np.zeros((1, 12, 24)), np.zeros((1, 12, 24))
            head[0, 0:3, 0:3] = head[0, 3:6, at_start : at_start + 3] = np.eye(3)
            tail[0, 9:12, 12 + at_end : 15 + at_end] = np.eye(3)
            rows, size = 6 + 12 * np.arange(len(h)), len(errors)
            solution = solve_blocks(
                np.concatenate([head, blocks, tail]),
                np.concatenate([[0], rows, [size - 12]]),
                np.concatenate([[0], rows - 6, [size - 21]]),
                -errors,
            )
            # The last node has no rate of acceleration.
            return np.append(solution, np.zeros(3)).reshape(-1, 12)

        return errors, step

    return equations
