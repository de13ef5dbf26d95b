"""The emulator's own kinematics and transforms."""

import pytest

from emulated_ur.arm.kinematics import Kinematics, speed
from emulated_ur.arm.models import MODELS
from emulated_ur.arm.transforms import rotation_between

kinematics = Kinematics(MODELS["ur5e"])


def furthest(a, b):
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize("bend", [0.0, 5e-8, 2e-7, 1e-5])
def test_straight_wrist_keeps_the_sixth_joint_or_finds_it(bend):
    q = (0.3, -1.2, 1.5, -1.9, bend, 0.4)
    found = kinematics.inverse(kinematics.forward(q), q)
    assert furthest(kinematics.forward(found), kinematics.forward(q)) < 1e-6
    assert abs(found[5] - 0.4) < 1e-2


def test_speed_is_the_central_difference_of_the_pose():
    q, qd, h = (0.3, -1.2, 1.5, -1.9, -1.5, 0.4), (0.2, -0.3, 0.5, 0.7, -0.4, 1.1), 1e-5
    before, after = (
        kinematics.forward([a + s * h * b for a, b in zip(q, qd, strict=True)]) for s in (-1, 1)
    )
    here = kinematics.frames(q)
    expected = [(b - a) / (2 * h) for a, b in zip(before[3::4], after[3::4], strict=True)]
    expected += [r / (2 * h) for r in rotation_between(before, after)]
    assert speed(here, qd, here[-1][3::4]) == pytest.approx(expected, abs=1e-8)
