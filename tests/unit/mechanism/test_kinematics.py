"""Gimbal kinematics: laws over every order, then figures worked out by hand or by SciPy."""

import numpy as np
import pytest
from gimbals import forward, gimbal_of, inverse, manipulability
from reference.gimbal import jacobian
from scipy.spatial.transform import Rotation

from orientd.mechanism.arrays import matrices, of_arrays
from orientd.rotation import angle

THREE = ["ZYX", "ZXY", "XYZ", "XZY", "YXZ", "YZX", "ZYZ", "ZXZ", "XYX", "XZX", "YXY", "YZY"]
TWO = ["ZY", "ZX", "XY", "XZ", "YX", "YZ"]
MOUNT = (0.5, 0.5, -0.5, 0.5)
TOOL = (0.6, 0.0, 0.8, 0.0)


def random_quaternions(count, seed=1):
    q = np.random.default_rng(seed).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


@pytest.mark.parametrize("order", THREE)
def test_forward_agrees_with_scipy(order):
    angles = np.random.default_rng(2).uniform(-np.pi, np.pi, (100, 3))
    ours = forward(gimbal_of(order), angles)
    theirs = Rotation.from_euler(order, angles).as_quat(scalar_first=True)
    assert np.max(angle(ours, theirs)) < 1e-14


@pytest.mark.parametrize("order", THREE)
@pytest.mark.parametrize(("mount", "tool"), [((1, 0, 0, 0), (1, 0, 0, 0)), (MOUNT, TOOL)])
def test_both_branches_give_the_orientation_back(order, mount, tool):
    gimbal = gimbal_of(order, mount=mount, tool=tool)
    q = random_quaternions(2000)
    branches = inverse(gimbal, q)
    assert branches.shape == (2000, 2, 3)
    for branch in (0, 1):
        assert np.max(angle(forward(gimbal, branches[:, branch]), q)) < 3e-14


@pytest.mark.parametrize("order", THREE)
def test_branches_are_twins(order):
    first, second = np.moveaxis(inverse(gimbal_of(order), random_quaternions(500)), 1, 0)
    middle = -first[:, 1] if order[0] == order[2] else np.pi - first[:, 1]
    twin = np.stack([first[:, 0] + np.pi, middle, first[:, 2] + np.pi], axis=1)
    assert np.max(np.abs(np.exp(1j * twin) - np.exp(1j * second))) < 1e-12


@pytest.mark.parametrize("order", THREE)
def test_orientation_at_the_pole_comes_back_with_the_inner_angle_kept(order):
    gimbal = gimbal_of(order)
    lock = (0.0, np.pi) if order[0] == order[2] else (np.pi / 2, -np.pi / 2)
    for middle in lock:
        q = forward(gimbal, [0.7, middle, 0.4])
        (angles,) = inverse(gimbal, [q], inner=0.3)
        assert np.max(angle(forward(gimbal, angles), q)) < 1e-7
        assert angles[0, 2] == pytest.approx(0.3, abs=1e-7)


@pytest.mark.parametrize("order", THREE)
@pytest.mark.parametrize("distance", [9e-7, 1.1e-6, 1e-5])
def test_both_sides_of_the_lock_give_the_orientation_back(order, distance):
    gimbal = gimbal_of(order)
    middle = distance if order[0] == order[2] else np.pi / 2 - distance
    q = forward(gimbal, [0.7, middle, 0.4])
    assert np.max(angle(forward(gimbal, inverse(gimbal, [q], inner=0.4)[0]), q)) < 1e-12 + 2e-6 * (
        distance < 1e-6
    )


def test_yaw_pitch_roll_are_the_formulas_of_the_field():
    q = random_quaternions(500, 3)
    r = Rotation.from_quat(q, scalar_first=True).as_matrix()
    yaw, pitch, roll = inverse(gimbal_of("ZYX"), q)[:, 0].T
    assert np.allclose(yaw, np.arctan2(r[:, 1, 0], r[:, 0, 0]), atol=1e-14)
    assert np.allclose(pitch, np.arctan2(-r[:, 2, 0], np.hypot(r[:, 0, 0], r[:, 1, 0])), atol=1e-14)
    assert np.allclose(roll, np.arctan2(r[:, 2, 1], r[:, 2, 2]), atol=1e-14)


def test_camera_order_is_harmless_straight_down():
    straight_down = forward(gimbal_of("ZYX"), [0.3, np.pi / 2, 0.0])
    gimbal = gimbal_of("ZXY")
    angles = inverse(gimbal, [straight_down])[0][0]
    assert manipulability(gimbal, angles) > 0.99


@pytest.mark.parametrize("order", TWO)
def test_two_axes_point_exactly(order):
    gimbal = gimbal_of(order)
    q = random_quaternions(1000)
    axis = np.eye(3)[gimbal.kinematics.inner_axis]
    wanted = Rotation.from_quat(q, scalar_first=True).apply(axis)
    for branch in (0, 1):
        reached = forward(gimbal, inverse(gimbal, q)[:, branch])
        got = Rotation.from_quat(reached, scalar_first=True).apply(axis)
        assert np.max(np.linalg.norm(got - wanted, axis=1)) < 1e-14


def test_pan_tilt_is_the_formula_of_the_field():
    q = random_quaternions(500, 4)
    d = Rotation.from_quat(q, scalar_first=True).apply([1, 0, 0])
    pan, tilt = inverse(gimbal_of("ZY"), q)[:, 0].T
    assert np.allclose(pan, np.arctan2(d[:, 1], d[:, 0]), atol=1e-14)
    assert np.allclose(tilt, np.arctan2(-d[:, 2], np.hypot(d[:, 0], d[:, 1])), atol=1e-14)


def fit(order, q):
    """What two axes come nearest to whole orientations with, and the angles that remain."""
    gimbal, last = gimbal_of(order), (0.0, 0.0)
    angles, error = zip(*(gimbal.solve(tuple(one), last) for one in q.tolist()), strict=True)
    return np.array(angles), np.array(error)


@pytest.mark.parametrize("order", TWO)
def test_fit_is_the_best_there_is_and_states_its_error(order):
    gimbal = gimbal_of(order)
    q = random_quaternions(50, 5)
    angles, error = fit(order, q)
    assert np.allclose(angle(forward(gimbal, angles), q), error, atol=1e-7)
    grid = np.linspace(-np.pi, np.pi, 181)
    a, b = np.meshgrid(grid, grid)
    every = forward(gimbal, np.stack([a.ravel(), b.ravel()], axis=1))
    best = np.arccos(np.minimum(1, np.max(np.abs(every @ q.T), axis=0))) * 2
    assert np.all(error <= best + 1e-12)
    assert np.all(error >= best - np.deg2rad(2.1))


def test_residual_roll_of_a_fit_is_the_sine_of_the_field():
    q = random_quaternions(500, 6)
    r = Rotation.from_quat(q, scalar_first=True).as_matrix()
    _, error = fit("ZY", q)
    assert np.allclose(np.sin(error), np.abs(r[:, 2, 1]), atol=1e-14)


@pytest.mark.parametrize("order", [*THREE, *TWO])
def test_error_left_by_any_outer_angle_is_stated_exactly(order):
    gimbal = gimbal_of(order)
    q = random_quaternions(300, 7)
    outer = np.random.default_rng(8).uniform(-np.pi, np.pi, 300)
    matrix, kinematics = matrices(gimbal, q), of_arrays(gimbal)
    inner, error = kinematics.inner(matrix, outer)
    reached = forward(gimbal, np.stack([outer, *inner], axis=1))
    if len(order) == 3:
        assert np.allclose(angle(reached, q), error, atol=1e-12)
    else:
        axis = np.eye(3)[gimbal.kinematics.inner_axis]
        a = Rotation.from_quat(reached, scalar_first=True).apply(axis)
        b = Rotation.from_quat(q, scalar_first=True).apply(axis)
        assert np.allclose(
            np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.sum(a * b, axis=1)),
            error, atol=1e-12,
        )  # fmt: skip
    exact, sine = kinematics.pointing(matrix)
    assert np.allclose(np.sin(error), sine * np.abs(np.sin(outer - exact)), atol=1e-12)


def test_determinant_and_least_singular_value_of_yaw_pitch_roll():
    gimbal = gimbal_of("ZYX")
    pitch = np.deg2rad([0, 45, 80, 85, 88])
    angles = np.stack([np.full(5, 0.3), pitch, np.full(5, -0.4)], axis=1)
    assert np.allclose(np.abs(np.linalg.det(jacobian(gimbal, angles))), np.cos(pitch), atol=1e-14)
    sigma = manipulability(gimbal, angles)
    assert np.allclose(sigma, np.sqrt(1 - np.abs(np.sin(pitch))), atol=1e-12)
    assert np.round(sigma[2:], 3) == pytest.approx([0.123, 0.062, 0.025])


def test_manipulability_of_pan_tilt_is_the_cosine_of_the_tilt():
    tilt = np.deg2rad([0, 30, 60, 89])
    angles = np.stack([np.full(4, 1.0), tilt], axis=1)
    assert np.allclose(manipulability(gimbal_of("ZY"), angles), np.cos(tilt), atol=1e-12)


@pytest.mark.parametrize("order", ["Z", "ZZ", "ZYY", "xyz", "ZYXZ", ""])
def test_impossible_order_is_refused(order):
    with pytest.raises(ValueError, match="order must"):
        gimbal_of(order)
