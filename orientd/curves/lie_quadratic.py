r"""The stationary curves of the integral of squared angular acceleration, as Taylor series.

Between keyframes such a curve satisfies :math:`\Omega''' = \Omega'' \times \Omega` in the body
frame (Noakes, Heinzinger and Paden, 1989, "Cubic splines on curved spaces"): the second
derivative of the velocity stands still in the world frame.  With *p* the turn since the start,

.. math:: p' = \tfrac12 p\, \Omega, \quad \Omega' = \alpha, \quad \alpha' = J, \quad
          J' = J \times \Omega

is polynomial, so its Taylor coefficients follow from each other by convolutions.  A segment is cut
into pieces over which it turns by about a radian; there 28 terms miss the acceleration by less
than 1e-11 of itself.
The series carry tangents along, derivatives with respect to the state at the start,
for the solver: of every array the last axis holds the value first and then the tangents.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.curves.basis import Indices
from orientd.rotation import Floats, conjugate, multiply, normalize

TERMS = 28
STRIDE = 1.5
"""Bound on the turn over a piece, in rad."""

TANGENTS = 9


@dataclass(frozen=True)
class State:
    """Velocity, acceleration and its rate at the start of segments, of shape ``(n, 3)``."""

    omega: Floats
    alpha: Floats
    jerk: Floats


@dataclass(frozen=True)
class Pieces:
    """The series of consecutive pieces of curves.

    Attributes:
        segment: the segment a piece belongs to, shape ``(m,)``.
        start: when the piece begins, in seconds since its segment does.
        turn: Taylor coefficients of the turn since the segment began, shape ``(m, K, 4)``.
        omega: Taylor coefficients of the body angular velocity, shape ``(m, K, 3)``.
    """

    segment: Indices
    start: Floats
    turn: Floats
    omega: Floats


def series(omega: Floats, alpha: Floats, jerk: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    r"""Return the Taylor coefficients of turn, velocity, acceleration and its rate.

    A convolution :math:`\sum_j A_{k-j} b_j` is one matrix product: the matrices stand side by
    side in reverse order, the vectors below each other.

    Args:
        omega: body angular velocity at the start, and tangents, shape ``(n, 3, d)``.
        alpha: angular acceleration.
        jerk: its rate.

    Returns:
        The turn, which starts as the identity, ``(n, K, 4, d)``, and three of shape
        ``(n, K, 3, d)``.
    """
    n, _, d = omega.shape
    turn = np.zeros((n, TERMS, 4, d))
    parts = [np.zeros((n, TERMS, 3, d)) for _ in range(3)]
    for part, value in zip(parts, (omega, alpha, jerk), strict=True):
        part[:, 0] = value
    turn[:, 0, 0, 0] = 1.0
    rates, accelerations, jerks = parts
    # Of quaternions times the velocity, of the velocity times vectors, and for the tangents of
    # the velocity, of quaternions times vectors and the rate of acceleration times vectors.
    by_rate, minus_rate = np.zeros((n, 4, TERMS, 4)), np.zeros((n, 3, TERMS, 3))
    by_turn, by_jerk = np.zeros((n, 4, TERMS, 3)), np.zeros((n, 3, TERMS, 3))
    for k in range(TERMS - 1):
        back = TERMS - 1 - k
        _set_cross(minus_rate[:, :, back], -rates[:, k, :, 0])
        _set_right_product(by_rate[:, :, back], rates[:, k, :, 0])
        spun = _convolved(by_rate, turn, back, k)
        pulled = _convolved(minus_rate, jerks, back, k)
        if d > 1:
            _set_left_product(by_turn[:, :, back], turn[:, k, :, 0])
            _set_cross(by_jerk[:, :, back], jerks[:, k, :, 0])
            spun[..., 1:] += _convolved(by_turn, rates[..., 1:], back, k)
            pulled[..., 1:] += _convolved(by_jerk, rates[..., 1:], back, k)
        share = 1.0 / (k + 1)
        turn[:, k + 1] = 0.5 * share * spun
        rates[:, k + 1] = share * accelerations[:, k]
        accelerations[:, k + 1] = share * jerks[:, k]
        jerks[:, k + 1] = share * pulled
    return turn, rates, accelerations, jerks


def pieces(state: State, h: Floats) -> Pieces:
    """Return the series of all pieces of segments, in order.

    Args:
        state: at the start of each segment.
        h: durations of the segments, in seconds.
    """
    counts = piece_counts(state, h)
    step = h / counts
    total: Floats = np.zeros((len(h), 4))
    total[:, 0] = 1.0
    now = [state.omega.copy(), state.alpha.copy(), state.jerk.copy()]
    segment, start, turns, omegas = [], [], [], []
    for number in range(int(counts.max())):
        active = np.flatnonzero(counts > number)
        turn, *rest = series(*(part[active, :, None] for part in now))
        segment.append(active)
        start.append(number * step[active])
        turns.append(multiply(total[active][:, None], turn[..., 0]))
        omegas.append(rest[0][..., 0])
        powers = step[active][:, None] ** np.arange(TERMS)
        total[active] = normalize(multiply(total[active], _summed(turn, powers)[..., 0]))
        for part, coefficients in zip(now, rest, strict=True):
            part[active] = _summed(coefficients, powers)[..., 0]
    order = np.lexsort((np.concatenate(start), np.concatenate(segment)))
    return Pieces(
        np.concatenate(segment)[order],
        np.concatenate(start)[order],
        np.concatenate(turns)[order],
        np.concatenate(omegas)[order],
    )


def shoot(state: State, h: Floats) -> tuple[Floats, State, Floats, State]:
    """Return the state at the end of each segment and its derivatives.

    Args:
        state: at the start of each segment.
        h: durations of the segments, in seconds.

    Returns:
        The turn ``(n, 4)`` and the state at the end; then, with respect to the nine components of
        velocity, acceleration and its rate at the start, the body increments of the turn as
        rotation vectors and the derivatives of the state, each of shape ``(n, 3, 9)``.
    """
    counts = piece_counts(state, h)
    step = h / counts
    total: Floats = np.zeros((len(h), 4, 1 + TANGENTS))
    total[:, 0, 0] = 1.0
    now = []
    for place, part in enumerate((state.omega, state.alpha, state.jerk)):
        carried = np.zeros((len(h), 3, 1 + TANGENTS))
        carried[:, :, 0] = part
        carried[:, :, 1 + 3 * place : 4 + 3 * place] = np.eye(3)
        now.append(carried)
    for number in range(int(counts.max())):
        active = np.flatnonzero(counts > number)
        turn, *rest = series(*(part[active] for part in now))
        powers = step[active][:, None] ** np.arange(TERMS)
        piece = np.swapaxes(_summed(turn, powers), 1, 2)
        before = np.swapaxes(total[active], 1, 2)
        after = multiply(before, piece[:, :1])
        after[:, 1:] += multiply(before[:, :1], piece[:, 1:])
        total[active] = np.swapaxes(after, 1, 2)
        for part, coefficients in zip(now, rest, strict=True):
            part[active] = _summed(coefficients, powers)
    columns = np.swapaxes(total, 1, 2)
    increments = 2.0 * multiply(conjugate(columns[:, :1]), columns[:, 1:])[..., 1:]
    return (
        total[:, :, 0],
        State(*(part[:, :, 0] for part in now)),
        np.swapaxes(increments, 1, 2),
        State(*(part[:, :, 1:] for part in now)),
    )


def piece_counts(state: State, h: Floats) -> Indices:
    """Return into how many pieces each segment is cut, from bounds on its velocity.

    The rate of the acceleration keeps its length, which bounds the rest.
    """
    omega, alpha, jerk = (
        np.sqrt(np.sum(part * part, axis=-1)) for part in (state.omega, state.alpha, state.jerk)
    )
    turned = h * (omega + h * (alpha + 0.5 * h * jerk))
    bent = np.cbrt(h**3 * jerk)
    counts: Indices = np.ceil(np.maximum(turned, bent) / STRIDE).astype(np.intp)
    return np.maximum(counts, 1)


def horner(coefficients: Floats, x: Floats) -> tuple[Floats, Floats]:
    """Return polynomials and their derivatives.

    Args:
        coefficients: shape ``(m, K, c)``.
        x: arguments, shape ``(m,)``.

    Returns:
        Two arrays of shape ``(m, c)``.
    """
    at = x[:, None]
    value = np.zeros((coefficients.shape[0], coefficients.shape[2]))
    slope = np.zeros_like(value)
    for k in reversed(range(coefficients.shape[1])):
        slope = slope * at + value
        value = value * at + coefficients[:, k]
    return value, slope


def _convolved(matrices: Floats, vectors: Floats, back: int, k: int) -> Floats:
    """Return the sum of the products of matrices, newest first, with vectors, oldest first."""
    n, rows, _, columns = matrices.shape
    product: Floats = np.matmul(
        matrices[:, :, back:].reshape(n, rows, (k + 1) * columns),
        vectors[:, : k + 1].reshape(n, (k + 1) * columns, -1),
    )
    return product


def _summed(coefficients: Floats, powers: Floats) -> Floats:
    total: Floats = np.einsum("nkcd,nk->ncd", coefficients, powers)
    return total


def _set_cross(out: Floats, v: Floats) -> None:
    """Write the matrices of cross products ``v x``."""
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -v[:, 2], v[:, 1], -v[:, 0]
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = v[:, 2], -v[:, 1], v[:, 0]


def _set_right_product(out: Floats, v: Floats) -> None:
    """Write the matrices of quaternion products with pure quaternions on the right."""
    out[:, 0, 1:], out[:, 1:, 0] = -v, v
    _set_cross(out[:, 1:, 1:], -v)


def _set_left_product(out: Floats, q: Floats) -> None:
    """Write the matrices of products of quaternions with pure quaternions on their right."""
    out[:, 0] = -q[:, 1:]
    _set_cross(out[:, 1:], q[:, 1:])
    for i in range(3):
        out[:, 1 + i, i] = q[:, 0]
