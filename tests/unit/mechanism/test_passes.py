"""Paths with times on a gimbal that may leave them: which turn, which branch, what is lost."""

import numpy as np
import pytest
from gimbals import gimbal_of, orientations

from orientd.driver import AxisLimits
from orientd.errors import LimitError
from orientd.mechanism.joint_path import ToolLimits
from orientd.mechanism.pointing import pointing_error
from orientd.mechanism.timed_route import route_at_times
from orientd.rotation import exp, from_axis_angle, multiply

PERIOD = 0.02
RATE, SPEED, FORCE = 0.6, 6.0, 60.0
DOWN = (0.0, 1.0, 0.0, 0.0)
HALF_DEGREE = np.radians(0.5)


def rotator(azimuth, elevation=(0.0, 90.0), **options):
    """A rotator whose axes read as the compass does: degrees in, radians inside."""
    axes = [
        AxisLimits(name, *np.radians([*ends, SPEED, FORCE]).tolist())
        for name, ends in (("azimuth", azimuth), ("elevation", elevation))
    ]
    return gimbal_of("ZY", axes=axes, mount=DOWN, is_pointing=True, allow_slews=True, **options)


def overhead(miss_deg, heading_deg, half=120.0):
    """A pass that misses the zenith, its highest point a quarter turn right of its heading."""
    times = np.arange(-half, half + PERIOD / 2, PERIOD)
    turn, miss = np.radians(RATE) * times, np.radians(miss_deg)
    ahead, aside = np.sin(turn), np.sin(miss) * np.cos(turn)
    heading = np.radians(heading_deg)
    azimuth = heading + np.arctan2(aside, ahead)
    elevation = np.arcsin(np.cos(miss) * np.cos(turn))
    return multiply(
        from_axis_angle([0.0, 0.0, 1.0], -azimuth), from_axis_angle([0.0, 1.0, 0.0], -elevation)
    )


def routed(gimbal, q, joints=(0.0, 0.0)):
    # The axes replace the tool's own lead-in.
    held = orientations(gimbal, np.tile(joints, (10, 1)))
    path = np.concatenate([held, q])
    ends = (10 * PERIOD, (len(path) - 1) * PERIOD)
    tool = ToolLimits(1.5, 8.0, 1500.0)
    return route_at_times(gimbal, PERIOD, path, ends, joints=joints, tool=tool)


def lost(path):
    return sum(one.end - one.start for one in path.losses)


def on_its_path(path, count):
    """The joints at the times of the path, without lead-in and rest."""
    first = int(np.searchsorted(path.path_times, 10 * PERIOD - 1e-9))
    return first, path.joints[first : first + count]


@pytest.mark.parametrize("joints", [(0.0, 0.0), (3.0, 1.0)])
def test_axes_keep_their_limits_and_the_times_of_the_path(joints):
    gimbal, q = rotator((0.0, 360.0)), overhead(0.8, 0.0)
    path = routed(gimbal, q, joints)
    assert path.joints[0] == pytest.approx(joints, abs=1e-9)
    for place, axis in enumerate(gimbal.axes):
        angles = path.joints[:, place]
        assert axis.low - 1e-9 <= angles.min() <= angles.max() <= axis.high + 1e-9
        speed = np.diff(angles) / PERIOD
        assert np.max(np.abs(speed)) <= axis.velocity * 1.001
        assert np.max(np.abs(np.diff(speed))) / PERIOD <= axis.acceleration * 1.001
    first, _ = on_its_path(path, len(q))
    steps = np.diff(path.path_times[first : first + len(q)])
    np.testing.assert_allclose(steps, PERIOD, atol=1e-9)


@pytest.mark.parametrize("miss", [0.3, 0.8, 3.0])
def test_losses_are_those_that_the_axes_show(miss):
    gimbal, q = rotator((0.0, 360.0)), overhead(miss, 10.0)
    path = routed(gimbal, q)
    first, joints = on_its_path(path, len(q))
    error = pointing_error(gimbal, orientations(gimbal, joints), q)
    times = (first + np.arange(len(q))) * PERIOD
    is_lost = np.zeros(len(q), dtype=bool)
    for loss in path.losses:
        inside = (times >= loss.start - 1e-9) & (times < loss.end - 1e-9)
        assert np.max(error[inside]) == pytest.approx(loss.error)
        is_lost |= inside
    np.testing.assert_array_equal(error > HALF_DEGREE, is_lost)


def test_a_pass_over_the_zenith_goes_over_the_top_where_the_elevation_allows_it():
    q = overhead(0.8, 10.0)
    flat, over = (routed(rotator((0.0, 360.0), (0.0, high)), q) for high in (90.0, 180.0))
    # The least time of the second is 4.23 s.
    assert lost(flat) > 15.0
    assert lost(over) < 1.05 * 4.23
    assert np.degrees(over.joints[:, 1].max()) > 150.0


def test_a_pass_past_north_begins_on_the_turn_that_lasts():
    q = overhead(30.0, 270.0)
    wide, narrow = (routed(rotator((0.0, high)), q) for high in (450.0, 360.0))
    assert wide.losses == ()
    assert np.degrees(wide.joints[:, 0].max()) > 360.0
    # A whole turn at full speed; the target helps a little.
    assert 0.8 * 360.0 / SPEED < lost(narrow) < 1.02 * 360.0 / SPEED


def test_what_counts_as_lost_is_an_option():
    q = overhead(0.8, 10.0)
    strict, mild = (
        lost(routed(rotator((0.0, 360.0), on_target=np.radians(most)), q)) for most in (0.2, 0.9)
    )
    assert strict > 15.0
    assert mild < 0.9 * strict


def test_an_endless_azimuth_turns_on_from_where_it_is():
    gimbal, q = rotator((-91800.0, 91800.0)), overhead(30.0, 10.0)
    here = (np.radians(7200.0), 0.5)
    path = routed(gimbal, q, here)
    assert path.losses == ()
    assert np.max(np.abs(path.joints[:, 0] - here[0])) < 2 * np.pi


def test_a_path_that_the_axes_never_reach_is_refused():
    q = multiply(exp([0.0, 0.5, 0.0]), np.repeat([[1.0, 0.0, 0.0, 0.0]], 200, axis=0))
    with pytest.raises(LimitError, match="angle of elevation"):
        routed(rotator((0.0, 360.0)), q)
