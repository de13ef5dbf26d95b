"""The ring of chunks: a chunk is one record, so that the servo never sees a part of one.

The words of the ring tell how the servo follows them.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from orientd.driver import ZERO, Vector3
from orientd.floats import combine, cross, difference, norm, normalize, plus
from orientd.servo.tracking.quintic import Knot, Piece
from orientd.stream.records import CHUNK_POSES, KNOT_FLOATS, Sample, ServoLimits
from orientd.stream.ring import RecordRing
from orientd.tolerances import NORM_TOLERANCE

if TYPE_CHECKING:
    from orientd.servo.tracking.preview import Preview

LIVE_WORD, STALE_WORD, STARVED_WORD, SEAM_WORD, BEHIND_WORD, FARTHEST_WORD = range(1, 7)
LEFT_WORD, LAG_WORD = 7, 8
PLACE_BEHIND_WORD, PLACE_FARTHEST_WORD, PLACE_LAG_WORD = 9, 10, 11
"""Words of the ring; angles in nanoradians, distances in nanometres, times in nanoseconds."""

NOISE, PLACE_NOISE = 0.25, 0.05
"""How far a pose may be off a curve that smooths noise, rad and m."""

_FEWEST = 3
"""Poses that are not thinned out further."""

_ZERO_LEFT = 1 << 63
"""No time left of a chunk, in the word for that, which has no sign; 0 if it is not known."""


class ChunkReport(NamedTuple):
    """How chunks have been followed since the following began.

    Attributes:
        live: poses of the newest chunk that were still to come when the servo took it.
        stale: poses of all chunks that were not, so far.
        starved: how many chunks came after the poses had run out, with poses to come or without.
        seam: largest angle by which a chunk contradicted the one before, rad.
        behind: angle from the last setpoint to the poses, rad: the limits cut it off.
        farthest: the largest that it has been, rad.
        lag: delay behind the poses that fits the last second best, s.
        least_left: least time that was left of a chunk when the next one came, s; negative if the
            poses had run out, ``None`` before the second one.
        position_behind: distance from the last setpoint to the position of the poses, m.
        position_farthest: the largest that it has been, m.
        position_lag: delay of the position that fits the last second best, s.
    """

    live: int
    stale: int
    starved: int
    seam: float
    behind: float
    farthest: float
    lag: float
    least_left: float | None
    position_behind: float
    position_farthest: float
    position_lag: float


class Chunk(NamedTuple):
    """A chunk as the servo takes it.

    Attributes:
        knots: the curve through its poses.
        has_positions: whether it says where to be.
    """

    knots: Sequence[Knot]
    has_positions: bool


def publish_chunk(ring: RecordRing, samples: Sequence[Sample], limits: ServoLimits) -> None:
    """Write a chunk of 1 to :data:`.CHUNK_POSES` samples, whose times ascend.

    Noise that would break *limits* is smoothed; see :func:`smoothed`.
    """
    knots = smoothed(samples, limits)
    spare = CHUNK_POSES - len(knots)
    times = [knot.time_ns for knot in knots] + [0] * spare
    floats = [number for knot in knots for part in knot[1:] for number in cast(Vector3, part)]
    floats += [0.0] * (spare * KNOT_FLOATS)
    ring.publish(len(knots), samples[0].position is not None, *times, *floats)


def read_chunk(fields: Sequence[Any]) -> Chunk | None:
    """Return the chunk of a record; ``None`` if it makes no sense."""
    _, count, has_positions, *numbers = fields
    times, floats = numbers[:count], numbers[CHUNK_POSES : CHUNK_POSES + count * KNOT_FLOATS]
    if not 1 <= count <= CHUNK_POSES or not isfinite(sum(map(abs, floats))):
        return None
    knots = []
    for k, time_ns in enumerate(times):
        w, x, y, z, *rates = floats[k * KNOT_FLOATS : (k + 1) * KNOT_FLOATS]
        if not abs(w * w + x * x + y * y + z * z - 1.0) <= 2.0 * NORM_TOLERANCE:
            return None
        vectors = [cast(Vector3, tuple(rates[place : place + 3])) for place in range(0, 15, 3)]
        knots.append(Knot(time_ns, (w, x, y, z), *vectors))
    if any(a >= b for a, b in pairwise(times)):
        return None
    return Chunk(knots, has_positions)


def read_report(ring: RecordRing) -> ChunkReport:
    """Return how chunks have been followed."""
    words = ring.words
    live, stale, starved, seam, behind, farthest, left, lag = words[LIVE_WORD : LAG_WORD + 1]
    least_left = 1e-9 * (left - _ZERO_LEFT) if left else None
    angles = 1e-9 * seam, 1e-9 * behind, 1e-9 * farthest
    of_place = (1e-9 * word for word in words[PLACE_BEHIND_WORD : PLACE_LAG_WORD + 1])
    return ChunkReport(live, stale, starved, *angles, 1e-9 * lag, least_left, *of_place)


def write_report(ring: RecordRing, preview: Preview) -> None:
    """Write how a chunk was taken."""
    words, left_ns = ring.words, preview.least_left_ns
    words[LIVE_WORD], words[STALE_WORD] = preview.live, preview.stale
    words[STARVED_WORD], words[SEAM_WORD] = preview.starved, round(1e9 * preview.seam)
    words[LEFT_WORD] = 0 if left_ns is None else _ZERO_LEFT + left_ns


def write_distance(ring: RecordRing, behind: float, lag: float) -> None:
    """Write how far the setpoints are behind the poses: an angle, rad, and a delay, s."""
    _write_distance(ring, BEHIND_WORD, behind, lag_word=LAG_WORD, lag=lag)


def write_position_distance(ring: RecordRing, behind: float, lag: float) -> None:
    """Write how far the setpoints are behind the position of the poses: m, and a delay, s."""
    _write_distance(ring, PLACE_BEHIND_WORD, behind, lag_word=PLACE_LAG_WORD, lag=lag)


def _write_distance(
    ring: RecordRing, word: int, behind: float, *, lag_word: int, lag: float
) -> None:
    """Write a distance, the largest so far into the next *word*, and a delay."""
    ring.words[word] = size = round(1e9 * behind)
    ring.words[word + 1] = max(ring.words[word + 1], size)
    ring.words[lag_word] = round(1e9 * lag)


def clear_report(ring: RecordRing) -> None:
    """Begin again."""
    for word in range(LIVE_WORD, PLACE_LAG_WORD + 1):
        ring.words[word] = 0


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


def smoothed(samples: Sequence[Sample], limits: ServoLimits) -> list[Knot]:
    """Return the curve through samples, or one near them if that curve would break limits.

    The closer poses are in time, the more acceleration their noise takes.  So the curve is made
    through every second pose, every fourth and so on until it keeps the limits, and read at the
    times of all of them.  If a pose would be farther from it than :data:`NOISE` or
    :data:`PLACE_NOISE`, the poses are no noise: their own curve stays, and the limits cut it off.
    """
    whole, kept = knots_of(samples), samples
    knots = whole
    while len(kept) > _FEWEST and not _keep(knots, limits):
        kept = [*kept[:-1:2], kept[-1]]
        knots = knots_of(kept)
    if knots is whole or not _keep(knots, limits):
        return whole
    pieces = [Piece(*pair) for pair in pairwise(knots)]
    begins = [piece.here.time_ns for piece in pieces]
    found = []
    for one in samples:
        piece = pieces[max(bisect_right(begins, one.time_ns) - 1, 0)]
        q, position = piece.at(one.time_ns)
        is_placed = one.position is not None
        if norm(difference(q, one.q)) > NOISE or (
            is_placed and norm(plus(position, one.position or ZERO, -1.0)) > PLACE_NOISE
        ):
            return whole
        found.append(Sample(one.time_ns, q, None, position if is_placed else None))
    return knots_of(found)


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
