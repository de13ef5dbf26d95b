"""The keyframe equations of a cumulative B-spline of any order, straight from their definition."""

import numpy as np
from reference.torque import torques

from orientd.rotation import (
    between,
    conjugate,
    exp_half,
    log_half,
    multiply,
    right_jacobian,
    rotate,
)


def products(factors):
    """Multiply half-angle vectors' quaternions, shape ``(N, F, 3)``."""
    product = exp_half(factors[:, 0])
    for f in range(1, factors.shape[1]):
        product = multiply(product, exp_half(factors[:, f]))
    return product


def keyframe_equations(increments, index, share, targets):
    """Return derivatives ``(N, 3, 3 F)`` by each factor's increment, and errors ``(N, 3)``."""
    count, factors = index.shape
    turns = share[..., None] * increments[index]
    jacobians = share[..., None, None] * right_jacobian(2.0 * turns)
    after = np.tile([1.0, 0.0, 0.0, 0.0], (count, 1))
    tails = np.empty((count, factors, 4))
    for f in reversed(range(factors)):
        tails[:, f] = after
        after = multiply(exp_half(turns[:, f]), after)
    carried = rotate(conjugate(tails)[:, :, None], np.swapaxes(jacobians, 2, 3))
    derivatives = np.moveaxis(carried, 3, 1).reshape(count, 3, 3 * factors)
    return derivatives, log_half(between(targets, after))


def effort(increments, window, weights, roots, inertia):
    """Return the effort of a spline, its gradients and Gauss-Newton matrices on each span."""
    spans, functions = window.shape
    places = len(roots) // spans
    factors = np.repeat(increments[window], places, axis=0)
    residuals, derivatives = torques(factors, weights, inertia)
    weighted = (roots[:, None] * residuals).reshape(spans, 1, 3 * places)
    rows = (roots[:, None, None] * derivatives.reshape(-1, 3, 3 * functions)).reshape(
        spans, 3 * places, 3 * functions
    )
    gradient, squares = (weighted @ rows)[:, 0], np.swapaxes(rows, 1, 2) @ rows
    return 0.5 * float(np.sum(weighted * weighted)), gradient, squares
