"""Noise of the poses is acceleration of the device, unless a tolerance smooths them."""

import random
from dataclasses import replace
from math import cos, pi, sin

import numpy as np
import pytest
from chunk_world import ChunkWorld
from tracking_world import NS, angle, servo_limits

from orientd.client.smoothing import smoothed_orientations
from orientd.floats import exp, multiply, norm, plus
from orientd.servo.tracking.chunks import knots_of, smoothed
from orientd.stream.records import Sample

LIMITS = servo_limits(3.75, 25.0, 8500.0)
NOISE = 1e-3


def swing(t):
    return exp((0.36 * sin(pi * t), -0.48 * sin(pi * t), 0.8 * sin(pi * t)))


def play(tolerance, seed):
    """Return largest error (rad) and peak acceleration over that of the swing."""
    rng, world = random.Random(seed), ChunkWorld(LIMITS, 250)
    error = peak = 0.0
    for _ in range(30):
        samples = [
            (stamp, multiply(q, exp(tuple(rng.gauss(0.0, NOISE) for _ in range(3)))))
            for stamp, q in world.poses(world.now_ns - round(0.15 * NS), 16, 30, swing)
        ]
        if tolerance:
            times = np.array([stamp - samples[0][0] for stamp, _ in samples]) / NS
            q = smoothed_orientations(times, np.array([q for _, q in samples]), tolerance)
            samples = [(one[0], tuple(row)) for one, row in zip(samples, q.tolist(), strict=True)]
        world.chunk(samples)
        for _ in range(38):
            point = world.step()
            if world.now > 3.0:
                error = max(error, angle(point.q, swing(world.now - 1.0)))
                peak = max(peak, norm(point.alpha_body))
    return error, peak / pi**2


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_tolerance_of_three_times_the_noise_hides_it(seed):
    rough, smooth = play(0.0, seed), play(3.0 * NOISE, seed)
    assert rough[1] > 1.5
    assert smooth[1] < 1.2
    assert smooth[0] < min(rough[0], 3e-3)


@pytest.mark.parametrize(("hz", "noise"), [(50, 2e-3), (50, 1e-2), (30, 1e-2), (20, 1e-2)])
def test_noise_that_would_break_the_limits_is_smoothed(hz, noise):
    rng, world, error = random.Random(1), ChunkWorld(servo_limits(2.5, 17.0, 8500.0), 500), 0.0
    for _ in range(6):
        world.chunk(
            (stamp, multiply(q, exp(tuple(rng.gauss(0.0, noise) for _ in range(3)))))
            for stamp, q in world.poses(
                world.now_ns + NS // 50, 2 * hz, hz, lambda t: swing(0.3 * t)
            )
        )
        for _ in range(500):
            point = world.step()
            if world.now > 3.0:
                error = max(error, angle(point.q, swing(0.3 * (world.now - 1.0))))
    assert error < 5.0 * noise


def test_poses_that_are_no_noise_are_not_smoothed():
    stamps = [NS + k * NS // 30 for k in range(30)]
    jump = [Sample(stamp, swing(0.0) if k < 15 else swing(0.5)) for k, stamp in enumerate(stamps)]
    assert smoothed(jump, LIMITS) == (knots_of(jump), 0.0, 0.0)


def test_poses_within_the_limits_stay_as_they_are():
    calm = [Sample(NS + k * NS // 30, swing(k / 30)) for k in range(30)]
    assert smoothed(calm, LIMITS) == (knots_of(calm), 0.0, 0.0)


def test_a_smoothed_curve_has_the_given_velocities_at_the_poses_that_it_passes():
    rng, samples = random.Random(1), []
    for k in range(100):
        noise = exp(tuple(rng.gauss(0.0, 1e-2) for _ in range(3)))
        omega = (0.3 * pi * cos(0.3 * pi * k / 50) * x for x in (0.36, -0.48, 0.8))
        q = multiply(swing(0.3 * k / 50), noise)
        samples.append(Sample(NS + k * NS // 50, q, tuple(omega)))
    knots, turn, _ = smoothed(samples, servo_limits(2.5, 17.0, 8500.0))
    assert 5e-3 < turn < 0.25
    passed = [
        norm(plus(one.omega, sample.omega, -1.0))
        for one, sample in zip(knots, samples, strict=True)
        if angle(one.q, sample.q) < 1e-12
    ]
    assert len(passed) > 2
    assert max(passed) == 0.0


def test_a_position_is_smoothed_with_its_pose():
    rng = random.Random(3)
    limits = replace(LIMITS, linear_velocity=1.0, linear_acceleration=3.0)
    wanted = [(0.2 * sin(k / 20), 0.0, 0.1) for k in range(60)]
    samples = [
        Sample(NS + k * NS // 50, swing(0.0), None, plus(at, (rng.gauss(0.0, 1e-3), 0.0, 0.0), 1.0))
        for k, at in enumerate(wanted)
    ]
    knots, turn, shift = smoothed(samples, limits)
    assert max(norm(one.acceleration) for one in knots_of(samples)) > 5.0
    assert max(norm(one.acceleration) for one in knots) < 3.1
    assert (
        max(norm(plus(one.position, at, -1.0)) for one, at in zip(knots, wanted, strict=True))
        < 5e-3
    )
    apart = zip(knots, samples, strict=True)
    assert shift == max(norm(plus(one.position, at.position, -1.0)) for one, at in apart)
    assert (turn, 1e-3 < shift < 5e-3) == (0.0, True)
