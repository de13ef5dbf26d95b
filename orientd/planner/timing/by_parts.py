"""The quickest timing of a path with corners: smooth parts, each of them from rest to rest.

A curve whose velocity or acceleration has a step at a knot is passed there at rest; so is the end
of one that has a velocity there which nobody asked for.  The path stays what it is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from orientd.curves import Trajectory
from orientd.errors import PlanError
from orientd.planner.limits import Limits
from orientd.planner.timing.axis_turn import SHARE
from orientd.planner.timing.candidate_path import KeyframePath
from orientd.planner.timing.quickest_timing import (
    FirstProfile,
    Profile,
    TimingProblem,
    looked_at,
    quickest,
    retimed,
)
from orientd.rotation import Floats, angle

_STEP = 1e-6  # of the largest velocity and acceleration, between both sides of a knot
_ATTEMPTS = 5  # to get below the limits where the records exceed them
_ABOVE = 1.00005


def corners(trajectory: Trajectory) -> Floats:
    """Return the knots inside a trajectory at which its velocity or acceleration has a step."""
    knots = trajectory.knots[1:-1]
    if trajectory.continuity >= 2 or not len(knots):
        return knots[:0]
    _, omega, alpha = trajectory.sample(np.concatenate([np.nextafter(knots, -np.inf), knots]))
    step = np.zeros(len(knots), dtype=bool)
    for rows in (omega, alpha):
        before, after = np.split(rows, 2)
        largest = np.linalg.norm(rows, axis=1).max()
        step |= np.linalg.norm(after - before, axis=1) > _STEP * largest
    return knots[step]


def least_with_stops(keys: Floats, limits: Limits) -> float:
    """Return what turns from key to key take at the least, from rest to rest, s.

    That is without limits of the jerk and of components.
    """
    turns = angle(keys[:-1], keys[1:])
    turns = turns[turns > 0.0]
    velocity, acceleration = limits.velocity, limits.acceleration
    peaks = np.minimum(np.sqrt(turns * acceleration), velocity)
    # Where neither is limited their quotient is not a number.
    rises = np.fmin(np.sqrt(turns / acceleration), velocity / acceleration)
    return float(np.sum(turns / peaks + rises))


def quickest_by_parts(
    keyframe_path: KeyframePath,
    limits: Limits,
    period: float,
    *,
    share: float = SHARE,
    guess: FirstProfile | Profile | None = None,
) -> KeyframePath:
    """Return the same path in the shortest time that keeps the limits, at rest at its corners.

    Args:
        keyframe_path: any, whose position is at rest at both ends.
        limits: as for :func:`quickest`, like all that have the same name.
        period: likewise.
        share: likewise.
        guess: likewise, for a path without corners from rest to rest.

    Raises:
        PlanError: none was found.
    """
    trajectory = keyframe_path.trajectory
    edges = np.concatenate([[0.0], corners(trajectory), [keyframe_path.duration]])
    if len(edges) == 2 and keyframe_path.is_from_rest_to_rest:
        return quickest(keyframe_path, limits, period, share=share, guess=guess)
    problem = TimingProblem.of(keyframe_path, limits, period, share)
    parts: list[KeyframePath] = []
    for profile in problem.solved_at_rest(edges):
        quick = retimed(keyframe_path, profile)
        parts.append(quick.slowed(quick.duration * profile.slower))
    return _kept(parts, limits, period)


def _kept(parts: list[KeyframePath], limits: Limits, period: float) -> KeyframePath:
    """Return the parts one after the other, each as much slower as its records need it.

    Raises:
        PlanError: they keep the limits at no such speed.
    """
    excess = math.inf
    for _ in range(_ATTEMPTS):
        whole, excess = looked_at(_joined(parts), limits, period, (False, False))
        if excess <= 1.0:
            return whole
        over = [looked_at(part, limits, period, (False, False))[1] for part in parts]
        if max(over) <= 1.0:
            # What is seen where two of them meet depends on where it falls between the records.
            over = [excess] * len(parts)
        parts = [
            part.slowed(part.duration * by * _ABOVE) if by > 1.0 else part
            for part, by in zip(parts, over, strict=True)
        ]
    raise PlanError(f"no quickest timing keeps the limits, by a factor of {excess:g}")


def _joined(parts: Sequence[KeyframePath]) -> KeyframePath:
    """Return parts that follow each other as one path."""
    if len(parts) == 1:
        return parts[0]
    begins = np.concatenate([[0.0], np.cumsum([part.duration for part in parts])]).tolist()
    positions, times = parts[0].positions, np.zeros(len(parts[0].times))
    for part, begin in zip(parts, begins[:-1], strict=True):
        times += part.times
        if begin:
            positions = part.positions.delayed(begin).after(positions)
    shifted = [part.trajectory.shifted(at) for part, at in zip(parts, begins[:-1], strict=True)]
    return KeyframePath(Trajectory.joined(shifted), positions, times)
