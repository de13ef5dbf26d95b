"""The curve through a chunk: it meets its poses, is smooth, and is near what the poses sample."""

import random
from itertools import pairwise
from math import cos, pi, sin

import pytest
from tracking_world import NS, angle

from orientd.driver import ZERO
from orientd.floats import combine, difference, exp, multiply, norm, normalize, plus
from orientd.servo.tracking.chunks import knots_of
from orientd.servo.tracking.quintic import Knot, Piece, quintic
from orientd.stream.records import Sample


def tumble(t):
    swing = exp((sin(pi * t), 0.0, 0.0))
    return multiply(swing, exp((0.0, 0.4 * cos(4.4 * t), 0.6 * sin(1.9 * t))))


def spin(t, d=1e-4):
    return plus(ZERO, difference(tumble(t - d), tumble(t + d)), 0.5 / d)


def samples(times, *, is_given=False):
    return [Sample(round(t * NS), tumble(t), spin(t) if is_given else None) for t in times]


def on(knots, time_ns):
    here, there = next(pair for pair in pairwise(knots) if time_ns <= pair[1].time_ns)
    return Piece(here, there).at(time_ns)[0]


@pytest.mark.parametrize("is_given", [False, True])
@pytest.mark.parametrize("seed", [None, 1, 2])
def test_it_is_near_the_motion_that_the_poses_sample(seed, is_given):
    rng = random.Random(seed)
    times = [(k + (rng.uniform(-0.3, 0.3) if seed else 0.0)) / 30 for k in range(40)]
    knots = knots_of(samples(times, is_given=is_given))
    for k in range(200, 1100):
        assert angle(on(knots, k * NS // 1000), tumble(k / 1000)) < 5e-5
    for knot in knots[5:-5]:
        assert norm(plus(knot.omega, spin(knot.time_ns / NS), -1.0)) < 5e-3


def test_positions_are_met_with_continuous_acceleration():
    times = [0.0, 0.1, 0.15, 0.4, 0.5, 0.7]
    places = [(sin(3.0 * t), t, t * t) for t in times]
    knots = knots_of(
        [Sample(round(t * NS), tumble(t), None, p) for t, p in zip(times, places, strict=True)]
    )
    for before, here, after in zip(knots, knots[1:], knots[2:], strict=False):
        first, second = Piece(before, here), Piece(here, after)
        assert plus(before.position, first.way.value(1.0), 1.0) == pytest.approx(here.position)
        arriving = plus(ZERO, first.way.derivatives(1.0)[1], first.span**-2)
        leaving = plus(ZERO, second.way.derivatives(0.0)[1], second.span**-2)
        assert arriving == pytest.approx(leaving, abs=1e-9)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("size", [0.01, 0.24, 0.26, 1.0, 2.5])
def test_a_piece_has_velocity_and_acceleration_of_both_its_knots(seed, size):
    rng = random.Random(seed)

    def vector(length):
        return tuple(rng.gauss(0.0, length) for _ in range(3))

    axis = vector(1.0)
    q = normalize((rng.gauss(0.0, 1.0), *vector(1.0)))
    here = Knot(0, q, vector(2.0), vector(5.0))
    there = multiply(q, exp(plus(ZERO, axis, size / norm(axis))))
    piece = Piece(here, Knot(NS // 2, there, vector(2.0), vector(5.0)))
    for knot, way in ((here, 1), (piece.there, -1)):
        # Differences to one side, carried back to the knot.
        step = 100_000
        qs = [piece.at(knot.time_ns + way * k * step)[0] for k in range(4)]
        h = way * step / NS
        omegas = [plus(ZERO, difference(a, b), 1.0 / h) for a, b in pairwise(qs)]
        alphas = [combine(b, 1.0 / h, a, -1.0 / h) for a, b in pairwise(omegas)]
        omega = plus(omegas[0], alphas[0], -0.5 * h)
        alpha = combine(alphas[0], 2.0, alphas[1], -1.0)
        assert norm(plus(omega, knot.omega, -1.0)) < 1e-5
        assert norm(plus(alpha, knot.alpha, -1.0)) < 2e-3


def test_a_quintic_meets_its_ends_and_has_three_derivatives():
    rng = random.Random(7)
    way, leave, bend, arrive, settle = (
        (rng.gauss(0.0, 1.0), rng.gauss(0.0, 1.0), rng.gauss(0.0, 1.0)) for _ in range(5)
    )
    found = quintic(way, leave, bend, arrive, settle)
    assert found.value(0.0) == ZERO
    assert found.derivatives(0.0)[:2] == (leave, pytest.approx(bend))
    assert found.value(1.0) == pytest.approx(way)
    assert found.derivatives(1.0)[:2] == (pytest.approx(arrive), pytest.approx(settle))
    lower = (found.value, *(lambda u, k=k: found.derivatives(u)[k] for k in range(2)))
    for order, function in enumerate(lower):
        slope = combine(function(0.3 + 1e-5), 5e4, function(0.3 - 1e-5), -5e4)
        assert found.derivatives(0.3)[order] == pytest.approx(slope, rel=1e-6, abs=1e-6)
