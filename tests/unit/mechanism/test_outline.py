"""The drawing of a gimbal."""

from itertools import pairwise

import numpy as np
import pytest
from gimbals import gimbal_of
from reference.gimbal import jacobian

from orientd.rotation import exp, rotate

ANGLES = (0.7, -0.4, 1.1)


def drawn(gimbal, angles):
    lines = [np.array(line) for line in gimbal.outline(angles)]
    return [lines[k : k + 3] for k in range(0, len(lines), 3)]


@pytest.mark.parametrize("order", ["ZYX", "ZXY", "XYX"])
def test_pins_point_along_the_axes_of_the_jacobian(order):
    gimbal = gimbal_of(order)
    directions = jacobian(gimbal, ANGLES).T
    for (pin, opposite, _), direction in zip(drawn(gimbal, ANGLES), directions, strict=True):
        assert pin[0] / np.linalg.norm(pin[0]) == pytest.approx(direction)
        assert opposite == pytest.approx(-pin)


def test_rings_are_joined_by_pins():
    axes = drawn(gimbal_of("ZYX"), ANGLES)
    for (_, _, ring), (pin, _, _) in pairwise(axes):
        assert np.linalg.norm(ring - pin[0], axis=1).min() < 1e-12


def test_the_mount_turns_all_of_it():
    mount = tuple(exp([0.3, -1.0, 0.2]).tolist())
    plain, mounted = drawn(gimbal_of("ZYX"), ANGLES), drawn(gimbal_of("ZYX", mount=mount), ANGLES)
    for one, other in zip(plain, mounted, strict=True):
        for line, turned in zip(one, other, strict=True):
            assert rotate(np.array(mount), line) == pytest.approx(turned)


def test_unknown_angles_are_not_drawn():
    assert gimbal_of("ZYX").outline(()) == []
