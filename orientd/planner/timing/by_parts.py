"""The quickest timing of a path with corners: smooth parts, each of them from rest to rest.

A curve whose velocity or acceleration has a step at a knot is passed there at rest; so is the end
of one that has a velocity there which nobody asked for.  The path stays what it is.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from orientd.curves import Curve, Samples
from orientd.planner.limits import Limits
from orientd.planner.path import Path, PathCurve, PathSegment
from orientd.planner.timing.axis_turn import SHARE
from orientd.planner.timing.candidate_path import KeyframePath
from orientd.planner.timing.quickest_timing import FirstProfile, quickest
from orientd.rotation import Floats, angle

_STEP = 1e-6  # of the largest velocity and acceleration, between both sides of a knot
_REST = 1e-9  # of the largest velocity
_NEWTON_STEPS = 8


class RestingPart(Curve):
    r"""A smooth part of a curve, on a clock on which it begins and ends at rest.

    Near an end where the curve moves, its parameter goes like
    :math:`\ell (z^3 - z^4/2), z = x/\ell`, which has two continuous derivatives to where it goes
    like *x* again.

    Args:
        curve: any.
        begin: parameter where the part begins, a knot.
        end: where it ends, another one.
    """

    def __init__(self, curve: Curve, begin: float, end: float) -> None:
        self._curve, self._from, self._to = curve, begin, end
        # At a knot a curve is what begins there.
        self._last = end if end == curve.domain[1] else float(np.nextafter(end, begin))
        knots = curve.knots[(curve.knots > begin) & (curve.knots < end)]
        edges = np.concatenate([[begin], knots, [end]])
        middles = 0.5 * (edges[1:] + edges[:-1])
        _, omega, _ = curve.evaluate(np.concatenate([[begin, self._last], middles]))
        speeds = np.linalg.norm(omega, axis=1)
        spans = np.diff(edges) * (1.0 if len(knots) else 0.5)
        moves = speeds[:2] > _REST * speeds.max()
        self._lengths = np.where(moves, 2.0 * spans[[0, -1]], 0.0)
        super().__init__(knots=self.places(edges), continuity=2)

    def places(self, parameters: Floats) -> Floats:
        """Return where on its own clock the curve's parameter has given values."""
        first, last = self._lengths.tolist()
        total = self._to - self._from + 0.5 * (first + last)
        places: Floats = parameters - self._from + 0.5 * first
        early = parameters < self._from + 0.5 * first
        late = parameters > self._to - 0.5 * last
        places[early] = _left(np.maximum(parameters[early] - self._from, 0.0), first)
        places[late] = total - _left(np.maximum(self._to - parameters[late], 0.0), last)
        return places

    def _sample(self, times: Floats) -> Samples:
        first, last = self._lengths.tolist()
        parameter = self._from + times - 0.5 * first
        rate, change = np.ones(len(times)), np.zeros(len(times))
        for length, ahead, sign in (
            (first, times, 1.0),
            (last, self.domain[1] - times, -1.0),
        ):
            near = ahead < length
            if near.any():
                z = ahead[near] / length
                way = length * z**3 * (1.0 - 0.5 * z)
                parameter[near] = self._from + way if sign > 0.0 else self._to - way
                rate[near] = z * z * (3.0 - 2.0 * z)
                change[near] = sign * 6.0 * z * (1.0 - z) / length
        inside = np.clip(parameter, self._from, self._last)
        q, omega, alpha = self._curve.evaluate(inside)
        rates = rate[:, None]
        return q, omega * rates, alpha * rates**2 + omega * change[:, None]


def _left(ways: Floats, length: float) -> Floats:
    """Return when so much of the way has been gone that is gone while rest is left."""
    if not length:
        return np.zeros(len(ways))
    goal, z = ways / length, np.cbrt(ways / length)
    for _ in range(_NEWTON_STEPS):
        slope = z * z * (3.0 - 2.0 * z)
        z = z - np.divide(z**3 * (1.0 - 0.5 * z) - goal, slope, where=slope > 0.0, out=0.0 * z)
    return length * z


def corners(curve: Curve) -> Floats:
    """Return the knots inside a curve at which its velocity or acceleration has a step."""
    knots = curve.knots[1:-1]
    if curve.continuity >= 2 or not len(knots):
        return knots[:0]
    _, omega, alpha = curve.evaluate(np.concatenate([np.nextafter(knots, -np.inf), knots]))
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
    peaks = np.minimum(np.sqrt(turns * limits.acceleration), limits.velocity)
    times = turns / np.maximum(peaks, 1e-300) + peaks / limits.acceleration
    return float(np.sum(times[turns > 0.0]))


def least_with_rests(keyframe_path: KeyframePath, limits: Limits) -> float:
    """Return what a path takes at the least that rests at its corners, s."""
    curve = keyframe_path.segment.curve
    begin, end = curve.domain
    q, _, _ = curve.evaluate(np.concatenate([[begin], corners(curve), [end]]))
    return least_with_stops(q, limits)


def quickest_by_parts(
    keyframe_path: KeyframePath,
    limits: Limits,
    period: float,
    *,
    share: float = SHARE,
    guess: FirstProfile | None = None,
) -> KeyframePath:
    """Return the same path in the shortest time that keeps the limits, at rest at its corners.

    Args:
        keyframe_path: at one position.
        limits: as for :func:`quickest`, like all that have the same name.
        period: likewise.
        share: likewise.
        guess: likewise, for a path without corners from rest to rest.

    Raises:
        PlanError: none was found.
    """
    curve, rate = keyframe_path.segment.curve, keyframe_path.segment.rate
    begin, end = curve.domain
    edges = [begin, *corners(curve).tolist(), end]
    if len(edges) == 2 and keyframe_path.is_from_rest_to_rest:
        return quickest(keyframe_path, limits, period, share=share, guess=guess)
    parameters = begin + keyframe_path.times * rate
    times, duration = np.zeros(len(parameters)), 0.0
    segments: list[PathSegment] = []
    for first, last in pairwise(edges):
        part = RestingPart(curve, first, last)
        segment = PathSegment(part, 0.0, part.domain[1] / rate, rate)
        path = KeyframePath(segment, keyframe_path.positions, part.places(parameters) / rate)
        quick = quickest(path, limits, period, share=share)
        segments.append(quick.segment.shifted(duration))
        times += np.clip(quick.times, 0.0, quick.duration)
        duration += quick.duration
    if len(segments) == 1:
        return quick
    whole = PathCurve(Path.joined(segments, keyframe_path.positions).segments)
    return KeyframePath(PathSegment(whole, 0.0, duration), keyframe_path.positions, times)
