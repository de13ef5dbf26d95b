"""A whole pass from compass angles: directions, end velocities, and what is refused."""

import numpy as np
import pytest

import orientd
from orientd.errors import RequestError
from orientd.rotation import rotate
from orientd_rotctld import satellite_pass


def sky(times, tilt=0.3, rate=0.015):
    """A target on a great circle: its directions, north, west and up."""
    turn = rate * (times - times[len(times) // 2])
    across = np.array([0.0, -np.sin(tilt), np.cos(tilt)])
    return np.outer(np.sin(turn), [1.0, 0.0, 0.0]) + np.outer(np.cos(turn), across)


def angles(directions):
    north, west, up = directions.T
    return np.degrees(np.arctan2(-west, north)), np.degrees(np.arcsin(up))


def test_a_pass_points_at_the_target_by_the_compass():
    request = satellite_pass([0, 1, 2], [0, 90, 180], [0, 0, 30])
    pointed = rotate(request.keys, [1.0, 0.0, 0.0])
    half = np.sqrt(0.75)
    np.testing.assert_allclose(pointed, [[1, 0, 0], [0, -1, 0], [-half, 0, 0.5]], atol=1e-15)


def test_a_pass_begins_and_ends_with_the_rate_of_the_target():
    times = np.arange(0.0, 61.0)
    directions = sky(times)
    request = satellite_pass(times, *angles(directions))
    omega = np.cross(directions[0], directions[1]) / np.sin(0.015) * 0.015
    np.testing.assert_allclose(request.start_velocity, omega, atol=2e-6)
    np.testing.assert_allclose(request.end_velocity, omega, atol=2e-6)


def test_a_planned_pass_follows_the_target_between_its_seconds():
    times = np.arange(0.0, 61.0)
    motion = orientd.plan(satellite_pass(times, *angles(sky(times))))
    fine = np.linspace(0.0, 60.0, 1201)
    pointed = rotate(motion.sample(motion.start_time + fine).q, [1.0, 0.0, 0.0])
    np.testing.assert_allclose(pointed, sky(fine), atol=1e-5)


@pytest.mark.parametrize(
    ("columns", "complaint"),
    [
        (([0, 1], [0, 1], [0, 1]), "times: expected 2 entries.* at least 3, got 2"),
        (([0, 1, 2], [0, 1], [0, 1, 2]), "azimuth: expected 3 entries.*, got 2"),
        (([0, 1, 2], [0, 1, 2], [0, 1, "x"]), "elevation: expected numbers"),
        (([0, 1, 2], [0, 1, 2], [0, 1, np.nan]), "elevation: expected finite numbers"),
        (
            ([0, 1, 2], [0, 24435, 2], [0, 1, 2]),
            r"azimuth\[1\]: expected -720 to 720 degrees, got 24435; check the decimal point",
        ),
        (
            ([0, 1, 2], [0, 1, 2], [0, 1, -2443.5]),
            r"elevation\[2\]: expected -90 to 180 degrees, got -2443.5; check the decimal point",
        ),
        (([0, 2, 2], [0, 1, 2], [0, 1, 2]), r"keyframes\[2\].time: 2 s is the time of"),
    ],
)
def test_a_malformed_pass_is_refused_by_its_column(columns, complaint):
    with pytest.raises(RequestError, match=f"^{complaint}"):
        satellite_pass(*columns)
