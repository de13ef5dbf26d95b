"""The curve through the poses of a chunk: a cubic spline, as knots.

Between two poses the rotation vector is a cubic.  Its second derivative is continuous at the poses,
which gives one tridiagonal system for all of them.  The increments of each pose are in its own
frame.  The increments are the short way round, so neither the sign of a quaternion nor the choice
of a rotation vector matters.  At both ends the second derivative stays as it is at the neighbour.

If the sender gives velocities, they count.  The second derivative is then the mean of those of the
cubics on either side.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from orientd.driver import ZERO, Vector3
from orientd.floats import combine, cross, difference, normalize, plus
from orientd.servo.tracking.quintic import Knot
from orientd.stream import Sample


def knots_of(samples: Sequence[Sample]) -> list[Knot]:
    """Return the curve through *samples*, at least one, whose times ascend.

    A chunk without positions has them zero.
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
