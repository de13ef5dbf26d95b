"""Noise of the poses is acceleration of the device, unless a tolerance smooths them."""

import random
from math import pi, sin

import numpy as np
import pytest
from chunk_world import ChunkWorld
from tracking_world import NS, angle, servo_limits

from orientd.client.smoothing import smoothed_orientations
from orientd.floats import exp, multiply, norm

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
