"""The C2 cubic in the rotation vector, which SciPy's RotationSpline draws, with end velocities."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.construct import solve_blocks
from orientd.curves.contract import Curve, takes_common_names
from orientd.curves.keyframes import (
    ParameterError,
    check_aligned,
    check_end,
    increments,
    resolve_times,
)
from orientd.curves.newton import Linearised, homotopy, newton
from orientd.errors import PlanError
from orientd.rotation import Floats, exp, multiply, right_jacobian, right_jacobian_inverse

# Coefficients of (1 - cos x)/x^2 and of (x - sin x)/x^3 in powers of x^2, and of their derivatives
# with respect to it.  For |x| up to a whole turn the terms left out are below rounding.
_INDEX = np.arange(24.0)
_FACTORIALS = np.cumprod(np.arange(1.0, 51.0))
_COSINE = (-1.0) ** _INDEX / _FACTORIALS[1:49:2]
_SINE = (-1.0) ** _INDEX / _FACTORIALS[2:50:2]
_COSINE_RATE, _SINE_RATE = ((_INDEX * terms)[1:] for terms in (_COSINE, _SINE))


class RotationVectorSpline(Curve):
    r"""Interpolate keyframes, each segment a cubic rotation vector from its first keyframe on.

    .. math:: q(t) = q_i \exp(r_i(t)), \quad r_i(t_i) = 0, \quad
              r_i(t_{i+1}) = R_i = \log(q_i^{-1} q_{i+1})

    With :math:`\Omega_i` the body angular velocity at keyframe *i* and :math:`J` the right
    Jacobian of the exponential at :math:`R_i`, the end slopes are :math:`\Omega_i` and
    :math:`J_i^{-1} \Omega_{i+1}`; the acceleration is continuous at keyframe *i* when

    .. math:: \frac{2}{h_{i-1}} J_{i-1} \Omega_{i-1}
              + 4\Bigl(\frac1{h_{i-1}} + \frac1{h_i}\Bigr) \Omega_i
              + \frac{2}{h_i} J_i^{-1} \Omega_{i+1} + \dot J_{i-1} J_{i-1}^{-1} \Omega_i
              = \frac{6 R_{i-1}}{h_{i-1}^2} + \frac{6 R_i}{h_i^2}

    the construction of SciPy's ``RotationSpline`` (Mayorov, 2019).  SciPy prescribes at both ends
    the mean rate of the end interval, and stops after ten fixed-point iterations without a word.
    Here ends are free of acceleration or have a velocity given, and Newton's method, with
    continuation in the size of the steps where it must, either converges or says so.

    Picture: ``orientd plot rotation_vector_spline``.

    Args:
        keys: unit quaternions ``(w, x, y, z)``, at least two.
        times: instants in seconds, ``"uniform"``, or ``"chord"``, which ``None`` stands for.
        start: ``"natural"``, no acceleration at the first keyframe, or ``"clamped"``, the
            velocity *omega_start* there.
        end: the same for the last keyframe and *omega_end*.
        omega_start: body angular velocity, rad/s.
        omega_end: body angular velocity, rad/s.
        align: whether each keyframe takes the sign nearer to its predecessor.

    Raises:
        ValueError: a parameter is not as said.
        PlanError: no velocities are found at which the acceleration is continuous.
    """

    name = "rotation_vector_spline"
    summary = "C2 cubic in the rotation vector, end velocities met"
    source = "Mayorov 2019 (scipy.spatial.transform.RotationSpline)"
    interpolates = True
    meets_end_velocities = True
    takes = ("keys", "times", "start", "end", "omega_start", "omega_end", "align")

    @takes_common_names
    def __init__(
        self,
        *,
        keys: ArrayLike,
        times: str | ArrayLike | None = None,
        start: str = "natural",
        end: str = "natural",
        omega_start: ArrayLike | None = None,
        omega_end: ArrayLike | None = None,
        align: bool = True,
    ) -> None:
        q = check_aligned(keys, align)
        instants = resolve_times(times, q)
        first, _ = check_end(start, "start", omega_start)
        last, _ = check_end(end, "end", omega_end)
        steps = 2.0 * increments(q)
        length = np.sqrt(np.sum(steps * steps, axis=-1))
        if not np.all(length < 2.0 * np.pi * (1.0 - 1e-9)):
            place = int(np.argmax(length))
            raise ParameterError(
                "keys",
                "keys must turn by less than a whole turn from one to the next, got keys"
                f"[{place}] to keys[{place + 1}] {length[place]:.9g} rad apart with their signs",
            )
        super().__init__(knots=instants, continuity=2)
        self._end_velocities = first, last
        h = np.diff(instants)
        omega_body = key_velocities(steps, h, first, last)
        slope_end = h[:, None] * _apply(right_jacobian_inverse(steps), omega_body[1:])
        self._keys = q
        self._linear = h[:, None] * omega_body[:-1]
        self._square = 3.0 * steps - 2.0 * self._linear - slope_end
        self._cube = self._linear + slope_end - 2.0 * steps

    @property
    def _end_states(self) -> tuple[tuple[Floats | None, Floats | None], ...]:
        first, last = self._end_velocities
        return (first, None), (last, None)

    def _orientations(self, times: Floats) -> Floats:
        span = self._segments(times)
        u = ((times - self._knots[span]) / (self._knots[span + 1] - self._knots[span]))[:, None]
        a, b, c = self._linear[span], self._square[span], self._cube[span]
        return multiply(self._keys[span], exp(u * (a + u * (b + u * c))))


def key_velocities(steps: Floats, h: Floats, first: Floats | None, last: Floats | None) -> Floats:
    """Return the body angular velocities at the keyframes that make the acceleration continuous.

    Args:
        steps: rotation vectors from each keyframe to the next, shape ``(n, 3)``.
        h: intervals, shape ``(n,)``.
        first: velocity at the first keyframe; without it the acceleration there is zero.
        last: the same for the last keyframe.

    Returns:
        Shape ``(n + 1, 3)``.

    Raises:
        PlanError: the continuation in the size of the steps does not reach their full size.
    """

    def scaled(scale: float) -> _Equations:
        ends = (None if end is None else scale * end for end in (first, last))
        return _Equations(scale * steps, h, *ends)

    # The spline of Euclidean space, which is what small steps come to.
    start = scaled(1e-6).linear_solution() / 1e-6
    fastest = max(float(np.max(np.abs(start))), np.finfo(np.float64).tiny)

    def solve(scale: float, guess: Floats) -> Floats | None:
        return newton(
            scaled(scale).linearised,
            guess,
            size=lambda step: float(np.max(np.abs(step))) / (scale * fastest),
            tolerance=1e-9,
            iterations=20,
            nearby=np.inf,
            contraction=2.0,
        )

    omega_body, reached = homotopy(solve, np.zeros_like(start), start)
    if reached < 1.0:
        raise PlanError(
            "no cubic rotation-vector spline was found through the keyframes; the search "
            f"stopped at {100.0 * reached:.1f} % of the step sizes: add keyframes or "
            "lower the end velocities"
        )
    return omega_body


class _Equations:
    """Continuity of acceleration at each keyframe, in the velocities at the keyframes."""

    def __init__(self, steps: Floats, h: Floats, first: Floats | None, last: Floats | None) -> None:
        count = len(h) + 1
        self._steps, self._last = steps, last
        self._back = right_jacobian_inverse(steps)
        rate = (1.0 / h)[:, None, None]
        self._blocks = np.zeros((count, 3, 9))
        self._blocks[1:, :, 0:3] = 2.0 * rate * right_jacobian(steps)
        self._blocks[1:, :, 3:6] += 4.0 * rate * np.eye(3)
        self._blocks[:-1, :, 3:6] += 4.0 * rate * np.eye(3)
        self._blocks[:-1, :, 6:9] = 2.0 * rate * self._back
        pull = 6.0 * steps / (h * h)[:, None]
        self._right = np.zeros((count, 3))
        self._right[1:] += pull
        self._right[:-1] += pull
        for place, given in ((0, first), (-1, last)):
            if given is not None:
                self._blocks[place] = np.hstack([np.zeros((3, 3)), np.eye(3), np.zeros((3, 3))])
                self._right[place] = given

    def linear_solution(self) -> Floats:
        """Return the velocities without the term quadratic in them."""
        return _solved(self._blocks, self._right)

    def linearised(self, omega_body: Floats) -> Linearised:
        """Return the steps of the acceleration, and how to solve for the velocities."""
        bend, derivative = self._bend(omega_body)
        padded = np.pad(omega_body, ((1, 1), (0, 0)))
        window = np.concatenate([padded[:-2], omega_body, padded[2:]], axis=1)
        error = _apply(self._blocks, window) - self._right
        error[1:] += bend

        def step() -> Floats:
            blocks = self._blocks.copy()
            blocks[1:, :, 3:6] += derivative
            return _solved(blocks, -error)

        return error, step

    def _bend(self, omega_body: Floats) -> tuple[Floats, Floats]:
        r"""Return :math:`\dot J J^{-1} \Omega`, the bend of the exponential, and its derivative.

        It is quadratic in :math:`v = J^{-1} \Omega`, so half the difference between ``v + e`` and
        ``v - e`` is its derivative along *e*.
        """
        v = _apply(self._back, omega_body[1:])
        scale = 1.0 + np.sqrt(np.sum(v * v, axis=-1))
        axes = scale[:, None] * np.eye(3)[:, None, :]
        change = (bend_along(self._steps, v + axes) - bend_along(self._steps, v - axes)) / 2.0
        along_axes = np.moveaxis(change / scale[:, None], 0, -1)
        bend, derivative = bend_along(self._steps, v), along_axes @ self._back
        if self._last is not None:
            bend[-1], derivative[-1] = 0.0, 0.0
        return bend, derivative


def bend_along(r: Floats, v: Floats) -> Floats:
    r"""Return the body angular acceleration of ``exp(r)`` as *r* moves at the constant rate *v*.

    It is :math:`\dot J v` with the right Jacobian
    :math:`J v = v - b\, r \times v + c\, r \times (r \times v)`, of which *b* and *c* are functions
    of :math:`|r|^2`.

    Args:
        r: rotation vectors, shape ``(n, 3)``, shorter than a whole turn.
        v: shape ``(..., n, 3)``.
    """
    square = np.sum(r * r, axis=-1)[:, None]
    c, b_rate, c_rate = (
        np.polynomial.polynomial.polyval(square, terms)
        for terms in (_SINE, _COSINE_RATE, _SINE_RATE)
    )
    across = np.cross(r, v)
    square_rate = 2.0 * np.sum(r * v, axis=-1, keepdims=True)
    bend: Floats = c * np.cross(v, across)
    bend += square_rate * (c_rate * np.cross(r, across) - b_rate * across)
    return bend


def _solved(blocks: Floats, right: Floats) -> Floats:
    rows = 3 * np.arange(len(blocks))
    return solve_blocks(blocks, rows, rows - 3, right.ravel()).reshape(-1, 3)


def _apply(matrices: Floats, vectors: Floats) -> Floats:
    """Multiply stacked matrices with stacked vectors."""
    product: Floats = np.einsum("nij,nj->ni", matrices, vectors)
    return product
