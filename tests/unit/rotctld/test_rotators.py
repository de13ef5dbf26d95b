"""Positions once a second across the end of an axis, past the zenith, and over it."""

import numpy as np
import pytest
from rotator_rig import PERIOD, TOLERANCE, Rotator


def lost(error):
    """Return for how long the target is missed, s."""
    return PERIOD * float(np.sum(error > TOLERANCE))


def straight(seconds, miss_deg, heading_deg, rate_deg=0.8):
    """Return times, azimuth and elevation, degrees, of a pass that is highest in the middle."""
    times = np.arange(0.0, seconds, PERIOD)
    turn, miss = np.radians(rate_deg * (times - 0.5 * seconds)), np.radians(miss_deg)
    ahead, aside = np.sin(turn), np.sin(miss) * np.cos(turn)
    azimuth = heading_deg + np.degrees(np.unwrap(np.arctan2(aside, ahead)))
    return times, azimuth, np.degrees(np.arcsin(np.cos(miss) * np.cos(turn)))


@pytest.mark.parametrize("turns", [(0.0, 360.0), (-180.0, 180.0)])
def test_an_axis_at_the_end_of_its_range_unwinds_at_once_and_rejoins_the_target(turns):
    """It loses the target for hardly longer than a whole turn takes: 12 s."""
    times, azimuth, elevation = straight(80.0, 50.0, turns[0] - 90.0)
    rotator = Rotator(turns, (0.0, 90.0), 30.0, (azimuth[0], elevation[0]))
    error, joints = rotator.errors(times, azimuth, elevation, tips=False)
    assert np.ptp(joints[:, 0]) > 300.0
    assert lost(error) < 1.15 * 12.0
    assert np.max(error[times[:-1] > 60.0]) < TOLERANCE


def test_a_slow_axis_turns_half_round_after_the_zenith():
    """At 3 degrees a second that takes 60 s."""
    times, azimuth, elevation = straight(170.0, 0.3, 200.0, rate_deg=0.5)
    rotator = Rotator((0.0, 450.0), (0.0, 90.0), 3.0, (azimuth[0], elevation[0]))
    error, _ = rotator.errors(times, azimuth, elevation, tips=False)
    assert lost(error) < 66.0
    assert np.max(error[times[:-1] > 155.0]) < TOLERANCE


def test_an_elevation_beyond_90_degrees_takes_a_slow_axis_over_the_zenith():
    """The azimuth axis turns after the target near the zenith, as far as it can, and back."""
    times, azimuth, elevation = straight(120.0, 0.3, 200.0)
    rotator = Rotator((0.0, 450.0), (0.0, 180.0), 3.0, (azimuth[0], elevation[0]))
    error, joints = rotator.errors(times, azimuth, elevation, tips=True)
    assert joints[-1, 1] > 120.0
    assert lost(error) < 9.0
    assert np.max(error[times[:-1] > 75.0]) < TOLERANCE
