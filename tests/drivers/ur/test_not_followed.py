"""A joint that is held or pushed is a fault, and nothing catches up when it comes free."""

import math

import pytest
from ur_rig import device_of, fault_of, is_holding, recover, streaming, swing, until

from orientd.errors import Fault

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world

TOLERANCE = math.radians(5.0)
NEAR = math.radians(0.5)
WRIST_3 = 5


def gap_of(state):
    return abs(state["target_q"][WRIST_3] - state["actual_q"][WRIST_3])


def stands_after(robot, device, how):
    """Check that wrist 3 does not follow, then that it stands when it comes free."""
    robot.ask(how)
    fault, text, _ = fault_of(device)
    assert fault is Fault.DEVICE_FAULT
    assert text.startswith("joint wrist 3 does not follow: it is ")
    assert float(text.split("it is ")[1].split(" deg")[0]) > math.degrees(TOLERANCE)
    held = robot.wait_until(lambda s: s["runtime_state"] == "STOPPED" and s["is_still"])
    assert gap_of(held) < NEAR
    robot.ask("unblock 6")
    free = robot.wait_until(lambda s: s["ticks"] > held["ticks"] + 250)
    moved = max(abs(a - b) for a, b in zip(held["actual_q"], free["actual_q"], strict=True))
    assert moved < NEAR
    recover(device)


def test_joint_that_is_held_in_motion_is_a_fault_and_does_not_catch_up(ur_robot):
    with device_of(ur_robot.host) as device:
        swing(device, angle=0.8, seconds=4.0)
        streaming(device)
        stands_after(ur_robot, device, "block 6")


@pytest.mark.parametrize("angle", [0.3, -0.3])
def test_joint_that_is_pushed_in_a_pause_is_a_fault_and_does_not_go_back(ur_robot, angle):
    with device_of(ur_robot.host) as device:
        swing(device)
        streaming(device)
        device.pause()
        until(lambda: device.snapshot().cycle.speed == 0.0, "a pause")
        ur_robot.wait_until(lambda s: s["is_still"])
        stands_after(ur_robot, device, f"block 6 {angle}")


def test_joint_that_is_pushed_at_rest_is_a_fault(ur_robot):
    with device_of(ur_robot.host) as device:
        stands_after(ur_robot, device, "block 6 0.2")


def test_joint_that_is_pushed_a_little_comes_back(ur_robot):
    with device_of(ur_robot.host) as device:
        ur_robot.ask("block 6 0.05")
        pushed = ur_robot.wait_until(lambda s: gap_of(s) > 0.04)
        ur_robot.wait_until(lambda s: s["ticks"] > pushed["ticks"] + 250)
        ur_robot.ask("unblock 6")
        ur_robot.wait_until(lambda s: gap_of(s) < 1e-3)
        assert is_holding(device)


def test_tolerance_is_an_option(ur_robot):
    with device_of(ur_robot.host, follow_tolerance_deg=20) as device:
        ur_robot.ask("block 6 0.3")
        pushed = ur_robot.wait_until(lambda s: gap_of(s) > 0.29)
        ur_robot.wait_until(lambda s: s["ticks"] > pushed["ticks"] + 250)
        assert is_holding(device)


def test_quick_motion_is_followed_at_a_tenth_of_the_speed(ur_robot):
    with device_of(ur_robot.host) as device:
        ur_robot.ask("slider 0.1")
        swing(device, angle=0.3, seconds=0.95)
        until(lambda: not is_holding(device), "motion")
        until(lambda: is_holding(device), lambda: f"the end {device.snapshot()}", 60.0)
        assert device.snapshot().fault is Fault.NONE
