"""The same formulas on the plain floats of a cycle and on the arrays of a plan."""

import random

import numpy as np
import pytest
from gimbals import forward, gimbal_of
from reference.gimbal import jacobian

from orientd.mechanism.arrays import orientations
from orientd.mechanism.routing import joints_along
from orientd.rotation import angle, exp, multiply

ORDERS = ["ZYX", "ZXY", "XYZ", "ZYZ", "ZXZ", "ZY", "ZX", "XY", "YX"]
MOUNT = (0.5, 0.5, -0.5, 0.5)
TOOL = (0.6, 0.0, 0.8, 0.0)


@pytest.mark.parametrize("order", ORDERS)
def test_forward_agrees_with_the_plan(order):
    angles = np.random.default_rng(1).uniform(-7, 7, (100, len(order)))
    gimbal = gimbal_of(order, mount=MOUNT, tool=TOOL)
    ours = [gimbal.orientation(row) for row in angles.tolist()]
    assert np.max(angle(ours, forward(gimbal, angles))) < 1e-14


@pytest.mark.parametrize("order", ORDERS)
def test_solution_nearest_to_the_last_command_is_found(order):
    rng = random.Random(2)
    gimbal = gimbal_of(order, mount=MOUNT, tool=TOOL)
    for _ in range(300):
        wanted = tuple(rng.uniform(-7, 7) for _ in order)
        last = tuple(a + rng.uniform(-0.05, 0.05) for a in wanted)
        got, missed = gimbal.solve(gimbal.orientation(wanted), last)
        assert missed < 1e-9
        # Close to the pole the twin may be nearer; it makes the same orientation.
        assert (
            got == pytest.approx(wanted, abs=1e-7)
            or np.max(angle(gimbal.orientation(got), gimbal.orientation(wanted))) < 1e-9
        )


@pytest.mark.parametrize("order", ORDERS)
def test_angular_velocity_equals_that_of_the_jacobian(order):
    rng = np.random.default_rng(3)
    gimbal = gimbal_of(order, mount=MOUNT, tool=TOOL)
    for _ in range(20):
        angles, rates = rng.uniform(-3, 3, len(order)), rng.normal(size=len(order))
        world = jacobian(gimbal, angles) @ rates
        body = gimbal.kinematics.omega_body(angles.tolist(), rates.tolist())
        q = forward(gimbal, angles)
        turned = multiply(multiply(q, [0, *body]), q * [1, -1, -1, -1])[1:]
        assert np.allclose(turned, world, atol=1e-12)


@pytest.mark.parametrize("order", ["ZYX", "ZY"])
@pytest.mark.parametrize("miss_deg", [0.1, 2.0, 5.0])
def test_axes_near_a_pole_are_those_of_the_driver(order, miss_deg):
    miss, period = np.deg2rad(miss_deg), 0.005
    times = np.arange(-2, 2, period)
    gimbal = gimbal_of(order, is_pointing=True)
    path = exp(np.outer(times * np.deg2rad(15), [0, np.cos(miss), -np.sin(miss)]))
    q = multiply(path, gimbal.orientation((0.0, -np.pi / 2 + miss, 0.0)[: len(order)]))
    joints = joints_along(gimbal, times, q, np.zeros((len(q), 3)), ())
    last = tuple(joints[0])
    worst = 0.0
    for row, wanted in zip(orientations(gimbal, joints).tolist(), joints, strict=True):
        last, missed = gimbal.solve(tuple(row), last)
        assert missed < 1e-9
        worst = max(worst, float(np.max(np.abs(np.subtract(last, wanted)))))
    assert worst < 1e-6


def test_pointing_takes_any_roll():
    q = gimbal_of("ZYX").orientation((0.3, 0.4, 1.2))
    got, missed = gimbal_of("ZY", is_pointing=True).solve(q, (0.0, 0.0))
    assert got == pytest.approx((0.3, 0.4))
    assert missed == 0.0


def test_fit_states_the_roll_it_drops():
    q = gimbal_of("ZXY").orientation((0.3, 0.2, 0.4))
    _, missed = gimbal_of("ZY").solve(q, (0.0, 0.0))
    assert missed == pytest.approx(0.2)


def test_pole_itself_keeps_the_inner_angle():
    gimbal = gimbal_of("ZYX")
    got, _ = gimbal.solve(gimbal.orientation((0.7, np.pi / 2, 0.4)), (0.7, 1.57, 0.4))
    assert got == pytest.approx((0.7, np.pi / 2, 0.4), abs=1e-6)
