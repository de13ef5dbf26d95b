"""The quickest timing of a path with corners: smooth parts, each of them from rest to rest.

A curve whose velocity or acceleration has a step at a knot is passed there at rest; so is the end
of one that has a velocity there which nobody asked for.  The path stays what it is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from orientd.curves import Curve, Samples
from orientd.planner.limits import Limits
from orientd.planner.path import Path, PathCurve, PathSegment, PositionPath, repositioned
from orientd.planner.timing.axis_turn import SHARE
from orientd.planner.timing.candidate_path import KeyframePath
from orientd.planner.timing.quickest_timing import FirstProfile, Profile, quickest
from orientd.rotation import Floats, angle

_STEP = 1e-6  # of the largest velocity and acceleration, between both sides of a knot
_REST = 1e-9  # of the largest velocity
_NEWTON_STEPS = 8
_PIECES = 32  # of a part at the least, in which its position is a quintic
_APART = 1e-9  # of a part's length, which pieces are longer than


class RestingPart(Curve):
    r"""A smooth part of a curve, on a clock on which it begins and ends at rest.

    Near an end where the curve moves, its parameter goes like
    :math:`\ell (z^3 - z^4/2), z = x/\ell`, which has two continuous derivatives to where it goes
    like *x* again.

    Args:
        curve: any.
        begin: parameter where the part begins, a knot.
        end: where it ends, another one.
        moves: whether something else moves at the beginning and at the end.
    """

    def __init__(
        self, curve: Curve, begin: float, end: float, *, moves: tuple[bool, bool] = (False, False)
    ) -> None:
        self._curve, self._from, self._to = curve, begin, end
        # At a knot a curve is what begins there.
        self._last = end if end == curve.domain[1] else float(np.nextafter(end, begin))
        knots = curve.knots[(curve.knots > begin) & (curve.knots < end)]
        edges = np.concatenate([[begin], knots, [end]])
        middles = 0.5 * (edges[1:] + edges[:-1])
        _, omega, _ = curve.evaluate(np.concatenate([[begin, self._last], middles]))
        speeds = np.linalg.norm(omega, axis=1)
        spans = np.diff(edges) * (1.0 if len(knots) else 0.5)
        is_moving = np.array(moves) | (speeds[:2] > _REST * speeds.max())
        self._lengths = np.where(is_moving, 2.0 * spans[[0, -1]], 0.0)
        super().__init__(knots=self.places(edges), continuity=2)

    @property
    def origin(self) -> float:
        """The parameter where the whole curve begins."""
        return self._curve.domain[0]

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

    def parameters(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the curve's parameter and its first two derivatives by the clock."""
        first, last = self._lengths.tolist()
        parameter = self._from + times - 0.5 * first
        rate, change = np.ones(len(times)), np.zeros(len(times))
        for length, ahead, sign in (
            (first, times, 1.0),
            (last, self.domain[1] - times, -1.0),
        ):
            near = ahead < length
            if near.any():
                z = np.maximum(ahead[near], 0.0) / length
                way = length * z**3 * (1.0 - 0.5 * z)
                parameter[near] = self._from + way if sign > 0.0 else self._to - way
                rate[near] = z * z * (3.0 - 2.0 * z)
                change[near] = sign * 6.0 * z * (1.0 - z) / length
        return np.clip(parameter, self._from, self._to), rate, change

    def _sample(self, times: Floats) -> Samples:
        parameter, rate, change = self.parameters(times)
        q, omega, alpha = self._curve.evaluate(np.minimum(parameter, self._last))
        rates = rate[:, None]
        return q, omega * rates, alpha * rates**2 + omega * change[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class _PartClock:
    """The path time of a whole path by that of one of its parts.

    Attributes:
        part: of the curve.
        rate: seconds of the curve for one of the path.
        times: of the part, from its beginning to its end, between which positions are a quintic.
    """

    part: RestingPart
    rate: float
    times: Floats

    def __call__(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the path time and its first two derivatives."""
        parameter, rate, change = self.part.parameters(times * self.rate)
        return (parameter - self.part.origin) / self.rate, rate, change * self.rate


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
    turns = turns[turns > 0.0]
    velocity, acceleration = limits.velocity, limits.acceleration
    peaks = np.minimum(np.sqrt(turns * acceleration), velocity)
    # Where neither is limited their quotient is not a number.
    rises = np.fmin(np.sqrt(turns / acceleration), velocity / acceleration)
    return float(np.sum(turns / peaks + rises))


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
    curve, rate = keyframe_path.segment.curve, keyframe_path.segment.rate
    begin, end = curve.domain
    edges = [begin, *corners(curve).tolist(), end]
    if len(edges) == 2 and keyframe_path.is_from_rest_to_rest:
        return quickest(keyframe_path, limits, period, share=share, guess=guess)
    parameters = begin + keyframe_path.times * rate
    times, duration = np.zeros(len(parameters)), 0.0
    positions = PositionPath.held(keyframe_path.positions.first)
    segments: list[PathSegment] = []
    for first, last in pairwise(edges):
        at_first, at_last = (_moves(keyframe_path, (at - begin) / rate) for at in (first, last))
        part = RestingPart(curve, first, last, moves=(at_first, at_last))
        path = KeyframePath(
            PathSegment(part, 0.0, part.domain[1] / rate, rate),
            _positions_of(keyframe_path, part, rate),
            part.places(parameters) / rate,
        )
        quick = quickest(path, limits, period, share=share)
        segments.append(quick.segment.shifted(duration))
        positions = quick.positions.delayed(duration).after(positions)
        times += np.clip(quick.times, 0.0, quick.duration)
        duration += quick.duration
    if len(segments) == 1:
        return quick
    whole = PathCurve(Path.joined(segments, positions).segments)
    return KeyframePath(PathSegment(whole, 0.0, duration), positions, times)


def _moves(keyframe_path: KeyframePath, time: float) -> bool:
    """Return whether the position moves at a path time."""
    return bool(np.any(keyframe_path.positions.state(time)[1]))


def _positions_of(keyframe_path: KeyframePath, part: RestingPart, rate: float) -> PositionPath:
    """Return what the position does during a part of a path, on the clock of that part."""
    positions = keyframe_path.positions
    if positions.is_held:
        return positions
    end = part.domain[1]
    knots = part.places(part.origin + positions.breaks * rate)
    fine = np.linspace(0.0, end, _PIECES + 1)
    nodes = np.unique(np.concatenate([knots, part.knots, fine]))
    nodes = nodes[np.append(np.diff(nodes) > _APART * end, True)]
    nodes[0] = 0.0
    clock = _PartClock(part, rate, nodes / rate)
    first, last = positions.sample(clock(clock.times[[0, -1]])[0])[0]
    return replace(repositioned(positions, clock), first=first, last=last)
