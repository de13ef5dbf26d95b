r"""The effort of a cumulative B-spline with its derivatives, compiled by Numba.

Imported by :mod:`orientd.curves.fast` only.  The formulas are those of :mod:`orientd.curves.torque`
and :meth:`~orientd.curves.effort_equations.EffortEquations.linearised`, which are the reference;
node by node, so that no more than one node's matrices are in memory.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numba import boolean, float64, int64, njit, types

from orientd.curves.basis import Indices
from orientd.curves.compiled_lanes import Vector
from orientd.curves.compiled_rotation import (
    add_derivative,
    exponential,
    inner,
    jacobian_factors,
    logarithm,
    multiplied,
    relative,
)
from orientd.curves.fast import Linearise
from orientd.rotation import Floats


@inner
def _put_cross(v: Floats, matrix: Floats) -> None:
    """Write the matrix of the cross product ``v x``."""
    matrix[0, 0] = matrix[1, 1] = matrix[2, 2] = 0.0
    matrix[0, 1], matrix[0, 2], matrix[1, 2] = -v[2], v[1], -v[0]
    matrix[1, 0], matrix[2, 0], matrix[2, 1] = v[2], -v[1], v[0]


@inner
def _put_product(a: Floats, b: Floats, c: Floats) -> None:
    """Write ``a b`` to another matrix *c*."""
    for i in range(3):
        for j in range(3):
            c[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@inner
def _applied(matrix: Floats, v: Floats) -> Vector:
    """Return a matrix times a vector."""
    return (
        matrix[0, 0] * v[0] + matrix[0, 1] * v[1] + matrix[0, 2] * v[2],
        matrix[1, 0] * v[0] + matrix[1, 1] * v[1] + matrix[1, 2] * v[2],
        matrix[2, 0] * v[0] + matrix[2, 1] * v[1] + matrix[2, 2] * v[2],
    )


@inner
def _put_turn(v: Vector, jacobian: Floats, back: Floats) -> None:
    r"""Write the right Jacobian of a rotation vector and the rotation back, :math:`I - [v] J_r`."""
    x, y, z = v
    square = x * x + y * y + z * z
    a, b = jacobian_factors(square)
    rest = 1.0 - b * square
    jacobian[0, 0], jacobian[1, 1], jacobian[2, 2] = (
        rest + b * x * x,
        rest + b * y * y,
        rest + b * z * z,
    )
    jacobian[0, 1], jacobian[1, 0] = b * x * y + a * z, b * x * y - a * z
    jacobian[0, 2], jacobian[2, 0] = b * x * z - a * y, b * x * z + a * y
    jacobian[1, 2], jacobian[2, 1] = b * y * z + a * x, b * y * z - a * x
    for j in range(3):
        p, q, r = jacobian[0, j], jacobian[1, j], jacobian[2, j]
        back[0, j], back[1, j], back[2, j] = z * q - y * r, x * r - z * p, y * p - x * q
        back[j, j] += 1.0


def _linearise(
    increments: Floats, window: Indices, weights: Floats, roots: Floats, inertia: Floats,
    has_inertia: bool, index: Indices, share: Floats, steps: Floats,
    gradient: Floats, squares: Floats, bound: Floats, missed: Floats,
) -> float:  # fmt: skip
    """Write derivatives of the effort and of the keyframe equations, and return the effort.

    Args:
        increments: half-angle vectors, shape ``(count, 3)``.
        window: the increments of each span, shape ``(S, m)``.
        weights: the basis at the nodes, as :func:`~orientd.curves.torque.torques` takes it.
        roots: square roots of the nodes' weights, shape ``(n,)``.
        inertia: shape ``(3, 3)``.
        has_inertia: whether torque counts, not acceleration.
        index: increments of the factors of each keyframe equation, shape ``(N, F)``.
        share: how much of them, shape ``(N, F)``.
        steps: quaternions from keyframe to keyframe, shape ``(N, 4)``.
        gradient: receives the effort's, of each span, shape ``(S, 3 m)``.
        squares: receives the Gauss-Newton matrices, shape ``(S, 3 m, 3 m)``.
        bound: receives the derivatives of the keyframe equations, shape ``(N, 3, 3 F)``.
        missed: receives their errors, shape ``(N, 3)``.
    """
    spans, factors = window.shape
    places = len(roots) // spans
    size = 3 * factors
    backs, spins = np.empty((factors, 3, 3)), np.empty((factors, 3, 3))
    by_omega, by_alpha = np.empty((factors, 3, 3)), np.empty((factors, 3, 3))
    jacobian, cross, other, more = (
        np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)),
    )  # fmt: skip
    ahead, bent = np.empty((3, 3)), np.empty((3, 3))
    omega, alpha, spin, momentum = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    rows, torque = np.empty((3, size)), np.empty(3)
    effort = 0.0
    gradient[:], squares[:] = 0.0, 0.0
    for n in range(len(roots)):
        span = n // places
        omega[:], alpha[:] = 0.0, 0.0
        for j in range(factors):
            w = increments[window[span, j]]
            value, rate, curvature = (
                2.0 * weights[0, j, n], 2.0 * weights[1, j, n], 2.0 * weights[2, j, n],
            )  # fmt: skip
            _put_turn((value * w[0], value * w[1], value * w[2]), jacobian, backs[j])
            omega[0], omega[1], omega[2] = _applied(backs[j], omega)
            alpha[0], alpha[1], alpha[2] = _applied(backs[j], alpha)
            for i in range(3):
                spin[i] = rate * w[i]
            _put_cross(spin, spins[j])
            _put_cross(omega, cross)
            _put_product(cross, jacobian, by_omega[j])
            # ([alpha] - [u][omega]) J
            _put_product(spins[j], cross, other)
            _put_cross(alpha, more)
            for i in range(3):
                for k in range(3):
                    other[i, k] = more[i, k] - other[i, k]
            _put_product(other, jacobian, by_alpha[j])
            for i in range(3):
                for k in range(3):
                    by_omega[j, i, k] *= value
                    by_alpha[j, i, k] = value * by_alpha[j, i, k] + rate * cross[i, k]
                by_omega[j, i, i] += rate
                by_alpha[j, i, i] += curvature
            a, b, c = _applied(cross, spin)
            alpha[0] += a + curvature * w[0]
            alpha[1] += b + curvature * w[1]
            alpha[2] += c + curvature * w[2]
            for i in range(3):
                omega[i] += spin[i]
        if has_inertia:
            momentum[0], momentum[1], momentum[2] = _applied(inertia, omega)
            _put_cross(omega, cross)
            _put_product(cross, inertia, bent)
            a, b, c = _applied(cross, momentum)
            _put_cross(momentum, cross)
            for i in range(3):
                for k in range(3):
                    bent[i, k] -= cross[i, k]
                    ahead[i, k] = inertia[i, k]
            torque[0], torque[1], torque[2] = _applied(inertia, alpha)
            torque[0] += a
            torque[1] += b
            torque[2] += c
        else:
            bent[:], ahead[:] = 0.0, 0.0
            for i in range(3):
                ahead[i, i] = 1.0
                torque[i] = alpha[i]
        root = roots[n]
        for j in range(factors - 1, -1, -1):
            _put_product(ahead, by_alpha[j], other)
            _put_product(bent, by_omega[j], more)
            for i in range(3):
                for k in range(3):
                    rows[i, 3 * j + k] = root * (other[i, k] + more[i, k])
            if j > 0:
                _put_product(ahead, spins[j], other)
                for i in range(3):
                    for k in range(3):
                        more[i, k] = bent[i, k] - other[i, k]
                        other[i, k] = ahead[i, k]
                _put_product(more, backs[j], bent)
                _put_product(other, backs[j], ahead)
        for i in range(3):
            residual = root * torque[i]
            effort += residual * residual
            for k in range(size):
                gradient[span, k] += residual * rows[i, k]
                for m in range(k, size):
                    squares[span, k, m] += rows[i, k] * rows[i, m]
    for span in range(spans):
        for k in range(size):
            for m in range(k):
                squares[span, k, m] = squares[span, m, k]
    for row in range(len(index)):
        after = (1.0, 0.0, 0.0, 0.0)
        for f in range(index.shape[1] - 1, -1, -1):
            c = share[row, f]
            w = increments[index[row, f]]
            x, y, z = c * w[0], c * w[1], c * w[2]
            other[:] = 0.0
            add_derivative(other, c, (2.0 * x, 2.0 * y, 2.0 * z), after)
            for i in range(3):
                for k in range(3):
                    bound[row, i, 3 * f + k] = other[i, k]
            after = multiplied(exponential(x, y, z), after)
        step = steps[row, 0], steps[row, 1], steps[row, 2], steps[row, 3]
        missed[row, 0], missed[row, 1], missed[row, 2] = logarithm(relative(step, after))
    return 0.5 * effort


_INDICES = types.Array(int64, 2, "C", readonly=True)
_TABLE = types.Array(float64, 2, "C", readonly=True)
_SIGNATURE = float64(
    _TABLE, _INDICES, types.Array(float64, 3, "C", readonly=True),
    types.Array(float64, 1, "C", readonly=True), _TABLE, boolean, _INDICES, _TABLE, _TABLE,
    float64[:, ::1], float64[:, :, ::1], float64[:, :, ::1], float64[:, ::1],
)  # fmt: skip

linearise: Linearise = cast(
    Linearise, njit(_SIGNATURE, error_model="numpy", nogil=True, cache=True)(_linearise)
)
