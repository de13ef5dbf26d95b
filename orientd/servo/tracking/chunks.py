"""Chunks of poses, and their ring: a chunk is one record, so the servo never sees a part of one."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import isfinite
from typing import Any, NamedTuple, cast

from orientd.driver import ZERO, Vector3
from orientd.floats import combine, cross, difference, norm, normalize, plus
from orientd.servo.tracking.quintic import Knot, Piece
from orientd.stream.records import CHUNK_POSES, KNOT_FLOATS, Sample, ServoLimits
from orientd.stream.ring import RecordRing
from orientd.tolerances import NORM_TOLERANCE

NOISE, PLACE_NOISE = 0.25, 0.05
"""How far a pose may be off a curve that smooths noise, rad and m."""

_APART_NS = 100_000
"""Time on either side of an instant for a difference: less than between two poses."""

_UNIT = 2.0 * NORM_TOLERANCE
"""How far the square of a quaternion's norm may be from 1."""

_FEWEST = 3
"""Poses that are not thinned out further."""


class Chunk(NamedTuple):
    """A chunk as the servo takes it.

    Attributes:
        knots: the curve through its poses.
        has_positions: whether it says where to be.
        observed_ns: time of the observation that it answers; 0 if it names none.
    """

    knots: Sequence[Knot]
    has_positions: bool
    observed_ns: int = 0


class Smoothed(NamedTuple):
    """A curve near poses.

    Attributes:
        knots: the curve.
        turn: largest angle from a pose to it, rad; 0 if it is the curve through the poses.
        shift: largest distance from the position of a pose to it, m.
    """

    knots: list[Knot]
    turn: float = 0.0
    shift: float = 0.0


def publish_chunk(
    ring: RecordRing, samples: Sequence[Sample], limits: ServoLimits, observed_ns: int = 0
) -> Smoothed:
    """Write a chunk of 1 to :data:`.CHUNK_POSES` samples, whose times ascend; return its curve.

    Noise that would break *limits* is smoothed; see :func:`smoothed`.
    """
    curve = smoothed(samples, limits)
    knots = curve.knots
    spare = CHUNK_POSES - len(knots)
    times = [knot.time_ns for knot in knots] + [0] * spare
    floats = [number for knot in knots for part in knot[1:] for number in cast(Vector3, part)]
    floats += [0.0] * (spare * KNOT_FLOATS)
    ring.publish(observed_ns, len(knots), samples[0].position is not None, *times, *floats)
    return curve


def read_chunk(fields: Sequence[Any]) -> Chunk | None:
    """Return the chunk of a record; ``None`` if it makes no sense."""
    _, observed_ns, count, has_positions, *numbers = fields
    times, floats = numbers[:count], numbers[CHUNK_POSES : CHUNK_POSES + count * KNOT_FLOATS]
    if not 1 <= count <= CHUNK_POSES or not isfinite(sum(floats)):
        return None
    if any(a >= b for a, b in pairwise(times)):
        return None
    columns = [floats[place::KNOT_FLOATS] for place in range(KNOT_FLOATS)]
    qs = list(zip(*columns[:4], strict=True))
    if any(not abs(w * w + x * x + y * y + z * z - 1.0) <= _UNIT for w, x, y, z in qs):
        return None
    vectors = [zip(*columns[place : place + 3], strict=True) for place in range(4, KNOT_FLOATS, 3)]
    knots = list(map(Knot, times, qs, *vectors))
    return Chunk(knots, has_positions, observed_ns)


def knots_of(samples: Sequence[Sample]) -> list[Knot]:
    """Return the curve through *samples*, at least one, whose times ascend: a cubic spline.

    Between two poses the rotation vector is a cubic.  Its second derivative is continuous at the
    poses, which gives one tridiagonal system for all of them.  The increments of each pose are in
    its own frame.  They are the short way round, so neither the sign of a quaternion nor the choice
    of a rotation vector matters.  At both ends the second derivative stays as it is at the
    neighbour.

    If the sender gives velocities, they count.  The second derivative is then the mean of those of
    the cubics on either side.  A chunk without positions has them zero.
    """
    times = [one.time_ns for one in samples]
    spans = [(b - a) * 1e-9 for a, b in pairwise(times)]
    qs = [normalize(one.q) for one in samples]
    turns = [difference(a, b) for a, b in pairwise(qs)]
    given = [one.omega for one in samples if one.omega is not None]
    if len(given) == len(samples):
        omegas, alphas = given, _bends(turns, spans, given)
    else:
        omegas, alphas = _rates(turns, spans)
    places = [one.position or ZERO for one in samples]
    ways = [plus(b, a, -1.0) for a, b in pairwise(places)]
    velocities, accelerations = _rates(ways, spans, is_turning=False)
    return [
        Knot(*fields)
        for fields in zip(times, qs, omegas, alphas, places, velocities, accelerations, strict=True)
    ]


def smoothed(samples: Sequence[Sample], limits: ServoLimits) -> Smoothed:
    """Return the curve through samples, or one near them if that curve would break limits.

    The closer poses are in time, the more acceleration their noise takes.  So the curve is made
    through every second pose, every fourth and so on until it keeps the limits, and read at the
    times of all of them.  The velocities that the sender gives count for the poses that it is made
    through; the others get those of the curve.  If a pose would be farther from it than
    :data:`NOISE` or :data:`PLACE_NOISE`, the poses are no noise: their own curve stays, and the
    limits cut it off.
    """
    whole, kept = knots_of(samples), samples
    knots = whole
    while len(kept) > _FEWEST and not _keep(knots, limits):
        kept = [*kept[:-1:2], kept[-1]]
        knots = knots_of(kept)
    if knots is whole or not _keep(knots, limits):
        return Smoothed(whole)
    pieces = [Piece(*pair) for pair in pairwise(knots)]
    begins = [piece.here.time_ns for piece in pieces]
    given = {one.time_ns: one.omega for one in kept}
    found, turn, shift = [], 0.0, 0.0
    for one in samples:
        time_ns, omega = one.time_ns, one.omega
        piece = pieces[max(bisect_right(begins, time_ns) - 1, 0)]
        q, position = piece.at(time_ns)
        turn = max(turn, norm(difference(q, one.q)))
        if one.position is not None:
            shift = max(shift, norm(plus(position, one.position, -1.0)))
        if turn > NOISE or shift > PLACE_NOISE:
            return Smoothed(whole)
        if omega is not None:
            omega = given.get(time_ns) or _rate_on(piece, time_ns)
        found.append(Sample(time_ns, q, omega, None if one.position is None else position))
    return Smoothed(knots_of(found), turn, shift)


def _rate_on(piece: Piece, time_ns: int) -> Vector3:
    """Return the angular velocity of a piece at an instant inside, rad/s: a difference."""
    here, there = piece.at(time_ns - _APART_NS)[0], piece.at(time_ns + _APART_NS)[0]
    return plus(ZERO, difference(here, there), 0.5e9 / _APART_NS)


def _keep(knots: Sequence[Knot], limits: ServoLimits) -> bool:
    """Return whether a curve keeps limits of velocity and acceleration at its knots."""
    parts = (*limits.axis_velocity, *limits.axis_acceleration)
    return all(
        norm(one.omega) <= limits.velocity
        and norm(one.alpha) <= limits.acceleration
        and norm(one.velocity) <= limits.linear_velocity
        and norm(one.acceleration) <= limits.linear_acceleration
        and all(
            abs(part) <= most for part, most in zip((*one.omega, *one.alpha), parts, strict=True)
        )
        for one in knots
    )


def _rates(
    ways: Sequence[Vector3], spans: Sequence[float], *, is_turning: bool = True
) -> tuple[list[Vector3], list[Vector3]]:
    """Return velocities and accelerations of the spline at its knots.

    Args:
        ways: from each knot to the next.
        spans: the times they take, s.
        is_turning: whether the ways are rotation vectors, each in the frame of both its knots.
    """
    means = [plus(ZERO, way, 1.0 / span) for way, span in zip(ways, spans, strict=True)]
    if len(means) < 2:
        return (means[:1] or [ZERO]) * (len(ways) + 1), [ZERO] * (len(ways) + 1)
    bends = _inner_bends(means, spans)
    bends = [bends[0], *bends, bends[-1]]
    velocities = []
    for mean, span, bend, following in zip(means, spans, bends, bends[1:], strict=False):
        if is_turning:  # as the frame of this knot sees it
            following = plus(following, cross(mean, following), 0.5 * span)
        velocities.append(plus(mean, combine(bend, 2.0, following, 1.0), -span / 6.0))
    # The two last second derivatives are the same.
    velocities.append(plus(means[-1], bends[-1], 0.5 * spans[-1]))
    return velocities, bends


def _inner_bends(means: Sequence[Vector3], spans: Sequence[float]) -> list[Vector3]:
    """Return the second derivatives at the inner knots: Thomas' algorithm."""
    ratios, parts = [0.0], [ZERO]
    last = len(means) - 1
    for k in range(1, len(means)):
        before, after = spans[k - 1], spans[k]
        # The unknowns at both ends equal their neighbours: their coefficients join the diagonal.
        edge = (before if k == 1 else 0.0) + (after if k == last else 0.0)
        pivot = 2.0 * (before + after) + edge - (before if k > 1 else 0.0) * ratios[-1]
        rise = plus(means[k], means[k - 1], -1.0)
        parts.append(combine(rise, 6.0 / pivot, parts[-1], -before / pivot))
        ratios.append(after / pivot)
    found = [parts[-1]]
    for k in range(len(means) - 2, 0, -1):
        found.append(plus(parts[k], found[-1], -ratios[k]))
    found.reverse()
    return found


def _bends(
    turns: Sequence[Vector3], spans: Sequence[float], omegas: Sequence[Vector3]
) -> list[Vector3]:
    """Return the angular accelerations of the cubics through knots of given velocity."""
    sums, counts = [ZERO] * len(omegas), [0] * len(omegas)
    for k, (turn, span) in enumerate(zip(turns, spans, strict=True)):
        here, there = omegas[k], omegas[k + 1]
        seen = plus(there, cross(turn, there), 0.5)
        leave = combine(combine(here, 4.0, seen, 2.0), -1.0 / span, turn, 6.0 / span / span)
        seen = plus(here, cross(turn, here), -0.5)
        arrive = combine(combine(there, 4.0, seen, 2.0), 1.0 / span, turn, -6.0 / span / span)
        sums[k], counts[k] = plus(sums[k], leave, 1.0), counts[k] + 1
        sums[k + 1], counts[k + 1] = plus(sums[k + 1], arrive, 1.0), counts[k + 1] + 1
    return [plus(ZERO, one, 1.0 / max(n, 1)) for one, n in zip(sums, counts, strict=True)]
