"""The way back is the way that the axes have turned: windings, and home."""

import re
from dataclasses import replace

import numpy as np
import pytest

from emulated_dynamixel import ManualClock
from orientd.errors import LimitError, StartError
from orientd.mechanism.turning import windings
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.device_planner import DevicePlanner
from orientd.planner.state import State
from orientd.rotation import exp, from_euler
from orientd_dynamixel import DynamixelDriver
from orientd_dynamixel.options import parse

LIMITS = Limits(1.5, 8.0, 1500.0, 1.0, 10.0)
AXES = [
    {"id": 1, "name": "yaw", "limits_deg": [-270, 270]},
    {"id": 2, "name": "pitch", "limits_deg": [-100, 100]},
    {"id": 3, "name": "roll", "limits_deg": [-120, 120]},
]


def plan(begin_deg, *keyframes, axes=AXES, options=(), **fields):
    """Return the axis angles of the motion to *keyframes*, deg."""
    driver = DynamixelDriver(
        {"port": "virtual", "axes": axes, **dict(options)},
        period_ns=10_000_000,
        clock=ManualClock(1),
    )
    joints = tuple(np.deg2rad(begin_deg))
    motion = DevicePlanner(driver, limits=LIMITS, period=0.01).plan(
        MotionRequest(keyframes, **fields),
        start=State.at_rest(driver._gimbal.orientation(joints)), joints=joints,
    )  # fmt: skip
    return np.rad2deg(motion.path.joints)


def yaw(degrees, turns=0):
    return Keyframe(tuple(exp([0.0, 0.0, np.deg2rad(degrees)]).tolist()), turns=turns)


@pytest.mark.parametrize(("begin", "end"), [(210, 0), (265, -60), (-250, 60), (210, 90)])
def test_single_keyframe_is_reached_by_the_turn_that_the_limits_leave(begin, end):
    angles = plan([begin, 0, 0], yaw(end))
    assert angles[-1] == pytest.approx([end, 0, 0], abs=1e-3)
    assert np.max(np.abs(angles[:, 0])) < 270.5


@pytest.mark.parametrize(("turns", "end"), [(0, 90), (-1, -270)])
def test_single_keyframe_may_have_turns(turns, end):
    assert plan([0, 0, 0], yaw(90, turns))[-1] == pytest.approx([end, 0, 0], abs=1e-3)


def test_turns_that_no_limit_permits_are_refused():
    with pytest.raises(LimitError, match="yaw"):
        plan([0, 0, 0], yaw(90, 1))


def test_turns_on_the_spot_have_no_axis():
    with pytest.raises(StartError, match="axis of the turn is undefined"):
        plan([30, 0, 0], yaw(30, 1))


@pytest.mark.parametrize("begin", [(210, 0, 0), (-265, 30, -20), (20, 80, -100), (0, 0, 0)])
def test_home_is_all_axes_at_zero_without_a_turn_too_many(begin):
    angles = plan(begin, yaw(77), device_options={"home": True})
    assert angles[-1] == pytest.approx([0, 0, 0], abs=1e-3)
    travel = np.abs(np.diff(angles, axis=0)).sum(axis=0)
    assert travel == pytest.approx(np.abs(begin), abs=8)


@pytest.mark.parametrize("seconds", [None, 4.0])
def test_a_refusal_names_the_keyframe_that_lets_the_axes_turn_the_longer_way(seconds):
    """A head that turns by 160 degrees to each side, from 120 degrees on one side to the other."""
    axes = [{**AXES[0], "limits_deg": [-160, 160]}, *AXES[1:]]

    def keyframes(*angles):
        times = [None if seconds is None else seconds * k for k in range(len(angles))]
        return [replace(yaw(a), time=t) for a, t in zip(angles, times, strict=True)]

    with pytest.raises(LimitError) as caught:
        plan([0, 0, 0], *keyframes(0, 120, -120), axes=axes, approach=True)
    advice = (
        r"longer way to keyframes\[2\]: give one more keyframe before it, with yaw at 0\.0 deg$"
    )
    assert re.search(advice, str(caught.value))
    angles = plan([0, 0, 0], *keyframes(0, 120, 0, -120), axes=axes, approach=True)
    assert angles[-1] == pytest.approx([-120, 0, 0], abs=1e-3)


@pytest.mark.parametrize(
    "options", [{}, {"max_deviation_deg": 3.0}, {"allow_slews": True}], ids=str
)
def test_a_curve_that_the_axes_cannot_follow_is_refused_with_a_remedy_that_works(options):
    """The shortest turns of the tool roll it further than the range of roll."""
    angles = [(0, -60, 0), (80, 60, 0), (150, -60, 0)]
    axes = [*AXES[:2], {**AXES[2], "limits_deg": [-10, 10]}]
    keyframes = [Keyframe(tuple(from_euler("ZYX", np.radians(a)).tolist())) for a in angles]
    with pytest.raises(LimitError, match=r"reach each keyframe in a motion of its own$"):
        plan([0, -60, 0], *keyframes, axes=axes, options=options)
    here = [0.0, -60.0, 0.0]
    for keyframe in keyframes[1:]:
        here = plan(here, keyframe, axes=axes, options=options)[-1].tolist()
    assert here == pytest.approx([150.0, -60.0, 0.0], abs=0.2)


def test_endless_axes_have_one_winding_for_each_branch():
    axes = [{"id": 1, "limits_deg": "endless"}, {"id": 2}, {"id": 3, "limits_deg": "endless"}]
    options = parse({"port": "none", "axes": axes})
    last = (100.0, 0.0, -50.0)
    yaws = [yaw for yaw, _, _ in windings(options.gimbal(), (1.0, 0.0, 0.0, 0.0), last)]
    assert yaws == pytest.approx([32 * np.pi, 31 * np.pi])
