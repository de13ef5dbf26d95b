"""Conversions: round trips, SciPy as the outside reference, refusals."""

import itertools
import subprocess
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from orientd import rotation

RNG = np.random.default_rng(0)
QUATERNIONS = rotation.normalize(RNG.normal(size=(500, 4)))
AXIS = np.array([2.0, -3.0, 6.0]) / 7.0
ORDERS = [
    case(a + b + c)
    for a, b, c in itertools.product("xyz", repeat=3)
    if a != b and b != c
    for case in (str.lower, str.upper)
]


def test_matrices_rotate_columns_as_quaternions_do():
    matrices = rotation.to_matrix(QUATERNIONS)
    v = np.array([0.3, -1.0, 2.0])
    assert matrices @ v == pytest.approx(rotation.rotate(QUATERNIONS, v), abs=1e-14)
    assert matrices == pytest.approx(rotation.to_scipy(QUATERNIONS).as_matrix(), abs=1e-15)


def test_matrices_and_back_is_the_identity():
    back = rotation.from_matrix(rotation.to_matrix(QUATERNIONS))
    assert rotation.angle(back, QUATERNIONS).max() < 2e-15


@pytest.mark.parametrize("axis", [*np.eye(3), *-np.eye(3), AXIS])
@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 2.0, np.pi - 1e-9, np.pi])
def test_no_angle_is_hard_for_the_largest_component(axis, angle):
    q = rotation.from_axis_angle(axis, angle)
    assert rotation.angle(rotation.from_matrix(rotation.to_matrix(q)), q) < 1e-15


@pytest.mark.parametrize("components", [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)])
@pytest.mark.parametrize("excess", [-1e-9, 0.0, 1e-9])
def test_both_sides_of_a_change_of_largest_component_agree(components, excess):
    q = np.zeros(4)
    q[list(components)] = 1.0 + excess, 1.0 - excess
    q = rotation.normalize(q + 0.1)
    assert rotation.angle(rotation.from_matrix(rotation.to_matrix(q)), q) < 1e-15


def test_the_largest_component_is_positive():
    back = rotation.from_matrix(rotation.to_matrix(QUATERNIONS))
    largest = np.argmax(np.abs(back), axis=1)
    assert np.all(np.take_along_axis(back, largest[:, None], axis=1) > 0.0)


@pytest.mark.parametrize(
    ("matrix", "problem"),
    [
        (np.diag([1.0, 1.0, -1.0]), "reflection"),
        (2.0 * np.eye(3), "orthogonal"),
        (np.full((3, 3), np.nan), "orthogonal"),
        (np.eye(4), "shape"),
    ],
)
def test_what_is_not_a_rotation_matrix_is_refused(matrix, problem):
    with pytest.raises(ValueError, match=problem):
        rotation.from_matrix(matrix)


def test_rotation_vectors_are_scipys():
    vectors = rotation.log(QUATERNIONS)
    assert vectors == pytest.approx(rotation.to_scipy(QUATERNIONS).as_rotvec(), abs=1e-14)
    assert rotation.angle(rotation.exp(vectors), QUATERNIONS).max() < 2e-15


def test_turns_about_axes_are_scipys():
    vectors = rotation.log(QUATERNIONS)
    angles = np.linalg.norm(vectors, axis=1)
    there = rotation.from_axis_angle(vectors, angles)
    assert rotation.angle(there, QUATERNIONS).max() < 2e-15


def test_an_axis_of_any_length_will_do_but_zero():
    short = rotation.from_axis_angle([0.0, 1e-200, 0.0], 1.0)
    assert short == pytest.approx([np.cos(0.5), 0.0, np.sin(0.5), 0.0])
    with pytest.raises(ValueError, match="not zero"):
        rotation.from_axis_angle(np.zeros(3), 1.0)


@pytest.mark.parametrize("axes", ORDERS)
def test_euler_angles_are_scipys(axes):
    angles = rotation.to_euler(QUATERNIONS, axes)
    assert angles == pytest.approx(rotation.to_scipy(QUATERNIONS).as_euler(axes), abs=1e-9)
    assert rotation.angle(rotation.from_euler(axes, angles), QUATERNIONS).max() < 4e-15
    there = Rotation.from_euler(axes, angles)
    assert rotation.angle(rotation.from_scipy(there), QUATERNIONS).max() < 4e-15


@pytest.mark.parametrize("axes", ORDERS)
@pytest.mark.parametrize("side", [0, 1])
def test_euler_angles_at_gimbal_lock_are_still_the_orientation(axes, side):
    is_proper = axes[0] == axes[2]
    locked = (0.0, np.pi)[side] if is_proper else (0.5, -0.5)[side] * np.pi
    angles = np.array([[a, locked, b] for a in (-3.0, 0.2, 2.0) for b in (-1.0, 0.0, 3.0)])
    q = rotation.from_euler(axes, angles)
    found = rotation.to_euler(q, axes)
    assert rotation.angle(rotation.from_euler(axes, found), q).max() < 1e-7
    assert np.all(np.abs(found[:, 2 if axes.isupper() else 0]) == 0.0)


def test_one_and_two_turns_make_an_orientation_too():
    one = rotation.from_euler("z", [[0.5]])[0]
    assert one == pytest.approx([np.cos(0.25), 0.0, 0.0, np.sin(0.25)])
    two = rotation.from_euler("XY", [0.1, 0.2])
    assert two == pytest.approx(rotation.from_euler("XYZ", [0.1, 0.2, 0.0]))


@pytest.mark.parametrize("axes", ["", "xx", "xYz", "abc", "xyzx", "zzx"])
def test_axes_that_name_no_turns_are_refused(axes):
    with pytest.raises(ValueError, match="axes"):
        rotation.from_euler(axes, np.zeros(len(axes)))


def test_angles_that_do_not_fit_the_axes_are_refused():
    with pytest.raises(ValueError, match="angles must have 3"):
        rotation.from_euler("xyz", [0.1, 0.2])
    with pytest.raises(ValueError, match="finite"):
        rotation.from_euler("xyz", [0.1, 0.2, np.nan])
    with pytest.raises(ValueError, match="three letters"):
        rotation.to_euler(QUATERNIONS, "xy")


def test_scipy_and_back_is_the_identity():
    back = rotation.from_scipy(rotation.to_scipy(QUATERNIONS))
    assert rotation.angle(back, QUATERNIONS).max() < 1e-15
    single = rotation.from_scipy(rotation.to_scipy(QUATERNIONS[0]))
    assert single.shape == (4,)


def test_a_quaternion_far_from_unit_norm_is_refused_everywhere():
    for convert in (rotation.to_matrix, rotation.to_scipy):
        with pytest.raises(ValueError, match="norm must be 1"):
            convert([1.0, 0.1, 0.0, 0.0])


def test_importing_the_package_does_not_import_scipy():
    code = "import sys, orientd.rotation; sys.exit('scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
