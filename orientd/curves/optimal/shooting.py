"""Multiple shooting for curves of least squared acceleration: Newton's method on states along them.

The unknowns are orientation, angular velocity, acceleration and its rate at nodes so close together
that one Taylor series (:mod:`orientd.curves.optimal.lie_quadratic`) spans each piece between them.
Every piece must end in the state the next one starts from; at a keyframe the orientation is given
and the rate of the acceleration may jump instead.  Solving for all states at once keeps every
equation nearly linear, however often the curve turns between two keyframes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from orientd.curves.construct import Path, solve_blocks, squared_acceleration
from orientd.curves.contract import Samples
from orientd.curves.optimal.lie_quadratic import STRIDE, LieQuadraticState, horner, series, shoot
from orientd.rotation import (
    Floats,
    conjugate,
    exp_half,
    left_jacobian_inverse,
    log_half,
    multiply,
    normalize,
    right_jacobian_inverse,
    rotate,
)

ITERATIONS = 30
REFINEMENTS = 4
MOST_PIECES = 200
"""For each keyframe; a guess that needs more, several turns in each interval, leads nowhere."""

ROUNDING = 1e-9
"""A Newton step as small as this one is the last."""

SMALLEST_SHARE = 1.0 / 64.0


@dataclass(frozen=True)
class Nodes:
    """States along a curve, the keyframes among them.

    Attributes:
        times: instants, shape ``(m + 1,)``.
        is_key: which of them are keyframes.
        q: orientations, shape ``(m + 1, 4)``.
        parts: angular velocity, acceleration and its rate, ``(m + 1, 3)`` each; the rate is that
            of the piece that begins at the node.
    """

    times: Floats
    is_key: NDArray[np.bool_]
    q: Floats
    parts: tuple[Floats, Floats, Floats]

    def moved(self, step: Floats) -> Nodes:
        """Return the nodes moved by body increments and changes of state, ``(m + 1, 4, 3)``."""
        q = normalize(multiply(self.q, exp_half(0.5 * step[:, 0])))
        omega, alpha, jerk = (part + step[:, 1 + k] for k, part in enumerate(self.parts))
        return Nodes(self.times, self.is_key, q, (omega, alpha, jerk))

    def is_close(self) -> bool:
        """Tell whether the nodes are so close together that a series spans each piece."""
        pace = LieQuadraticState(*(part[:-1] for part in self.parts)).pace() * np.diff(self.times)
        return bool(np.max(pace) <= 1.5 * STRIDE)

    def squared_acceleration(self) -> float:
        """Return the integral of squared angular acceleration."""
        return squared_acceleration(self.path(), self.times)

    def path(self) -> NodesPath:
        """Return the curve through the nodes."""
        turns, omegas, _, _ = series(*(part[:-1, :, None] for part in self.parts))
        return NodesPath(self.times, self.q, turns[..., 0], omegas[..., 0])


@dataclass(frozen=True, slots=True, eq=False)
class NodesPath:
    """The curve through nodes, as a power series from each.

    Attributes:
        times: instants of the nodes, shape ``(m + 1,)``.
        q: orientations there, shape ``(m + 1, 4)``.
        turns: coefficients of the turns from each node, the piece first.
        omegas: those of the angular velocities.
    """

    times: Floats
    q: Floats
    turns: Floats
    omegas: Floats

    def __call__(self, times: Floats) -> Samples:
        """Return orientation, angular velocity and angular acceleration at *times*."""
        piece = np.searchsorted(self.times[1:-1], times, side="right")
        elapsed = times - self.times[piece]
        turn, _ = horner(self.turns[piece], elapsed)
        omega_body, alpha_body = horner(self.omegas[piece], elapsed)
        return normalize(multiply(self.q[piece], turn)), omega_body, alpha_body


def settled(
    path: Path, q: Floats, instants: Floats, first: Floats | None, last: Floats | None
) -> Nodes | None:
    """Return the stationary curve near a guess, its nodes close, or nothing if none is found."""
    for _ in range(REFINEMENTS):
        nodes = nodes_along(path, q, instants)
        if nodes is None:
            return None
        found = _Equations(nodes, first, last).solve()
        if found is None or found.is_close():
            return found
        path = found.path()
    return None


def nodes_along(path: Path, q: Floats, knots: Floats) -> Nodes | None:
    """Return nodes on a guess, close where it is fast; nothing where that would be too many.

    Args:
        path: a curve through the keyframes.
        q: keyframes, with the signs wanted, shape ``(n, 4)``.
        knots: their instants.
    """
    h = np.diff(knots)
    count = 8
    times = knots[:-1, None] + h[:, None] * np.arange(count + 1) / count
    times[:, -1] = knots[1:]
    _, omega, alpha = path(times.ravel())
    omega, alpha = (part.reshape(len(h), count + 1, 3) for part in (omega, alpha))
    jerk = np.diff(alpha, axis=1, append=2.0 * alpha[:, -1:] - alpha[:, -2:-1])
    jerk *= (count / h)[:, None, None]
    pace = LieQuadraticState(*(part.reshape(-1, 3) for part in (omega, alpha, jerk))).pace()
    fastest = pace.reshape(len(h), count + 1).max(axis=1)
    pieces = np.maximum(np.ceil(h * fastest / STRIDE), 1.0)
    if not pieces.sum() < MOST_PIECES * len(q):
        return None
    counts = pieces.astype(np.intp)
    start = np.repeat(np.arange(len(h)), counts)
    number = np.arange(len(start)) - np.repeat(np.cumsum(counts) - counts, counts)
    nodes = np.append(knots[start] + h[start] * number / counts[start], knots[-1])
    is_key = np.append(number == 0, True)
    orientation, omega, alpha = path(nodes)
    orientation = np.array(orientation)
    # An odd number of whole turns away from a keyframe, the other sign leads on to it.
    orientation[is_key] = q * np.sign(np.sum(q * orientation[is_key], axis=1, keepdims=True))
    rate = np.zeros_like(alpha)
    rate[:-1] = np.diff(alpha, axis=0) / np.diff(nodes)[:, None]
    return Nodes(nodes, is_key, orientation, (omega, alpha, rate))


class _Equations:
    """What holds between the states at neighbouring nodes, scaled by the time between them."""

    def __init__(self, nodes: Nodes, first: Floats | None, last: Floats | None) -> None:
        self._nodes, self._first, self._last = nodes, first, last
        self._h = np.diff(nodes.times)

    def solve(self) -> Nodes | None:
        """Return the solution near the nodes, or nothing where Newton's method does not settle."""
        nodes = self._nodes
        blocks, error = self._linearised(nodes)
        for _ in range(ITERATIONS):
            try:
                step = -self._solve_linear(blocks, error)
            except np.linalg.LinAlgError:
                return None
            size = self._size(step)
            share = min(1.0, 1.0 / size) if size > 0.0 else 1.0
            before = float(np.sum(error * error))
            while True:
                tried = nodes.moved(share * step)
                blocks, error = self._linearised(tried)
                if np.sum(error * error) <= (1.0 - 1e-3 * share) * before or size < ROUNDING:
                    break
                share *= 0.5
                if not share >= SMALLEST_SHARE:
                    return None
            nodes = tried
            if size < ROUNDING:
                return nodes
        return None

    def _size(self, step: Floats) -> float:
        """Return the largest part of a step, as a turn over the piece beside it."""
        h = np.append(self._h, self._h[-1])[:, None]
        return float(np.max(np.abs(step * np.stack([np.ones_like(h), h, h**2, h**3], axis=1))))

    def _linearised(self, nodes: Nodes) -> tuple[Floats, Floats]:
        """Return the derivatives of each piece's end ``(m, 12, 24)``, and all errors in order."""
        h = self._h[:, None]
        scale = h[..., None]
        omega, alpha, jerk = nodes.parts
        turn, end, d_turn, d_end = shoot(
            LieQuadraticState(omega[:-1], alpha[:-1], jerk[:-1]), self._h
        )
        reached = multiply(nodes.q[:-1], turn)
        missed = 2.0 * log_half(multiply(conjugate(nodes.q[1:]), reached))
        to_error = right_jacobian_inverse(missed)
        back = np.swapaxes(rotate(conjugate(turn)[:, None], np.eye(3)), 1, 2)
        is_key = nodes.is_key[1:, None]
        blocks = np.zeros((len(h), 12, 24))
        blocks[:, 0:3, 0:3] = to_error @ back
        blocks[:, 0:3, 3:12] = to_error @ d_turn
        blocks[:, 0:3, 12:15] = -left_jacobian_inverse(missed)
        blocks[:, 3:6, 3:12] = scale * d_end.omega
        blocks[:, 3:6, 15:18] = -scale * np.eye(3)
        blocks[:, 6:9, 3:12] = scale**2 * d_end.alpha
        blocks[:, 6:9, 18:21] = -(scale**2) * np.eye(3)
        inner = np.where(is_key[..., None], 0.0, scale**3)
        blocks[:, 9:12, 3:12] = inner * d_end.jerk
        blocks[:, 9:12, 21:24] = -inner * np.eye(3)
        blocks[:, 9:12, 12:15] = np.where(is_key[..., None], np.eye(3), 0.0)
        error = np.concatenate(
            [
                missed,
                h * (end.omega - omega[1:]),
                h**2 * (end.alpha - alpha[1:]),
                np.where(is_key, 0.0, h**3 * (end.jerk - jerk[1:])),
            ],
            axis=1,
        )
        at_start = alpha[0] if self._first is None else omega[0] - self._first
        at_end = alpha[-1] if self._last is None else omega[-1] - self._last
        return blocks, np.concatenate([np.zeros(3), at_start, error.ravel(), at_end])

    def _solve_linear(self, blocks: Floats, error: Floats) -> Floats:
        """Return the solution ``(m + 1, 4, 3)``; the last node has no rate of acceleration."""
        count, size = len(blocks), len(error)
        rows = 6 + 12 * np.arange(count)
        head, tail = np.zeros((1, 12, 24)), np.zeros((1, 12, 24))
        head[0, 0:3, 0:3] = np.eye(3)
        place = 6 if self._first is None else 3
        head[0, 3:6, place : place + 3] = np.eye(3)
        place = 6 if self._last is None else 3
        tail[0, 9:12, 12 + place : 15 + place] = np.eye(3)
        solution = solve_blocks(
            np.concatenate([head, blocks, tail]),
            np.concatenate([[0], rows, [size - 12]]),
            np.concatenate([[0], rows - 6, [size - 21]]),
            error,
        )
        return np.append(solution, np.zeros(3)).reshape(-1, 4, 3)
