"""A motion of an arm is done once its joints have arrived, or says how far they are behind."""

import math

import pytest
from ur_rig import device_of, fault_of, recover, swing, until

from orientd.daemon.device import EventKind
from orientd.errors import Fault

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world

TOLERANCE = math.radians(0.5)


def end_of(device, events, number):
    """Wait until motion *number* has ended; return its event."""
    ends = EventKind.MOTION_DONE, EventKind.MOTION_STOPPED

    def found():
        device.snapshot()
        return [one for one in events if one.kind in ends and one.motion_number == number]

    return until(found, lambda: f"the end of motion {number} in {events}", 30.0)[0]


def farthest(a, b):
    return max(abs(x - y) for x, y in zip(a, b, strict=True))


def test_motion_is_done_only_once_the_joints_have_arrived(ur_robot):
    events = []
    with device_of(ur_robot.host, on_event=events.append, lookahead=0.2) as device:
        queued = swing(device, angle=0.4, seconds=1.2)
        assert end_of(device, events, queued.number).kind is EventKind.MOTION_DONE
        done = ur_robot.state()["actual_q"]
        ur_robot.wait_until(lambda s: max(map(abs, difference_of(s))) < 1e-6)
        assert farthest(done, ur_robot.state()["target_q"]) < 1.05 * TOLERANCE


def difference_of(state):
    return [a - b for a, b in zip(state["target_q"], state["actual_q"], strict=True)]


def test_joint_that_does_not_arrive_is_named_with_how_far_it_is_behind(ur_robot):
    events = []
    with device_of(ur_robot.host, on_event=events.append, follow_tolerance_deg=60) as device:
        begun = ur_robot.state()
        queued = swing(device, angle=0.3, seconds=2.0)
        until(lambda: device.snapshot().path_time > 0.9, "the turning point")
        ur_robot.ask("block 6")
        ended = end_of(device, events, queued.number)
        assert ended.kind is EventKind.MOTION_STOPPED
        fault, text, _ = fault_of(device)
        assert fault is Fault.DEVICE_FAULT
        assert "joint wrist 3 has not arrived: it is " in text
        behind = float(text.split("it is ")[1].split(" deg")[0])
        # The motion ends where it began.
        off = math.degrees(abs(begun["actual_q"][5] - ur_robot.state()["actual_q"][5]))
        assert behind == pytest.approx(off, abs=0.1)
        assert behind > 3.0
        ur_robot.ask("unblock 6")
        recover(device)


def test_tolerance_is_an_option(ur_robot):
    events = []
    with device_of(ur_robot.host, on_event=events.append, arrival_tolerance_deg=10) as device:
        ur_robot.ask("block 6")
        queued = swing(device, angle=0.02, seconds=0.8)
        assert end_of(device, events, queued.number).kind is EventKind.MOTION_DONE
