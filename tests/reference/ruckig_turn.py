"""The fastest turn about one axis from rest to rest, by Ruckig (Berscheid and Kroeger 2021)."""

import pytest


def fastest(turn, velocity, acceleration, jerk):
    """Return the duration of a turn by an angle, rad, in s; skip the test without Ruckig."""
    ruckig = pytest.importorskip("ruckig")
    given, found = ruckig.InputParameter(1), ruckig.Trajectory(1)
    given.current_position, given.target_position = [0.0], [turn]
    given.max_velocity, given.max_acceleration, given.max_jerk = [velocity], [acceleration], [jerk]
    ruckig.Ruckig(1).calculate(given, found)
    return found.duration
