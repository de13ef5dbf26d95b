"""The emulated controller's states, program and arm, tick by tick, without a socket."""

import math

import pytest

from emulated_ur import dashboard
from emulated_ur.arm.arm import HOME, Arm, Breach, Mode
from emulated_ur.arm.models import MODELS, version_of
from emulated_ur.controller import Behaviour, Controller, RefusedError
from emulated_ur.server import Server
from emulated_ur.variables import ProgramState, RobotMode, SafetyMode

SCRIPT = """def control():
  # Commands in registers, as client libraries upload it.
  global reg_offset = # register offset
0  global target = [0, 0, 0, 0, 0, 0]
  global how = [0.002, 0.1, 300]
  global servo_thread = 0

  def numbers(first):
    x = p[0, 0, 0, 0, 0, 0]
    i = 0
    while i < 6:
      x[i] = read_input_float_register(first + i + reg_offset)
      i = i + 1
    end
    return x
  end

  thread servo():
    while True:
      enter_critical
      q = target
      t = how
      exit_critical
      servoj(q, t=t[0], lookahead_time=t[1], gain=t[2])
    end
  end

  def q_of(pose):
    return [pose[0], pose[1], pose[2], pose[3], pose[4], pose[5]]
  end

  write_output_integer_register(0 + reg_offset, 1)
  is_done = False
  while True:
    cmd = read_input_integer_register(0 + reg_offset)
    if cmd == 255:
      break
    elif cmd == 24:
      target = get_inverse_kin(numbers(0))
      n = 0
      while n < 3:
        how[n] = read_input_float_register(8 + n + reg_offset)
        n = n + 1
      end
      if servo_thread == 0:
        servo_thread = run servo()
      end
    elif cmd == 0:
      is_done = False
      write_output_integer_register(0 + reg_offset, 1)
    elif not is_done:
      if cmd == 1:
        movej(q_of(numbers(0)), v=read_input_float_register(6), a=read_input_float_register(7))
      elif cmd == 16:
        kill servo_thread
        servo_thread = 0
        stopl(read_input_float_register(0))
      elif cmd == 35:
        rtde_set_watchdog("input_int_register_0", read_input_float_register(0), "stop")
      elif cmd == 10:
        speedl(numbers(0), read_input_float_register(6))
      elif cmd == 6:
        force_mode(numbers(0), numbers(0), numbers(0), 2, numbers(0))
      end
      is_done = True
      write_output_integer_register(0 + reg_offset, 2)
    end
    sync()
  end
end
"""

NONE, MOVE_J, FORCE, SPEED_L, SERVO_STOP, SERVO_L, SET_WATCHDOG, STOP_SCRIPT = (
    0, 1, 6, 10, 16, 24, 35, 255,
)  # fmt: skip


@pytest.mark.parametrize("text", ["abc", "5", "5.-1", "5.12.6.0.0", f"5.{1 << 32}", "3.15"])
def test_software_that_there_is_not_is_refused(text):
    with pytest.raises(ValueError, match=f"a UR5e has no PolyScope '{text}'"):
        version_of(MODELS["ur5e"], text)


def test_no_address_is_not_every_address_of_the_machine():
    with pytest.raises(OSError, match="must be an address of this machine"):
        Server("")


@pytest.fixture
def robot():
    return playing(Controller(Behaviour(unlock_after=0.1)))


def playing(robot):
    robot.upload(SCRIPT)
    tick(robot, 11)
    assert robot.runtime_state is ProgramState.PLAYING
    return robot


def tick(robot, count=1):
    for _ in range(count):
        robot.tick()


def order(robot, number, *numbers):
    """Write a command as a client does, and run the tick that sees it."""
    names = [f"input_double_register_{n}" for n in range(len(numbers))]
    robot.write_package(["input_int_register_0", *names], [int(number), *numbers])
    tick(robot)


def servo(robot, pose, *, time=0.002, lookahead=0.1, gain=300.0):
    order(robot, SERVO_L, *pose, 0.0, 0.0, time, lookahead, gain)


def shifted(robot, dz):
    x, y, z, *turn = robot.tool.pose("target_TCP_pose")
    return (x, y, z + dz, *turn)


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


def test_program_plays_after_its_upload_and_is_ready(robot):
    assert robot.value("output_int_register_0") == 1


def test_answered_command_is_done_until_cleared(robot):
    order(robot, MOVE_J, *HOME, 1.0, 1.0)
    assert robot.value("output_int_register_0") == 2
    order(robot, NONE)
    assert robot.value("output_int_register_0") == 1


def test_servo_moves_the_arm_to_the_pose(robot):
    goal = shifted(robot, -0.05)
    servo(robot, goal)
    tick(robot, 2500)
    assert robot.tool.pose("actual_TCP_pose") == pytest.approx(goal, abs=1e-6)


def test_servo_thread_latches_a_target_for_its_time(robot):
    first, second = shifted(robot, -0.01), shifted(robot, -0.02)
    servo(robot, first, time=0.02)
    goals = []
    for _ in range(12):
        servo(robot, second, time=0.02)
        goals.append(robot.arm._goal)
    assert goals[0] == pytest.approx(robot.tool.find_joints(first), abs=1e-9)
    assert len(set(goals)) == 2
    assert goals[-1] == pytest.approx(robot.tool.find_joints(second), abs=1e-9)


def test_pose_out_of_reach_ends_the_program(robot):
    servo(robot, (3.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert robot.runtime_state is ProgramState.STOPPED
    assert "no solution" in robot.log[-1]


@pytest.mark.parametrize(
    "number", [NONE, MOVE_J, FORCE, SPEED_L, SERVO_STOP, SERVO_L, SET_WATCHDOG]
)
@pytest.mark.parametrize("value", [math.nan, math.inf, 1e308])
def test_a_command_with_no_number_moves_nothing_and_may_end_the_program_alone(robot, number, value):
    before = robot.arm.actual_q
    order(robot, number, *[value] * 18)
    tick(robot, 5)
    assert robot.arm.actual_q == pytest.approx(before)


@pytest.mark.parametrize(("lookahead", "gain"), [(0.0, 300.0), (-0.1, 300.0), (0.1, -1e5)])
def test_servo_without_lookahead_or_gain_ends_the_program(robot, lookahead, gain):
    servo(robot, shifted(robot, 0.0), lookahead=lookahead, gain=gain)
    assert robot.runtime_state is ProgramState.STOPPED


@pytest.mark.parametrize(("number", "why"), [("1e999", "program refused"), ("1e308", "expected 6")])
def test_program_with_no_number_moves_nothing(robot, number, why):
    robot.upload(f"def p():\n  movej([{number}, 0, 0, 0, 0, 0])\nend\n")
    tick(robot, 20)
    assert why in robot.log[-1]
    assert robot.arm.target_q == HOME


def test_program_that_names_a_register_that_is_not_there_ends(robot):
    robot.upload("def p():\n  write_output_integer_register(99, 1)\nend\n")
    tick(robot, 11)
    assert robot.runtime_state is ProgramState.STOPPED


def test_servo_stop_brakes_then_is_done(robot):
    servo(robot, shifted(robot, -0.05))
    tick(robot, 20)
    order(robot, SERVO_STOP, 10.0)
    assert robot.value("output_int_register_0") == 1
    while robot.value("output_int_register_0") != 2:
        tick(robot)
    assert robot.arm.is_still


def test_stop_script_ends_the_program(robot):
    tick(robot, 50)
    order(robot, STOP_SCRIPT)
    assert robot.runtime_state is ProgramState.STOPPED


def test_watchdog_ends_the_program_when_nobody_writes(robot):
    order(robot, SET_WATCHDOG, 10.0)
    for _ in range(100):
        order(robot, NONE)
    assert robot.runtime_state is ProgramState.PLAYING
    tick(robot, 49)
    assert robot.runtime_state is ProgramState.PLAYING
    tick(robot, 3)
    assert robot.runtime_state is ProgramState.STOPPED


def test_upper_registers_are_used_where_the_script_says():
    robot = Controller()
    robot.upload(SCRIPT.replace("\n0  global", "\n24  global"))
    tick(robot, 11)
    assert (robot.value("output_int_register_0"), robot.value("output_int_register_24")) == (0, 1)


@pytest.mark.parametrize(
    "leaves", [ProgramState.PAUSED, ProgramState.PLAYING, ProgramState.STOPPED]
)
def test_protective_stop_leaves_the_program_as_configured(leaves):
    robot = playing(Controller(Behaviour(protective_stop_leaves=leaves)))
    servo(robot, shifted(robot, -0.05))
    tick(robot, 20)
    robot.enter(SafetyMode.PROTECTIVE_STOP)
    tick(robot, 50)
    assert (robot.safety_mode, robot.runtime_state) == (SafetyMode.PROTECTIVE_STOP, leaves)
    assert robot.arm.is_still


def test_unlock_is_refused_at_first_and_granted_later(robot):
    robot.enter(SafetyMode.PROTECTIVE_STOP)
    with pytest.raises(RefusedError, match="until 5s after"):
        robot.unlock_protective_stop()
    tick(robot, 48)
    with pytest.raises(RefusedError, match="until 5s after"):
        robot.unlock_protective_stop()
    tick(robot, 3)
    robot.unlock_protective_stop()
    assert robot.safety_mode is SafetyMode.NORMAL


def test_joint_over_its_limit_is_a_protective_stop(robot):
    robot.arm.speed_limits[4] = 0.01
    x, y, z, *_ = robot.tool.pose("target_TCP_pose")
    servo(robot, (x, y, z, 2.0, 2.2, 0.1))
    tick(robot, 20)
    assert robot.safety_mode is SafetyMode.PROTECTIVE_STOP
    assert "joint 5 speed" in robot.log[0]


def test_emergency_stop_takes_the_power_until_released_and_powered(robot):
    robot.enter(SafetyMode.ROBOT_EMERGENCY_STOP)
    assert (robot.robot_mode, robot.runtime_state) == (RobotMode.POWER_OFF, ProgramState.STOPPED)
    robot.power_on()
    assert robot.robot_mode is RobotMode.POWER_OFF
    robot.release()
    robot.power_on()
    tick(robot, 51)
    assert robot.robot_mode is RobotMode.IDLE
    robot.release_brakes()
    tick(robot, 51)
    assert robot.can_move


def test_safeguard_pauses_and_play_resumes(robot):
    robot.enter(SafetyMode.SAFEGUARD_STOP)
    assert robot.runtime_state is ProgramState.PAUSED
    with pytest.raises(RefusedError):
        robot.play()
    robot.release()
    robot.play()
    assert robot.runtime_state is ProgramState.PLAYING


def test_local_control_ignores_uploads():
    robot = Controller()
    robot.is_remote = False
    robot.upload(SCRIPT)
    tick(robot, 20)
    assert robot.runtime_state is ProgramState.STOPPED


def test_second_upload_replaces_the_first(robot):
    before = robot.program
    playing(robot)
    assert robot.program is not before


def test_slider_reaches_the_scaling_gradually(robot):
    robot.set_slider(0.5)
    tick(robot, 10)
    assert 0.5 < robot.speed_scaling < 1.0
    tick(robot, 300)
    assert robot.speed_scaling == pytest.approx(0.5)


def test_move_j_ends_on_its_target(robot):
    goal = tuple(angle + 0.1 for angle in HOME)
    order(robot, MOVE_J, *goal, 1.0, 2.0)
    while robot.value("output_int_register_0") != 2:
        tick(robot)
    tick(robot)
    assert robot.arm.target_q == pytest.approx(goal, abs=1e-12)


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("PolyscopeVersion", "URSoftware 5.12.6.1102099 (Oct 13 2022)"),
        ("get serial number", "20235500123"),
        ("robotmode", "Robotmode: RUNNING"),
        ("safetymode", "Safetymode: NORMAL"),
        ("running", "Program running: true"),
        ("programState", "PLAYING <unnamed>"),
        ("is in remote control", "true"),
        ("pause", "Pausing program"),
        ("stop", "Stopped"),
        ("load a.urp", "Loading program: a.urp"),
        ("unlock protective stop", "Protective stop releasing"),
        ("nonsense", "could not understand: nonsense"),
    ],
)
def test_dashboard_answers_as_clients_expect(robot, line, answer):
    assert dashboard.reply(robot, line + "\n") == answer


def test_dashboard_refuses_in_local_control(robot):
    robot.is_remote = False
    assert dashboard.reply(robot, "play").startswith("Command is not allowed")
    assert dashboard.reply(robot, "is in remote control") == "false"


def test_stiff_servo_reaches_each_command_in_a_cycle():
    arm = Arm((0.0,) * 6, smooths_servo=False)
    for goal in (0.004, 0.001):
        arm.servo((goal,) * 6, lookahead=0.1, gain=300.0)
        assert arm.step(1.0) is None
        assert arm.target_q == pytest.approx((goal,) * 6)
