r"""Times for keyframes without times: by chord length, or by a power of it.

The intervals are proportional to the angles between keyframes (Nielson 1993, eq. 23), :math:`t_i =
t_{i-1} + \arccos\langle q_{i-1}, q_i\rangle`.  The angle comes from an arc tangent, which is
precise, plus whole turns.  If a position takes longer than the orientation, both at their limits,
the position sets the interval.

The pace along the curve is found afterwards.  So these times only decide where the curve passes
between the keyframes.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from orientd.errors import PlanError, RequestError
from orientd.model.limits import LONGEST, Limits
from orientd.model.request import DEFAULT_METHOD, MotionRequest
from orientd.rotation import Floats, align, angle, between, log

SAME = 1e-9
"""Rad and m; closer keyframes count as one."""

BESIDE = 1.5e-4
"""Rad; keyframes closer than this, 0.009 degrees, count as one if their neighbours are far.

This is less than the repeatability of a joint, and a tenth of a servo's step.  Passing both would
take a turn on the spot.
"""

_FAR_LESS = 1e-3  # share of the longer interval next to a short one
_POWER = 0.6  # of its length, that an interval of a fast motion takes
_SLOWER = 0.5  # share of its time that it takes more at each end that is a rest

Indices = np.ndarray[Any, np.dtype[np.intp]]
Booleans = np.ndarray[Any, np.dtype[np.bool_]]


@dataclass(frozen=True, slots=True, eq=False)
class Knots:
    """Keyframes with times up to a factor.

    Attributes:
        times: from 0 on, one for every keyframe of the request.
        kept: indices of the keyframes that the curve passes; the others repeat one of them.
        length: of the path, rad.
        leaves_freely: whether the curve leaves rest with an acceleration, since a timing follows.
    """

    times: Floats
    kept: Indices
    length: float = 0.0
    leaves_freely: bool = False

    def merged(self, request: MotionRequest) -> tuple[str, ...]:
        """Return notes on keyframes that are close to another and count as one with it."""
        if len(self.kept) == len(self.times):
            return ()
        left_out = np.setdiff1d(np.arange(len(self.times)), self.kept)
        # Keyframes that count as one have one time.
        owners = self.kept[np.searchsorted(self.times[self.kept], self.times[left_out])]
        apart = angle(request.keys[left_out], request.keys[owners])
        return tuple(
            f"{request.named(one)} is {far:.2g} rad from {request.named(owner)}: passed as one"
            for one, owner, far in zip(
                *map(np.ndarray.tolist, (left_out, owners, apart)), strict=True
            )
            if far > SAME
        )

    def first_guess(self, limits: Limits) -> float:
        """Return the approximate duration of the motion, s, to begin a search with."""
        count = len(self.kept) - 1
        step = self.length / count
        return max(
            1.2 * self.length / limits.velocity,
            count * math.sqrt(3.0 * step / limits.acceleration),
            count * math.cbrt(12.0 * step / limits.jerk),
        )


def chord_knots(request: MotionRequest, limits: Limits, *, is_uniform: bool) -> Knots:
    """Return times for the keyframes of a request without times.

    Args:
        limits: weigh turns against moves.
        is_uniform: equal intervals instead, for curves that do not interpolate.

    Raises:
        RequestError: the keyframes are all the same.
        PlanError: the path is too long for the limits of velocity, whatever the curve.
    """
    lengths = turn_lengths(request)
    if not is_uniform:
        _check_way(lengths, limits.velocity)
    moves = move_lengths(request, limits)
    if moves is not None:
        _check_way(moves, limits.linear_velocity)
        lengths = np.maximum(lengths, moves * radians_per_metre(limits))
    is_repeated = lengths <= SAME
    if not is_uniform:
        is_repeated |= _is_beside(lengths)
    if is_repeated.all():
        raise RequestError("keyframes", "are all the same; give them times to make the device wait")
    length, count = float(lengths.sum()), len(request.keyframes)
    kept = np.arange(count)
    if is_uniform:
        return Knots(np.linspace(0.0, 1.0, count), kept, length)
    if is_repeated.any():
        lengths[is_repeated] = 0.0
        kept = np.flatnonzero(np.concatenate([[True], ~is_repeated]))
        # The motion ends at the last keyframe, even if that is close to another.
        is_other = float(angle(request.keys[kept[-1]], request.keys[-1])) > SAME
        if is_other and len(kept) > 1 and not request.turns[kept[-1] :].any():
            kept[-1] = count - 1
    times = np.concatenate([[0.0], np.cumsum(lengths)])
    return Knots(times / times[-1], kept, length)


def quick_knots(request: MotionRequest, knots: Knots) -> Knots:
    """Return times of nearly the fastest motion, on a curve that leaves rest with an acceleration.

    A longer interval takes less time than in proportion, since it is passed at a higher velocity.
    It takes more time next to a rest or a corner, where the velocity is low.

    Args:
        knots: by chord length.
    """
    is_default = request.method == DEFAULT_METHOD and not request.options
    if not is_default or request.positions is not None or request.turns.any():
        return knots
    inner, keys = knots.times[knots.kept], align(request.keys[knots.kept])
    steps = log(between(keys[:-1], keys[1:]))
    steps /= np.maximum(np.linalg.norm(steps, axis=1), SAME)[:, None]
    # From straight on, 0, to turning back, 1, which is as slow as a rest.
    corners = 0.5 * (1.0 - np.einsum("ij,ij->i", steps[:-1], steps[1:]))
    slow = np.concatenate([[1.0], corners, [1.0]])
    takes = np.diff(inner) ** _POWER * (1.0 + _SLOWER * (slow[:-1] + slow[1:]))
    times = np.concatenate([[0.0], np.cumsum(takes)])
    times = np.interp(knots.times, inner, times / times[-1])
    return replace(knots, times=times, leaves_freely=True)


def _is_beside(lengths: Floats) -> Booleans:
    """Return which intervals are unreasonably short compared with their neighbours."""
    padded = np.concatenate([[0.0], lengths, [0.0]])
    longer = np.maximum(padded[:-2], padded[2:])
    is_beside: Booleans = (lengths <= BESIDE) & (lengths <= _FAR_LESS * longer)
    return is_beside


def turn_lengths(request: MotionRequest) -> Floats:
    """Return the angle of each interval, whole turns included, rad, shape ``(n - 1,)``."""
    lengths = angle(request.keys[:-1], request.keys[1:])
    if request.turns.any():
        lengths += 2.0 * np.pi * np.abs(request.turns[1:])
    return lengths


def move_lengths(request: MotionRequest, limits: Limits) -> Floats | None:
    """Return the distance of the position in each interval, m; ``None`` if it does not matter.

    A distance is spread over intervals whose ends have no position.
    """
    positions = request.positions
    if positions is None or not math.isfinite(limits.linear_velocity):
        return None
    lengths = np.zeros(len(positions) - 1)
    given = np.flatnonzero(np.isfinite(positions[:, 0]))
    for first, last in pairwise(given):
        distance = float(np.linalg.norm(positions[last] - positions[first]))
        lengths[first:last] = distance / (last - first)
    return lengths


def _check_way(lengths: Floats, velocity: float) -> None:
    least = float(lengths.sum()) / velocity
    if not least <= LONGEST:
        raise PlanError(
            f"the keyframes take {least:.6g} s at the limit of the velocity, at most {LONGEST:g} s "
            "is planned"
        )


def radians_per_metre(limits: Limits) -> float:
    """Return the turn in the time of a metre, both at their limits, rad/m."""
    if not math.isfinite(limits.velocity):
        return 1.0
    # Finite, since it may be multiplied by a distance of zero.
    return min(limits.velocity / limits.linear_velocity, sys.float_info.max)
