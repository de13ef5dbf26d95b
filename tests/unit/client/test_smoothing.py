"""Noisy poses of a chunk are smoothed, and none is moved farther than the tolerance."""

import numpy as np
import pytest

from orientd import rotation
from orientd.client.smoothing import smoothed_orientations, smoothed_positions

TIMES = np.arange(30) / 30.0
AXIS = np.array([0.36, -0.48, 0.8])


def noisy(size, seed=1):
    rng = np.random.default_rng(seed)
    q = rotation.exp(np.outer(np.sin(3.0 * TIMES), AXIS))
    return rotation.multiply(q, rotation.exp(rng.normal(0.0, size, (len(TIMES), 3)))), q


@pytest.mark.parametrize("tolerance", [1e-4, 1e-3, 1e-2, 1.0])
def test_no_pose_is_moved_farther_than_the_tolerance(tolerance):
    q, _ = noisy(1e-3)
    moved = rotation.angle(smoothed_orientations(TIMES, q, tolerance), q)
    assert moved.max() <= tolerance * (1.0 + 1e-9)
    positions = np.random.default_rng(2).normal(0.0, 0.01, (30, 3))
    moved = np.linalg.norm(smoothed_positions(TIMES, positions, tolerance) - positions, axis=1)
    assert moved.max() <= tolerance * (1.0 + 1e-9)


def test_smoothed_poses_are_nearer_to_the_motion():
    q, true = noisy(1e-3)
    before, after = (
        np.mean(rotation.angle(one, true) ** 2)
        for one in (q, smoothed_orientations(TIMES, q, 3e-3))
    )
    assert after < 0.5 * before


def test_straight_motion_and_short_chunks_stay_as_they_are():
    straight = np.outer(TIMES, [0.1, 0.2, 0.3])
    assert np.abs(smoothed_positions(TIMES, straight, 1e-3) - straight).max() < 1e-9
    for count in (0, 1, 2):
        q, _ = noisy(1e-3)
        few = smoothed_orientations(TIMES[:count], q[:count], 1e-3)
        assert np.array_equal(few, q[:count])
