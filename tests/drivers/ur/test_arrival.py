"""A motion of an arm is done once its joints have arrived, or says how far they are behind."""

import math
import os
import random

import pytest
from fake_library import FakeRobot
from ur_rig import device_of, fault_of, recover, swing, until

from emulated_ur.arm import TICK, Arm, Tool
from orientd.daemon.device import EventKind
from orientd.driver import Setpoint
from orientd.errors import Fault

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world

CASES = int(os.environ.get("ORIENTD_CASES", "12"))
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


class Followed:
    """A driver and the model of the arm that it moves, tick by tick in virtual time."""

    def __init__(self, robot):
        self.robot, self.arm, self.slider = robot, Arm(), 1.0
        self.tool = Tool(self.arm)
        self.see()
        self.driver = robot.driver()
        self.driver.enable()
        self.forward = self.driver.mechanism(may_ask=False).forward

    def see(self):
        """Have the robot say where the model is."""
        self.tool.forget_poses()
        robot, arm = self.robot, self.arm
        robot.joints, robot.target_joints = list(arm.actual_q), list(arm.target_q)
        robot.pose, robot.target_pose = map(self.tool.pose, ("actual_TCP_pose", "target_TCP_pose"))
        robot.scaling = self.slider

    def tick(self, goal):
        """Send joints as a setpoint, with the options that the driver sends, for one tick."""
        self.see()
        self.driver.clock.advance(round(1e9 * TICK))
        self.driver.read()
        q, position = self.forward(goal)
        self.driver.write(Setpoint(0, q, position=position))
        *_, lookahead, gain = self.robot.called("servoL")[-1]
        self.robot.calls.clear()
        self.arm.servo(goal, lookahead=lookahead, gain=gain)
        assert self.arm.step(self.slider) is None


@pytest.mark.real
def test_random_motions_arrive_at_any_lookahead_and_slider(monkeypatch):
    generator = random.Random(int(os.environ.get("ORIENTD_SEED", "3")))
    it = Followed(FakeRobot().install(monkeypatch))
    for case in range(CASES):
        it.slider = generator.choice((1.0, 0.5, 0.25, 0.1))
        options = {"lookahead": generator.uniform(0.03, 0.2)}
        it.driver.tune(options)
        start = it.arm.target_q
        turn = [generator.uniform(-0.4, 0.4) for _ in start]
        seconds = generator.uniform(0.6, 1.5)
        for k in range(1, math.ceil(seconds / (TICK * it.slider)) + 1):
            share = 0.5 - 0.5 * math.cos(math.pi * min(1.0, k * TICK * it.slider / seconds))
            goal = tuple(q + share * t for q, t in zip(start, turn, strict=True))
            it.tick(goal)
        waited = 0.0
        while any(abs(one.gap) > one.tolerance for one in it.driver.gaps()):
            assert waited < it.driver.gaps()[0].patience, (case, it.slider, options)
            it.tick(goal)
            waited += TICK
        assert farthest(it.arm.actual_q, goal) < 2.1 * TOLERANCE
