"""The plain floats of a cycle against the arrays of the plan."""

import random

import numpy as np
import pytest
from reference.gimbal import jacobian

from orientd.rotation import angle, exp, multiply
from orientd_dynamixel.certificate import AxisLimits, DeviationPolicy
from orientd_dynamixel.kinematics import Gimbal
from orientd_dynamixel.path import plan_axes
from orientd_dynamixel.tracker import AxisTracker

ORDERS = ["ZYX", "ZXY", "XYZ", "ZYZ", "ZXZ", "ZY", "ZX", "XY", "YX"]
MOUNT = (0.5, 0.5, -0.5, 0.5)
TOOL = (0.6, 0.0, 0.8, 0.0)


@pytest.mark.parametrize("order", ORDERS)
def test_forward_agrees_with_the_plan(order):
    angles = np.random.default_rng(1).uniform(-7, 7, (100, len(order)))
    tracker, gimbal = AxisTracker(order, MOUNT, TOOL), Gimbal(order, MOUNT, TOOL)
    ours = [tracker.forward(row) for row in angles.tolist()]
    assert np.max(angle(ours, gimbal.forward(angles))) < 1e-14


@pytest.mark.parametrize("order", ORDERS)
def test_solution_nearest_to_the_last_command_is_found(order):
    rng = random.Random(2)
    tracker = AxisTracker(order, MOUNT, TOOL)
    for _ in range(300):
        wanted = tuple(rng.uniform(-7, 7) for _ in order)
        tracker.angles = tuple(a + rng.uniform(-0.05, 0.05) for a in wanted)
        got, missed = tracker.solve(tracker.forward(wanted))
        assert missed < 1e-9
        # Close to the pole the twin may be nearer; it makes the same orientation.
        assert (
            got == pytest.approx(wanted, abs=1e-7)
            or np.max(angle(tracker.forward(got), tracker.forward(wanted))) < 1e-9
        )


@pytest.mark.parametrize("order", ORDERS)
def test_angular_velocity_equals_that_of_the_jacobian(order):
    rng = np.random.default_rng(3)
    tracker, gimbal = AxisTracker(order, MOUNT, TOOL), Gimbal(order, MOUNT, TOOL)
    for _ in range(20):
        angles, rates = rng.uniform(-3, 3, len(order)), rng.normal(size=len(order))
        world = jacobian(gimbal, angles) @ rates
        body = tracker.omega_body(angles.tolist(), rates.tolist())
        q = gimbal.forward(angles)
        turned = multiply(multiply(q, [0, *body]), q * [1, -1, -1, -1])[1:]
        assert np.allclose(turned, world, atol=1e-12)


@pytest.mark.parametrize("order", ["ZYX", "ZY"])
@pytest.mark.parametrize("miss_deg", [0.1, 2.0, 5.0])
def test_planned_passage_comes_out_as_planned(order, miss_deg):
    miss, period = np.deg2rad(miss_deg), 0.005
    times = np.arange(-2, 2, period)
    gimbal = Gimbal(order)
    path = exp(np.outer(times * np.deg2rad(15), [0, np.cos(miss), -np.sin(miss)]))
    q = multiply(path, gimbal.forward([np.pi / 2 * 0, -np.pi / 2 + miss, 0][: len(order)]))
    limits = [AxisLimits(-4.7, 4.7, 3.0, 40, "axis")] * len(order)
    plan = plan_axes(gimbal, q, period, limits, policy=DeviationPolicy(max_deviation=np.deg2rad(6)))
    tracker = AxisTracker(order, (1, 0, 0, 0), (1, 0, 0, 0))
    tracker.angles = tuple(plan.angles[0])
    worst = 0.0
    for row, wanted in zip(plan.q.tolist(), plan.angles, strict=True):
        tracker.angles, missed = tracker.solve(tuple(row))
        assert missed < 1e-9
        worst = max(worst, float(np.max(np.abs(np.subtract(tracker.angles, wanted)))))
    assert worst < 1e-6


def test_pointing_takes_any_roll():
    tracker = AxisTracker("ZY", (1, 0, 0, 0), (1, 0, 0, 0), is_pointing=True)
    q = Gimbal("ZYX").forward([0.3, 0.4, 1.2])
    got, missed = tracker.solve(tuple(q))
    assert got == pytest.approx((0.3, 0.4))
    assert missed == 0.0


def test_fit_states_the_roll_it_drops():
    tracker = AxisTracker("ZY", (1, 0, 0, 0), (1, 0, 0, 0))
    _, missed = tracker.solve(tuple(Gimbal("ZXY").forward([0.3, 0.2, 0.4])))
    assert missed == pytest.approx(0.2)


def test_pole_itself_keeps_the_inner_angle():
    tracker = AxisTracker("ZYX", (1, 0, 0, 0), (1, 0, 0, 0))
    tracker.angles = (0.7, 1.57, 0.4)
    got, _ = tracker.solve(tracker.forward((0.7, np.pi / 2, 0.4)))
    assert got == pytest.approx((0.7, np.pi / 2, 0.4), abs=1e-6)
