"""Keyframes that say where to point, for gimbals and for arms."""

from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from bench.pointing_requests import CLOSE, pointings

from emulated_dynamixel import ManualClock
from orientd import motion_file
from orientd.errors import LimitError
from orientd.model.limits import Limits
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import angle, exp, from_euler, rotate
from orientd_dynamixel import DynamixelDriver

LIMITS = Limits(1.5, 8.0, 1500.0, 1.0, 10.0)
AXES = [
    {"id": 1, "name": "pan", "limits_deg": [-270, 270]},
    {"id": 2, "name": "tilt", "limits_deg": [-100, 100]},
]
TURN = Path(__file__).parents[3] / "config" / "gimbal-turn.yaml"


def on_two_axes(request, **options):
    return on_axes("ZY", AXES, request, (0.0, 0.0), **options)


def on_axes(order, axes, request, begin, **options):
    driver = DynamixelDriver(
        {"port": "virtual", "order": order, "axes": axes, **options},
        period_ns=10_000_000, clock=ManualClock(1),
    )  # fmt: skip
    planner = DevicePlanner(driver, limits=LIMITS, period=0.01)
    mechanism = driver.mechanism(may_ask=False)
    start = State.at_rest(mechanism.orientation(begin))
    return planner.plan(request, start=start, joints=begin)


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


RANGES = {"Z": ("yaw", [-270, 270]), "Y": ("pitch", [-100, 100]), "X": ("roll", [-120, 120])}


@pytest.mark.parametrize(
    ("aim", "reached"),
    [
        ((180, 45), {"Z": 180, "Y": -45, "X": 0}),
        ((180, 60), {"Z": 180, "Y": -60, "X": 0}),
        ((170, 75), {"Z": 170, "Y": -75, "X": 0}),
        ((180, -45), {"Z": 180, "Y": 45, "X": 0}),
    ],
)
@pytest.mark.parametrize("order", ["ZYX", "ZXY"])
def test_a_gimbal_of_three_axes_points_behind_itself(order, aim, reached):
    axes = [
        {"id": k, "name": RANGES[one][0], "limits_deg": RANGES[one][1]}
        for k, one in enumerate(order)
    ]
    request = keyframes(
        {"azimuth_elevation": dict(zip(("azimuth", "elevation"), aim, strict=True))}
    )
    motion = on_axes(order, axes, request, (0.0, 0.0, 0.0))
    wanted = [reached[one] for one in order]
    assert np.rad2deg(motion.last_joints) == pytest.approx(wanted, abs=1e-3)


def test_two_axes_whose_roll_counts_point_behind_themselves():
    request = keyframes({"azimuth_elevation": {"azimuth": 180, "elevation": 45}})
    motion = on_two_axes(request, pointing=False)
    assert np.rad2deg(motion.last_joints) == pytest.approx([180, -45], abs=1e-3)


def test_a_gimbal_rolls_only_as_far_as_a_direction_requires():
    ranges = ("roll", [-120, 120]), ("pitch", [-30, 30]), ("yaw", [-60, 60])
    axes = [{"id": k, "name": name, "limits_deg": ends} for k, (name, ends) in enumerate(ranges)]
    request = keyframes({"azimuth_elevation": {"azimuth": 0, "elevation": 58}})
    motion = on_axes("XYZ", axes, request, (0.0, 0.0, 0.0))
    # The pitch has its 30 degrees where the cosine of the roll is tan 30 / tan 58: at 68.9 degrees.
    assert abs(np.rad2deg(motion.last_joints[0])) == pytest.approx(69, abs=0.2)
    aim = rotate(from_euler("XYZ", motion.last_joints), [1.0, 0.0, 0.0])
    assert aim == pytest.approx(direction(0, 58), abs=1e-4)


def assert_no_false_refusal(wanted):
    axes = [
        {"id": k, "name": f"axis {k}", "limits_deg": list(ends)}
        for k, ends in enumerate(wanted.ranges)
    ]
    request = keyframes({"direction": list(wanted.direction)}, pointing_axis=wanted.axis)
    begin = tuple(np.deg2rad(wanted.begin).tolist())
    refusal = angles = None
    try:
        angles = np.rad2deg(on_axes(wanted.order, axes, request, begin).last_joints)
    except LimitError as error:
        refusal = error
    assert refusal is None or not wanted.is_within_reach(), refusal
    if angles is not None:
        assert wanted.apart(angles) < CLOSE
        assert all(a - 1e-6 < b < c + 1e-6 for (a, c), b in zip(wanted.ranges, angles, strict=True))


@pytest.mark.parametrize("wanted", list(islice(pointings(1), 13)))
def test_a_direction_within_reach_is_not_refused(wanted):
    assert_no_false_refusal(wanted)


@pytest.mark.slow
def test_no_direction_within_reach_is_refused():
    for wanted in islice(pointings(2), 300):
        assert_no_false_refusal(wanted)
