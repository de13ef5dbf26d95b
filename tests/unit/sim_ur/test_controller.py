"""The emulated controller's states and arm, tick by tick, without a socket."""

import math

import pytest

from emulated_ur.arm.arm import Arm, Breach, Mode
from emulated_ur.arm.models import MODELS, version_of
from emulated_ur.controller import Behaviour, Controller
from emulated_ur.server import Server
from emulated_ur.variables import ProgramState, SafetyMode


@pytest.mark.parametrize("text", ["abc", "5", "5.-1", "5.12.6.0.0", f"5.{1 << 32}", "3.15"])
def test_software_that_there_is_not_is_refused(text):
    with pytest.raises(ValueError, match=f"a UR5e has no PolyScope '{text}'"):
        version_of(MODELS["ur5e"], text)


def test_no_address_is_not_every_address_of_the_machine():
    with pytest.raises(OSError, match="must be an address of this machine"):
        Server("")


@pytest.fixture
def robot():
    return playing(Controller())


def playing(robot):
    robot.upload("def p():\n  sleep(9)\nend\n")
    tick(robot, 11)
    assert robot.runtime_state is ProgramState.PLAYING
    return robot


def tick(robot, count=1):
    for _ in range(count):
        robot.tick()


@pytest.mark.parametrize("gain", [100.0, 300.0, 2000.0])
@pytest.mark.parametrize("lookahead", [0.03, 0.1, 0.2])
def test_servo_follows_a_ramp_with_a_lag_of_the_lookahead(lookahead, gain):
    arm, rate = Arm((0.0,) * 6), 0.5
    for k in range(2000):
        arm.servo((rate * 0.002 * k,) * 6, lookahead=lookahead, gain=gain)
        assert arm.step(1.0) is None
    lag = (rate * 0.002 * 1999 - arm.target_q[0]) / rate
    # A tick goes by between setting a goal and stepping towards it.
    assert lag == pytest.approx(lookahead, abs=0.0025)
    assert arm.actual_qd[0] == pytest.approx(rate, rel=1e-6)


def test_half_speed_doubles_the_lag():
    arm, rate = Arm((0.0,) * 6), 0.5
    for k in range(3000):
        arm.servo((rate * 0.002 * k,) * 6, lookahead=0.1, gain=300.0)
        arm.step(0.5)
    assert (rate * 0.002 * 2999 - arm.target_q[0]) / rate == pytest.approx(0.2, abs=0.0025)


def test_fast_joint_is_clamped_and_reported():
    arm = Arm((0.0,) * 6)
    arm.servo((0.0, 0.0, 3.0, 0.0, 0.0, 0.0), lookahead=0.03, gain=2000.0)
    breach = arm.step(1.0)
    assert isinstance(breach, Breach)
    assert (breach.joint, breach.quantity, breach.limit) == (2, "speed", math.pi)
    assert arm.target_qd[2] == math.pi


def test_braking_arm_comes_to_rest_with_all_joints_at_once():
    arm = Arm((0.0,) * 6)
    arm.turn((0.5, 1.0, 0, 0, 0, 0), acceleration=100.0)
    for _ in range(10):
        arm.step(1.0)
    arm.brake(10.0)
    ratios = []
    while not arm.is_still:
        arm.step(1.0)
        if arm.target_qd[1]:
            ratios.append(arm.target_qd[0] / arm.target_qd[1])
    assert ratios == pytest.approx([0.5] * len(ratios))
    assert arm.mode is Mode.HOLD


def test_stiff_servo_reaches_each_command_in_a_cycle():
    arm = Arm((0.0,) * 6, smooths_servo=False)
    for goal in (0.004, 0.001):
        arm.servo((goal,) * 6, lookahead=0.1, gain=300.0)
        assert arm.step(1.0) is None
        assert arm.target_q == pytest.approx((goal,) * 6)


@pytest.mark.parametrize(
    "leaves", [ProgramState.PAUSED, ProgramState.PLAYING, ProgramState.STOPPED]
)
def test_protective_stop_leaves_the_program_as_configured(leaves):
    robot = playing(Controller(Behaviour(protective_stop_leaves=leaves)))
    robot.enter(SafetyMode.PROTECTIVE_STOP)
    tick(robot, 50)
    assert (robot.safety_mode, robot.runtime_state) == (SafetyMode.PROTECTIVE_STOP, leaves)


def test_slider_reaches_the_scaling_gradually(robot):
    robot.set_slider(0.5)
    tick(robot, 10)
    assert 0.5 < robot.speed_scaling < 1.0
    tick(robot, 300)
    assert robot.speed_scaling == pytest.approx(0.5)
