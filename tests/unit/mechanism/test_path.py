"""The axes of a gimbal along a path: exact, on one branch, over the pole, and what is refused."""

import numpy as np
import pytest
from gimbals import forward, gimbal_of, limits

from orientd.driver import AxisLimits
from orientd.errors import LimitError
from orientd.mechanism.arrays import orientations
from orientd.mechanism.pointing import pointing_error
from orientd.mechanism.routing import beginnings, check_way, joints_along
from orientd.rotation import angle, exp, from_axis_angle, from_matrix, multiply

PERIOD = 0.005


def passing(miss_deg, rate_deg=15.0, half=4.0):
    """A tool axis on a great circle that misses the pole by an angle."""
    miss = np.deg2rad(miss_deg)
    times = np.arange(-half, half + PERIOD / 2, PERIOD)
    nearest = np.array([0.0, np.sin(miss), np.cos(miss)])
    normal = np.cross(nearest, [1.0, 0, 0])
    frame = np.stack([nearest, normal, np.cross(nearest, normal)], axis=1)
    turn = from_axis_angle(normal, np.deg2rad(rate_deg) * times)
    return multiply(turn, from_matrix(frame))


def along(order, q, axes=None, *, start=()):
    """Return a gimbal and its axis angles along a path, from *start* on."""
    gimbal = gimbal_of(order, axes=axes, is_pointing=True)
    times = PERIOD * np.arange(len(q))
    joints = joints_along(gimbal, times, q, np.zeros((len(q), 3)), start)
    check_way(gimbal, joints, times)
    return gimbal, joints


@pytest.mark.parametrize("order", ["ZY", "ZYX", "ZXY", "ZYZ"])
def test_exact_path_stays_exact(order):
    times = np.arange(0, 5, PERIOD)
    q = exp(np.stack([0.3 * np.sin(times), 0.4 * np.sin(1.3 * times), 0.5 * np.sin(times)], axis=1))
    q = multiply(from_axis_angle([0, 1, 0], 0.6), q)
    gimbal, joints = along(order, q)
    assert np.max(pointing_error(gimbal, orientations(gimbal, joints), q)) < 1e-12
    if len(order) == 3:
        assert np.max(angle(orientations(gimbal, joints), q)) < 1e-12


@pytest.mark.parametrize("order", ["ZY", "ZYX"])
def test_path_through_the_pole_itself_goes_straight_over(order):
    q = passing(0.0)
    gimbal, joints = along(order, q, limits(order))
    assert np.max(pointing_error(gimbal, orientations(gimbal, joints), q)) < 1e-12
    assert np.ptp(joints[:, 0]) < 1e-9
    assert np.ptp(joints[:, 1]) == pytest.approx(np.deg2rad(120), rel=1e-6)


def test_angle_outside_a_range_is_refused_with_its_time():
    q = from_axis_angle([0, 0, 1], np.linspace(0, np.pi, 400))
    narrow = [
        AxisLimits("pan", -1, 1, 3.85, 40.0),
        AxisLimits("tilt", -1, 1, 3.85, 40.0),
        *limits("ZYX")[2:],
    ]
    with pytest.raises(LimitError, match="angle of pan") as caught:
        along("ZYX", q, narrow)
    assert caught.value.time == pytest.approx(1 / np.pi * 399 * PERIOD, abs=0.01)


def test_beginning_that_no_branch_reaches_is_refused_for_the_axis_that_misses_it():
    gimbal = gimbal_of("ZY", axes=[limits("ZY")[0], AxisLimits("tilt", 0.0, 0.5, 3.85, 40.0)])
    q = tuple(from_axis_angle([0, 1, 0], 0.9).tolist())
    with pytest.raises(LimitError, match=r"angle of tilt reaches 0\.9 rad .*no branch"):
        beginnings(gimbal, q, (0.0, 0.0, 0.0))


def test_axis_that_has_wound_up_is_refused_for_its_angle_not_for_a_jump():
    q = from_axis_angle([0, 0, 1], np.deg2rad(np.linspace(0, 300, 2000)))
    with pytest.raises(LimitError, match=r"angle of pan reaches .*unwind it first") as caught:
        along("ZYX", q, limits("ZYX"), start=(0.0, 0.0, 0.0))
    assert np.rad2deg(caught.value.value) == pytest.approx(270, abs=0.2)
    assert caught.value.limit == pytest.approx(np.deg2rad(270))
    assert caught.value.time == pytest.approx(0.9 * 2000 * PERIOD, abs=2 * PERIOD)


def test_beginnings_are_on_every_turn_inside_the_ranges_the_nearest_to_home_first():
    gimbal = gimbal_of("ZY", axes=limits("ZY"))
    found = beginnings(gimbal, tuple(from_axis_angle([0, 0, 1], np.deg2rad(-150.0)).tolist()), ())
    pans = np.rad2deg([pan for pan, _ in found]).round(6).tolist()
    assert pans[:2] == [-150.0, 30.0] or pans[:2] == [30.0, -150.0]
    assert sorted(set(pans)) == [-150.0, 30.0, 210.0]


@pytest.mark.parametrize("order", ["ZYX", "ZXY"])
def test_turn_at_the_pole_is_one_of_the_outer_axis_as_in_the_driver(order):
    gimbal = gimbal_of(order, axes=limits(order), is_pointing=True)
    start = np.array([0.7, -np.pi / 2 if order == "ZYX" else np.pi / 2, 0.3])
    times = np.linspace(0, 1, 400)
    spin = 0.8 * (10 * times**3 - 15 * times**4 + 6 * times**5)
    q = multiply(from_axis_angle([0, 0, 1], spin), forward(gimbal, start))
    _, joints = along(order, q, limits(order), start=tuple(start.tolist()))
    assert joints[-1] == pytest.approx(np.add(start, (0.8, 0, 0)), abs=1e-9)
    last = tuple(start.tolist())
    for wanted in orientations(gimbal, joints).tolist():
        last, _ = gimbal.solve(tuple(wanted), last)
    assert last == pytest.approx(joints[-1], abs=1e-6)


@pytest.mark.parametrize("order", ["ZYX", "ZY"])
def test_path_that_leaves_the_pole_as_the_gimbal_stands_needs_nothing(order):
    gimbal = gimbal_of(order, axes=limits(order), is_pointing=True)
    start = np.array([0.4, -np.pi / 2, 0.3])[: len(order)]
    way = start + np.outer(np.linspace(0.0, 1.0, 400), np.eye(3)[1, : len(order)])
    q = orientations(gimbal, way)
    _, joints = along(order, q, limits(order), start=tuple(start.tolist()))
    assert np.max(np.abs(joints - way)) < 1e-9
