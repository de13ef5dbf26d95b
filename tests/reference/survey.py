"""A quick look at a keyframe path in plain NumPy, as :mod:`orientd.planner.timing.survey`."""

from __future__ import annotations

import numpy as np

from orientd.planner.limits import Limits
from orientd.planner.timing.candidate_path import KeyframePath
from orientd.planner.timing.survey import HOT, PIECES, SHARES
from orientd.rotation import Floats


def surveyed(keyframe_path: KeyframePath, limits: Limits, period: float) -> tuple[float, Floats]:
    """Return by which factor a keyframe path should take longer, and where that is decided.

    The keyframe path has one shape and keeps its position, and its acceleration is continuous.

    Returns:
        The factor, and parts of the duration, from 0 to 1, shape ``(m, 2)``.
    """
    instants = _instants(keyframe_path)
    _, omega, alpha = keyframe_path.trajectory.sample(instants)
    steps = np.maximum(np.diff(instants), period)
    twists = np.zeros(len(instants))
    twists[1:] = _shares(np.diff(alpha, axis=0), limits, "jerk") / steps
    factors = np.maximum.reduce(
        [
            _shares(omega, limits, "velocity"),
            np.sqrt(_shares(alpha, limits, "acceleration")),
            np.cbrt(twists),
        ]
    )
    hot = np.flatnonzero(factors >= HOT * factors.max())
    begins = instants[np.maximum(hot - 1, 0)]
    ends = instants[np.minimum(hot + 1, len(instants) - 1)]
    if not all(keyframe_path.held_ends(limits)):
        begins = np.concatenate([[0.0, keyframe_path.duration], begins])
        ends = np.concatenate([[0.0, keyframe_path.duration], ends])
    return float(factors.max()), _merged(begins, ends) / keyframe_path.duration


def _instants(keyframe_path: KeyframePath) -> Floats:
    breaks = keyframe_path.trajectory.knots
    breaks = breaks[(breaks >= 0.0) & (breaks <= keyframe_path.duration)]
    if len(breaks) < PIECES:
        breaks = np.union1d(breaks, np.linspace(0.0, keyframe_path.duration, PIECES + 1))
    widths = np.diff(breaks)
    begins, widths = breaks[:-1][widths > 0.0], widths[widths > 0.0]
    instants: Floats = (begins[:, None] + widths[:, None] * SHARES).reshape(-1)
    return instants


def _shares(vectors: Floats, limits: Limits, name: str) -> Floats:
    shares = np.linalg.norm(vectors, axis=1) / float(getattr(limits, name))
    if limits.has_axes:
        shares = np.maximum(shares, np.max(np.abs(vectors) / limits.axes(name), axis=-1))
    return shares


def _merged(begins: Floats, ends: Floats) -> Floats:
    """Return the union of intervals, as intervals in order, shape ``(m, 2)``."""
    order = np.argsort(begins)
    begins, ends = begins[order], np.maximum.accumulate(ends[order])
    is_new = np.concatenate([[True], begins[1:] > ends[:-1]])
    firsts = np.flatnonzero(is_new)
    lasts = np.concatenate([firsts[1:] - 1, [len(begins) - 1]])
    return np.stack([begins[firsts], ends[lasts]], axis=-1)
