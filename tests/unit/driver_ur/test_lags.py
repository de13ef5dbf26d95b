"""How far an arm lags behind its commands, at any lookahead and slider of the emulated arm."""

import math
import os
import random

import numpy as np
import pytest

from emulated_dynamixel import ManualClock
from emulated_ur.arm import TICK, Arm, Tool
from orientd.driver import Setpoint
from orientd_ur import UrDriver

CASES = int(os.environ.get("ORIENTD_CASES", "12"))
FOLLOWED = math.radians(5.0)
ARRIVED = math.radians(0.5)


class ArmLink:
    """The driver's link to the emulated arm, which it moves without a controller."""

    has_control = False

    def __init__(self):
        self.arm, self.slider, self.ticks, self.goal = Arm(), 1.0, 0, ()
        self._tool = Tool(self.arm)

    def require(self):
        """Do nothing: this link is never lost."""

    require_same = require

    def timestamp(self):
        return self.ticks * TICK

    def commanded(self):
        return self.arm.target_q, self._tool.pose("target_TCP_pose")

    def motion(self):
        pose, speed = map(self._tool.pose, ("actual_TCP_pose", "actual_TCP_speed"))
        return pose, speed, self.arm.actual_q, self.arm.target_q, self.slider

    def tell(self, _name, _pose, _speed, _acceleration, _time, lookahead, gain):
        """Servo to the goal, whose pose it is, for one tick."""
        self.arm.servo(self.goal, lookahead=lookahead, gain=gain)
        assert self.arm.step(self.slider) is None
        self.ticks += 1
        self._tool.forget_poses()
        return True


class Followed:
    """A driver and the emulated arm that it moves, tick by tick."""

    def __init__(self):
        options = {"host": "127.0.0.9", "model": "ur5e"}
        self.driver = UrDriver(options, period_ns=round(1e9 * TICK), clock=ManualClock(10**9))
        self.driver._link = self.link = ArmLink()
        self.arm, self._forward = self.link.arm, self.driver.mechanism(may_ask=False).forward

    def tick(self, goal):
        """Send joints as a setpoint, with the options that the driver sends."""
        self.link.goal = goal
        q, position = self._forward(goal)
        self.driver.clock.advance(self.driver.period_ns)
        self.driver.write(Setpoint(0, q, position=position))
        self.driver.read()


def test_random_motions_arrive_at_any_lookahead_and_slider():
    generator = random.Random(int(os.environ.get("ORIENTD_SEED", "3")))
    it = Followed()
    for case in range(CASES):
        slider = it.link.slider = generator.choice((1.0, 0.5, 0.25, 0.1))
        options = {"lookahead": generator.uniform(0.03, 0.2)}
        it.driver.tune(options)
        start = it.arm.target_q
        turn = [generator.uniform(-0.4, 0.4) for _ in start]
        seconds = generator.uniform(0.6, 1.5)
        for k in range(1, math.ceil(seconds / (TICK * slider)) + 1):
            share = 0.5 - 0.5 * math.cos(math.pi * min(1.0, k * TICK * slider / seconds))
            goal = tuple(q + share * t for q, t in zip(start, turn, strict=True))
            it.tick(goal)
        waited = 0.0
        while any(abs(one.gap) > one.tolerance for one in it.driver.gaps()):
            assert waited < it.driver.gaps()[0].patience, (case, slider, options)
            it.tick(goal)
            waited += TICK
        assert np.max(np.abs(np.subtract(it.arm.actual_q, goal))) < 2.1 * ARRIVED


@pytest.mark.parametrize("lookahead", [0.03, 0.2])
@pytest.mark.parametrize("slider", [1.0, 0.3, 0.1])
def test_quickest_motions_of_all_joints_stay_far_from_the_tolerance(lookahead, slider):
    """At 3 rad/s and 40 rad/s^2, with changes of the slider in between."""
    it = Followed()
    it.driver.tune({"lookahead": lookahead, "gain": 2000.0})
    start = np.array(it.arm.target_q)
    largest = place = rate = 0.0
    for k in range(1200):
        it.link.slider = slider if k % 500 < 250 else 1.0
        wanted = 3.0 if k % 400 < 200 else -3.0
        change = 40.0 * TICK * it.link.slider
        rate += max(-change, min(change, wanted - rate))
        place += rate * TICK * it.link.slider
        it.tick(tuple(start + place * np.array([1, -1, 1, -1, 1, -1])))
        pairs = zip(it.arm.target_q, it.arm.actual_q, strict=True)
        largest = max(largest, *(abs(a - b) for a, b in pairs))
    assert math.radians(0.1) < largest < FOLLOWED / 4
