"""Poses off any path are followed by axes that have limits, as near as they can."""

import math

import numpy as np
import pytest

from orientd.driver import ZERO, AxisLimits
from orientd.mechanism import Gimbal
from orientd.mechanism.following import Following
from orientd.rotation import angle, exp, from_euler

PERIOD = 0.01
VELOCITY, ACCELERATION = math.radians(220), 40.0
AXES = [
    AxisLimits(name, -math.radians(reach), math.radians(reach), VELOCITY, ACCELERATION)
    for name, reach in (("yaw", 270), ("pitch", 100), ("roll", 270))
]


def followed(orientations, order="ZYX"):
    """Return the joints that follow orientations from rest at home, and what they make."""
    gimbal = Gimbal(AXES[: len(order)], order=order, is_pointing=len(order) == 2)
    following = Following(gimbal, PERIOD)
    joints = [(0.0,) * len(order)] * 2
    for q in orientations:
        rates = tuple((a - b) / PERIOD for a, b in zip(joints[-1], joints[-2], strict=True))
        joints.append(following.step(tuple(q), ZERO, joints[-1], rates))
    return np.array(joints[1:]), np.array([gimbal.orientation(one) for one in joints[2:]])


def assert_kept(angles):
    """Check limits of rate, acceleration and angle on what was commanded."""
    rates = np.diff(angles, axis=0) / PERIOD
    changes = np.diff(np.vstack([np.zeros(angles.shape[1]), rates]), axis=0) / PERIOD
    assert np.max(np.abs(rates)) <= VELOCITY * (1 + 1e-9)
    assert np.max(np.abs(changes)) <= ACCELERATION * (1 + 1e-9)
    for axis, row in zip(AXES, angles.T, strict=False):
        assert row.min() >= axis.low - 1e-8
        assert row.max() <= axis.high + 1e-8


def forward(angles):
    """Return the orientations of ZYX axis angles, not by way of the mechanism."""
    return np.array([from_euler("ZYX"[: len(row)], row) for row in angles])


def over(miss_deg, seconds=3.0, sweep_deg=150):
    """Return a turn over the top that misses the pole, from rest to rest."""
    miss = math.radians(miss_deg)
    u = np.linspace(0, 1, round(seconds / PERIOD))
    turn = math.radians(sweep_deg) * u**3 * (10 - 15 * u + 6 * u**2)
    return exp(turn[:, None] * np.array([0, -math.cos(miss), math.sin(miss)]))


def test_a_turn_that_the_axes_can_do_is_followed_exactly():
    u = np.arange(300) * PERIOD
    turn = np.stack([0.4 * np.sin(2 * u), 0.5 * np.sin(1.3 * u) ** 2, 0.8 * (1 - np.cos(u))], 1)
    wanted = np.array([from_euler("ZYX", row) for row in turn[:, ::-1] * [1, 1, 0.3]])
    angles, sent = followed(wanted)
    assert_kept(angles)
    late = angle(sent, wanted)
    assert np.max(late[60:]) < 1e-9


@pytest.mark.parametrize("order", ["ZYX", "ZY"])
@pytest.mark.parametrize("miss", [0.0, 1.0, 5.0])
def test_pole_is_passed_with_bounded_rates_and_what_is_sent_is_what_the_axes_make(miss, order):
    wanted = np.concatenate([over(miss), np.repeat(over(miss)[-1:], 100, axis=0)])
    angles, sent = followed(wanted, order)
    assert_kept(angles)
    assert np.max(angle(forward(angles[1:]), sent)) < 1e-6
    missed = angle(sent, wanted)
    if order == "ZYX":
        assert missed[-1] < 1e-9
        assert np.max(missed) < math.radians(65)


def test_angle_outside_the_limits_is_followed_up_to_them():
    count = 600
    wanted = exp(np.linspace(0, math.radians(350), count)[:, None] * [0.0, 0.0, 1.0])
    angles, _ = followed(np.concatenate([wanted, np.repeat(wanted[-1:], 400, axis=0)]))
    assert_kept(angles)
    # Past the limit it goes round to the other winding.
    assert math.degrees(angles[-1, 0]) == pytest.approx(-10, abs=0.01)
