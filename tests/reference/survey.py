"""Looks at a keyframe path in plain NumPy, as ``orientd/kernels/c/even.c``."""

from __future__ import annotations

import math

import numpy as np

from orientd.model.limits import Limits
from orientd.planner import HISTORY
from orientd.planner.certify.measuring import OFF_GRID, Peaks, measure
from orientd.planner.path import Path
from orientd.planner.timing.keyframe_path import KeyframePath
from orientd.rotation import Floats
from orientd.tolerances import GUARD_TOLERANCE

PIECES = 64
SHARES = np.array([1e-6, 0.25, 0.5, 0.75, 1.0 - 1e-6])


def coarse_factor(keyframe_path: KeyframePath, limits: Limits, period: float) -> float:
    """Return by which factor a keyframe path should take longer, from a few instants of it.

    It keeps its position, and its acceleration is continuous.
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
    return float(factors.max())


def factor_of_records(keyframe_path: KeyframePath, limits: Limits, period: float) -> float:
    """Return by which factor a keyframe path should take longer, from all of its records.

    A motion made *f* times as slow turns *f* times as slowly, with accelerations :math:`f^2` and
    jerks :math:`f^3` times as small; jerks of a curve whose acceleration has steps are steps over a
    period, which shrink with :math:`f^2`.
    """
    peaks, level = _peaks(keyframe_path, limits, period), keyframe_path.trajectory.continuity
    bend, twist = OFF_GRID[level]
    spins, bends, twists = (share / GUARD_TOLERANCE for share in peaks.drawn)
    spun, bent, twisted = peaks.planned
    return max(
        spun,
        spins,
        math.sqrt(max(bend * bent, bends)),
        (math.cbrt if level >= 2 else math.sqrt)(max(twist * twisted, twists)),
        peaks.linear_velocity.ratio,
        math.sqrt(peaks.linear_acceleration.ratio),
    )


def _peaks(keyframe_path: KeyframePath, limits: Limits, period: float) -> Peaks:
    """Return the largest backward differences of a path alone, held where it begins or ends so."""

    path = Path(keyframe_path.trajectory, keyframe_path.positions)
    is_held, holds_after = keyframe_path.held_ends(limits)
    before = np.tile(path.first, (HISTORY, 1)), np.tile(path.positions.first, (HISTORY, 1))
    return measure(
        path,
        round(keyframe_path.duration / period) + 1,
        period,
        limits,
        before=before if is_held else None,
        rests=(is_held, holds_after),
    )


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
