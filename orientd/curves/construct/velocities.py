"""Velocities at keyframes, estimated from the neighbouring ones, for C1 families."""

from __future__ import annotations

import numpy as np

from orientd.curves.keyframes import increments
from orientd.rotation import Floats, between, log_half

RULES = ("parabola", "mean", "chord")


def half_velocities(keys: Floats, times: Floats, rule: str) -> Floats:
    r"""Return half the body angular velocity to give each keyframe.

    With :math:`L_i = \log(q_i^{-1} q_{i+1})` and :math:`h_i = t_{i+1} - t_i`, ``"parabola"`` is the
    slope of the parabola through three keyframes,
    :math:`(h_{i-1} L_i / h_i + h_i L_{i-1} / h_{i-1}) / (h_{i-1} + h_i)`; ``"mean"`` is the mean of
    the two rates; ``"chord"`` is :math:`\log(q_{i-1}^{-1} q_{i+1}) / (h_{i-1} + h_i)`.  At the ends
    it is the rate of the end segment.

    Args:
        keys: unit quaternions, signs aligned, shape ``(n, 4)``.
        times: increasing instants in seconds, shape ``(n,)``.
        rule: one of ``RULES``.

    Returns:
        Half-angle rates in rad/s in the body frame at each keyframe, shape ``(n, 3)``.
    """
    steps = np.diff(times)[:, None]
    rates = increments(keys) / steps
    velocities: Floats = np.empty((len(keys), 3))
    velocities[0], velocities[-1] = rates[0], rates[-1]
    before, after = steps[:-1], steps[1:]
    if rule == "parabola":
        velocities[1:-1] = (before * rates[1:] + after * rates[:-1]) / (before + after)
    elif rule == "mean":
        velocities[1:-1] = 0.5 * (rates[1:] + rates[:-1])
    else:
        velocities[1:-1] = log_half(between(keys[:-2], keys[2:])) / (before + after)
    return velocities
