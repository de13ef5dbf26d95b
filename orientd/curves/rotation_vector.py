"""The C2 cubic in the rotation vector, as SciPy's RotationSpline, with end velocities."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from orientd.curves.contract import Ends, WithEndVelocities
from orientd.curves.keyframes import ParameterError, increments
from orientd.curves.newton import Linearised, cross, homotopy, newton, solve_blocks
from orientd.errors import PlanError
from orientd.rotation import Floats, exp, multiply, right_jacobian, right_jacobian_inverse

# Coefficients of (1 - cos x)/x^2 and of (x - sin x)/x^3 in powers of x^2, and of their derivatives
# by x^2.  For |x| up to a whole turn the omitted terms are below rounding.
_INDEX = np.arange(24.0)
_FACTORIALS = np.cumprod(np.arange(1.0, 51.0))
_COSINE = (-1.0) ** _INDEX / _FACTORIALS[1:49:2]
_SINE = (-1.0) ** _INDEX / _FACTORIALS[2:50:2]
_COSINE_RATE, _SINE_RATE = ((_INDEX * terms)[1:] for terms in (_COSINE, _SINE))


class RotationVectorSpline(WithEndVelocities):
    r"""Interpolate keyframes; each segment is a cubic rotation vector from its first keyframe.

    .. math:: q(t) = q_i \exp(r_i(t)), \quad r_i(t_i) = 0, \quad
              r_i(t_{i+1}) = R_i = \log(q_i^{-1} q_{i+1})

    Let :math:`\Omega_i` be the body angular velocity at keyframe *i* and :math:`J` the right
    Jacobian of the exponential at :math:`R_i`.  The end slopes are :math:`\Omega_i` and
    :math:`J_i^{-1} \Omega_{i+1}`.  The acceleration is continuous at keyframe *i* if

    .. math:: \frac{2}{h_{i-1}} J_{i-1} \Omega_{i-1}
              + 4\Bigl(\frac1{h_{i-1}} + \frac1{h_i}\Bigr) \Omega_i
              + \frac{2}{h_i} J_i^{-1} \Omega_{i+1} + \dot J_{i-1} J_{i-1}^{-1} \Omega_i
              = \frac{6 R_{i-1}}{h_{i-1}^2} + \frac{6 R_i}{h_i^2}

    the construction of SciPy's ``RotationSpline`` (Mayorov, 2019).  SciPy uses the mean rate of the
    end interval at both ends, and stops after ten fixed-point iterations without a warning.  Here
    an end has zero acceleration or a given velocity.  Newton's method, with continuation in the
    size of the steps if needed, converges or raises an error.

    Picture: ``orientd plot rotation_vector_spline``.

    Args:
        start: ``"natural"``, no acceleration at the first keyframe, or ``"clamped"``, the
            velocity *omega_start* there.
        end: the same for the last keyframe and *omega_end*.

    Raises:
        PlanError: no velocities are found at which the acceleration is continuous.
    """

    name = "rotation_vector_spline"
    summary = "C2 cubic in the rotation vector, end velocities met"
    source = "Mayorov 2019 (scipy.spatial.transform.RotationSpline)"

    def _solve(self, q: Floats, instants: Floats, ends: Ends) -> None:
        steps = 2.0 * increments(q)
        length = np.sqrt(np.sum(steps * steps, axis=-1))
        if not np.all(length < 2.0 * np.pi * (1.0 - 1e-9)):
            place = int(np.argmax(length))
            raise ParameterError(
                "keys",
                "keys must turn by less than a whole turn from one to the next, got keys"
                f"[{place}] to keys[{place + 1}] {length[place]:.9g} rad apart with their signs",
            )
        self._set_knots(instants, 2)
        h = np.diff(instants)
        omega_body = key_velocities(steps, h, ends[0][0], ends[1][0])
        slope_end = h[:, None] * _apply(right_jacobian_inverse(steps), omega_body[1:])
        self._keys = q
        self._linear = h[:, None] * omega_body[:-1]
        self._square = 3.0 * steps - 2.0 * self._linear - slope_end
        self._cube = self._linear + slope_end - 2.0 * steps

    def _orientations(self, times: Floats) -> Floats:
        span, share = self._shares(times)
        u = share[:, None]
        a, b, c = self._linear[span], self._square[span], self._cube[span]
        return multiply(self._keys[span], exp(u * (a + u * (b + u * c))))


def key_velocities(steps: Floats, h: Floats, first: Floats | None, last: Floats | None) -> Floats:
    """Return the body angular velocities at the keyframes that make the acceleration continuous.

    Args:
        steps: rotation vectors from each keyframe to the next, shape ``(n, 3)``.
        h: intervals, shape ``(n,)``.
        first: velocity at the first keyframe; without it the acceleration there is zero.
        last: the same for the last keyframe.

    Raises:
        PlanError: the continuation in the size of the steps does not reach their full size.
    """

    def scaled(scale: float) -> Callable[[Floats], Linearised]:
        ends = (None if end is None else scale * end for end in (first, last))
        return _equations(scale * steps, h, *ends)

    # The spline of Euclidean space, the limit for small steps.
    still = np.zeros((len(h) + 1, 3))
    start = scaled(1e-6)(still)[1]() / 1e-6
    fastest = max(float(np.max(np.abs(start))), np.finfo(np.float64).tiny)

    def solve(scale: float, guess: Floats) -> Floats | None:
        return newton(
            scaled(scale),
            guess,
            size=lambda step: float(np.max(np.abs(step))) / (scale * fastest),
            tolerance=1e-9,
            longest=np.inf,
        )

    omega_body, reached = homotopy(solve, still, start)
    if reached < 1.0:
        raise PlanError(
            "no cubic rotation-vector spline was found through the keyframes; the search "
            f"stopped at {100.0 * reached:.1f} % of the step sizes: add keyframes or "
            "lower the end velocities"
        )
    return omega_body


def _equations(
    steps: Floats, h: Floats, first: Floats | None, last: Floats | None
) -> Callable[[Floats], Linearised]:
    """Return the steps of the acceleration at the keyframes, as functions of the velocities."""
    back, rate = right_jacobian_inverse(steps), (1.0 / h)[:, None, None]
    linear = np.zeros((len(h) + 1, 3, 9))
    linear[1:, :, 0:3] = 2.0 * rate * right_jacobian(steps)
    linear[1:, :, 3:6] += 4.0 * rate * np.eye(3)
    linear[:-1, :, 3:6] += 4.0 * rate * np.eye(3)
    linear[:-1, :, 6:9] = 2.0 * rate * back
    pull = np.pad(6.0 * steps / (h * h)[:, None], ((1, 1), (0, 0)))
    right = pull[1:] + pull[:-1]
    for place, given in ((0, first), (-1, last)):
        if given is not None:
            linear[place] = np.hstack([np.zeros((3, 3)), np.eye(3), np.zeros((3, 3))])
            right[place] = given
    rows = 3 * np.arange(len(linear))

    def linearised(omega_body: Floats) -> Linearised:
        r, v = steps[:, None], _apply(back, omega_body[1:])[:, None]
        bend = _bend(r, v, v)[:, 0]
        by_v = np.swapaxes(_bend(r, v, np.eye(3)) + _bend(r, np.eye(3), v), 1, 2)
        derivative = by_v @ back
        if last is not None:
            bend[-1], derivative[-1] = 0.0, 0.0
        padded = np.pad(omega_body, ((1, 1), (0, 0)))
        window = np.concatenate([padded[:-2], omega_body, padded[2:]], axis=1)
        error = _apply(linear, window) - right
        error[1:] += bend

        def step() -> Floats:
            blocks = linear.copy()
            blocks[1:, :, 3:6] += derivative
            return solve_blocks(blocks, rows, rows - 3, -error.ravel()).reshape(-1, 3)

        return error, step

    return linearised


def _bend(r: Floats, u: Floats, v: Floats) -> Floats:
    r"""Return a bilinear form that is :math:`\dot J v` for *r* moving at the rate *u* = *v*.

    That is the body angular acceleration of ``exp(r)`` at a constant rate of *r*. The right
    Jacobian is :math:`J v = v - b\, r \times v + c\, r \times (r \times v)`, where *b* and *c* are
    functions of :math:`|r|^2`; *r* is shorter than a whole turn.
    """
    square = np.sum(r * r, axis=-1, keepdims=True)
    c, b_rate, c_rate = (
        np.polynomial.polynomial.polyval(square, terms)
        for terms in (_SINE, _COSINE_RATE, _SINE_RATE)
    )
    across = cross(r, v)
    square_rate = 2.0 * np.sum(r * u, axis=-1, keepdims=True)
    bend: Floats = square_rate * (c_rate * cross(r, across) - b_rate * across)
    bend += c * cross(u, across)
    return bend


def _apply(matrices: Floats, vectors: Floats) -> Floats:
    """Multiply stacked matrices with stacked vectors."""
    product: Floats = np.einsum("nij,nj->ni", matrices, vectors)
    return product
