"""The judge finds each kind of violation, and nothing where there is none."""

import math

import pytest
from judge import Judge, judged

from orientd.driver import AxisLimits, Setpoint

PERIOD_NS = 2_000_000
LIMITS = {"velocity": 1.0, "acceleration": 10.0, "jerk": 1000.0, "linear_velocity": 0.5}
YAW = AxisLimits("yaw", -1.0, 1.0, 1.5, 12.0)


class Sent:
    """Setpoints about one axis, sent to a judge in time."""

    def __init__(self):
        self.found, self.now_ns, self.angle, self.speed = [], 10**9, 0.0, 0.0
        self.difference = 0.0  # of the pose from that of the axis, rad
        self.judge = Judge(LIMITS, PERIOD_NS * 1e-9, self.found.append)
        self.judge.axes = (YAW,)
        self.take()

    def take(self, position=(0.0, 0.0, 0.0)):
        self.now_ns += PERIOD_NS
        angle = self.angle + self.difference
        q = (math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle))
        self.judge.take(self.now_ns, q, position, (self.angle,))

    def speed_up(self, speed, *, jerk=900.0):
        """Come to a speed as fast as a jerk allows, up to an acceleration of 9 rad/s^2."""
        sign, rate, h = math.copysign(1.0, speed - self.speed), 0.0, PERIOD_NS * 1e-9
        while sign * (speed - self.speed) > 1e-9:
            # As much as is left to shed the acceleration by the same jerk, step by step.
            left = sign * (speed - self.speed)
            most = math.sqrt(2.0 * jerk * left + 0.25 * (jerk * h) ** 2) - 0.5 * jerk * h
            rate = max(min(rate + jerk * h, 9.0, most, left / h), min(1e-3, left / h))
            self.speed += sign * rate * h
            self.turn()
        self.turn()

    def turn(self, seconds=0.0):
        for _ in range(max(1, round(seconds * 1e9 / PERIOD_NS))):
            self.angle += self.speed * PERIOD_NS * 1e-9
            self.take()


@pytest.fixture
def sent():
    return Sent()


def test_motion_within_the_limits_from_rest_to_rest_is_in_order(sent):
    sent.speed_up(0.9)
    sent.turn(0.3)
    sent.speed_up(0.0)
    sent.judge.let_go(sent.now_ns)
    assert sent.found == []
    assert 0.85 < sent.judge.peaks["velocity"] <= 1.0
    assert 8.5 < sent.judge.peaks["acceleration"] <= 10.0


def test_each_limit_of_the_tool_is_looked_at(sent):
    sent.speed_up(1.1)
    assert any(one.startswith("velocity 1.0") for one in sent.found)
    assert not any(one.startswith("acceleration") for one in sent.found)
    sent.found.clear()
    sent.speed = 1.12
    sent.turn()
    assert any(one.startswith("jerk 5") for one in sent.found)


def test_axes_and_their_ranges_are_looked_at(sent):
    sent.speed_up(0.9)
    sent.turn(1.2)
    assert sent.found[0].startswith("yaw at 1.00")
    sent.speed = -1.6
    sent.turn()
    assert any(one.startswith("velocity of yaw -1.6") for one in sent.found)


def test_a_device_with_a_fault_comes_to_rest_and_stays(sent):
    sent.speed_up(0.5)
    sent.judge.fail(sent.now_ns)
    sent.turn(0.5)
    sent.speed_up(0.0)
    assert sent.found == []
    sent.speed_up(0.1)
    assert sent.found[0].startswith("moves after a fault")


def test_an_axis_that_turns_after_a_fault_is_found_though_its_pose_stands(sent):
    sent.judge.fail(sent.now_ns)
    sent.turn()
    sent.angle, sent.difference = 1e-8, -1e-8
    sent.turn()
    assert sent.found == ["moves after a fault at 5e-06 rad/s"]


def recorded(gap_ns=0, *, rest=0):
    """Return setpoints at a constant speed of 0.5 rad/s, with a gap after the 21st."""
    times = [10**9 + k * PERIOD_NS + (gap_ns if k > 20 else 0) for k in range(40)]
    angles = [0.001 * (k - rest * (k > 20 - rest)) for k in range(40)]
    q = [(math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)) for angle in angles]
    return [Setpoint(at, one) for at, one in zip(times, q, strict=True)]


@pytest.mark.parametrize("rest", [0, 1])
def test_motion_from_rest_after_a_gap_is_a_rest_and_not_a_jump_of_the_speed(rest):
    setpoints = recorded(100_000_000, rest=rest)
    _, judge = judged(setpoints, {}, PERIOD_NS * 1e-9, is_moving=True)
    assert judge.rests == 1 + rest


def test_motion_that_goes_on_behind_a_late_cycle_is_judged_as_motion():
    setpoints = recorded(60_000_000)
    found, judge = judged(setpoints, LIMITS, PERIOD_NS * 1e-9, is_moving=True)
    assert (found, judge.rests) == ([], 0)
    setpoints[21] = setpoints[21]._replace(q=setpoints[26].q)
    assert judged(setpoints, LIMITS, PERIOD_NS * 1e-9, is_moving=True)[0]


def test_numbers_that_are_none_are_found():
    setpoints = recorded()
    setpoints[30] = setpoints[30]._replace(q=(math.nan, 0.0, 0.0, 0.0))
    found, _ = judged(setpoints, LIMITS, PERIOD_NS * 1e-9, is_moving=True)
    assert "velocity nan, at most 1" in found
