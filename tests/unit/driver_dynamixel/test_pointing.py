"""Keyframes that say where to point, for gimbals of two axes and for arms."""

from pathlib import Path

import numpy as np
import pytest

from orientd import motion_file
from orientd.clock import ManualClock
from orientd.errors import LimitError
from orientd.planner import DevicePlanner, Limits, State, plan
from orientd.rotation import angle, exp, from_euler, rotate
from orientd_dynamixel import DynamixelDriver

LIMITS = Limits(1.5, 8.0, 1500.0, 1.0, 10.0)
AXES = [
    {"id": 1, "name": "pan", "limits_deg": [-270, 270]},
    {"id": 2, "name": "tilt", "limits_deg": [-100, 100]},
]
TURN = Path(__file__).parents[3] / "config" / "gimbal-turn.yaml"


def on_two_axes(request, **options):
    driver = DynamixelDriver(
        {"port": "virtual", "order": "ZY", "axes": AXES, **options},
        period_ns=10_000_000, clock=ManualClock(1),
    )  # fmt: skip
    planner = DevicePlanner(driver, limits=LIMITS, period=0.01)
    return planner.plan(request, start=State.at_rest([1, 0, 0, 0]), joints=(0.0, 0.0))


def direction(azimuth, elevation):
    return rotate(from_euler("ZY", np.deg2rad([azimuth, -elevation])), [1.0, 0.0, 0.0])


def keyframes(*forms, **others):
    return motion_file.parse({"keyframes": list(forms), "approach": True, **others})


def test_first_move_of_a_newcomer_with_two_axes_works():
    motion = on_two_axes(motion_file.load(TURN))
    pan, tilt = np.rad2deg(motion.last_joints)
    assert (pan, tilt) == pytest.approx((60, 20), abs=1e-3)


def test_roll_counts_on_two_axes_where_that_is_asked_for():
    with pytest.raises(LimitError, match="orientation error of the two axes"):
        on_two_axes(motion_file.load(TURN), pointing=False)


@pytest.mark.parametrize(
    "form",
    [
        {"azimuth_elevation": {"azimuth": 40, "elevation": 25}},
        {"direction": (3.0 * direction(40, 25)).tolist()},
        {"look_at": (2.0 * direction(40, 25)).tolist()},
        {"look_at": {"point": np.add(direction(40, 25), [1, 2, 3]).tolist(), "place": [1, 2, 3]}},
    ],
    ids=lambda form: next(iter(form)),
)
def test_two_axes_point_where_they_are_told(form):
    motion = on_two_axes(keyframes(form))
    assert np.rad2deg(motion.last_joints) == pytest.approx([40, -25], abs=1e-3)


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_an_arm_points_with_the_least_turn_of_its_tool(axis):
    start = State.at_rest(exp([0.3, -0.5, 0.9]))
    points = np.eye(3)["xyz".index(axis)]
    aims = [direction(40, 25), direction(100, -30)]
    request = keyframes(*({"direction": aim.tolist()} for aim in aims), pointing_axis=axis)
    motion = plan(request, start=start, limits=LIMITS, period=0.002)
    before = start.q
    for aim, q in zip(aims, motion.request.keys, strict=True):
        assert rotate(q, points) == pytest.approx(aim, abs=1e-12)
        least = np.arccos(rotate(before, points) @ aim)
        assert angle(before, q) == pytest.approx(least, abs=1e-9)
        before = q


def test_a_direction_of_no_length_is_named():
    with pytest.raises(ValueError, match=r"keyframes\[0\].direction: .*zero"):
        keyframes({"direction": [0, 0, 0]})
