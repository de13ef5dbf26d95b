r"""The stationary curves of the integral of squared angular acceleration, as Taylor series.

Between keyframes such a curve satisfies :math:`\Omega''' = \Omega'' \times \Omega` in the body
frame (Noakes, Heinzinger and Paden, 1989, "Cubic splines on curved spaces"): the second
derivative of the velocity stands still in the world frame.  With *p* the turn since the start,

.. math:: p' = \tfrac12 p\, \Omega, \quad \Omega' = \alpha, \quad \alpha' = J, \quad
          J' = J \times \Omega

is polynomial, so its Taylor coefficients follow from each other by convolutions.  Over a piece in
which it turns by about a radian, 28 terms miss the acceleration by less than 1e-11 of itself.  The
series carry tangents along, derivatives with respect to the state at the start, for the solver: of
every array the last axis holds the value first and then the tangents.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.rotation import Floats, conjugate, multiply

TERMS = 28
STRIDE = 1.2
"""How much may happen over a piece: velocity, root of acceleration and cube root of its rate,
each times the duration, in rad."""

TANGENTS = 9


@dataclass(frozen=True)
class LieQuadraticState:
    """Velocity, acceleration and its rate at instants, of shape ``(n, 3)`` each."""

    omega: Floats
    alpha: Floats
    jerk: Floats

    def pace(self) -> Floats:
        """Return what, times a duration, ``STRIDE`` is compared with, in 1/s, shape ``(n,)``."""
        omega, alpha, jerk = (
            np.sqrt(np.sum(part * part, axis=-1)) for part in (self.omega, self.alpha, self.jerk)
        )
        fastest: Floats = np.maximum(np.maximum(omega, np.sqrt(alpha)), np.cbrt(jerk))
        return fastest


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


def shoot(
    state: LieQuadraticState, h: Floats
) -> tuple[Floats, LieQuadraticState, Floats, LieQuadraticState]:
    """Return the state at the end of each piece and its derivatives.

    Args:
        state: at the start of each piece.
        h: durations of the pieces, in seconds.

    Returns:
        The turn ``(n, 4)`` and the state at the end; then, with respect to the nine components of
        velocity, acceleration and its rate at the start, the body increments of the turn as
        rotation vectors and the derivatives of the state, each of shape ``(n, 3, 9)``.
    """
    starts = []
    for place, part in enumerate((state.omega, state.alpha, state.jerk)):
        start = np.zeros((len(h), 3, 1 + TANGENTS))
        start[:, :, 0] = part
        start[:, :, 1 + 3 * place : 4 + 3 * place] = np.eye(3)
        starts.append(start)
    powers = h[:, None] ** np.arange(TERMS)
    turn, *ends = (np.einsum("nkcd,nk->ncd", part, powers) for part in series(*starts))
    columns = np.swapaxes(turn, 1, 2)
    increments = 2.0 * multiply(conjugate(columns[:, :1]), columns[:, 1:])[..., 1:]
    return (
        turn[:, :, 0],
        LieQuadraticState(*(end[:, :, 0] for end in ends)),
        np.swapaxes(increments, 1, 2),
        LieQuadraticState(*(end[:, :, 1:] for end in ends)),
    )


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
