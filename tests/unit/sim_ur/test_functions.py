"""Functions of URScript against calculations of their own, and motions, in virtual time."""

import math
import socket
import struct
import threading

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from emulated_ur import Behaviour, Controller, dashboard
from emulated_ur.arm import from_pose, to_pose
from emulated_ur.arm.arm import HOME
from emulated_ur.arm.kinematics import Kinematics
from emulated_ur.arm.models import MODELS
from emulated_ur.controller import RefusedError
from emulated_ur.primary import state_message, version_message
from emulated_ur.urscript import Array, Pose
from emulated_ur.variables import ProgramState, RobotMode, SafetyMode

A = (0.1, -0.2, 0.3, 0.4, -0.5, 0.6)
B = (-0.4, 0.5, 0.6, -1.1, 0.3, 0.2)


@pytest.fixture
def robot():
    return Controller(Behaviour(program_start=0.002))


@pytest.fixture
def call(robot):
    """Call a function as a program does; what takes time is none of these."""
    robot.upload("def p():\n  sleep(1000)\nend\n")
    tick(robot, 3)
    return lambda name, *arguments: robot.program.functions.table()[name](*arguments)


def tick(robot, count):
    for _ in range(count):
        robot.tick()


def run(robot, body, ticks=1000):
    robot.upload("def test():\n" + body + "\nend\n")
    tick(robot, ticks)


def turn(pose):
    return Rotation.from_rotvec(pose[3:])


@pytest.mark.parametrize(
    "rotvec",
    [(0.3, -0.2, 0.1), (3.0, 0.2, -0.1), (0.1, 3.0, 0.2), (-0.2, 0.1, 3.0), (0.0, -3.1, 0.1),
     (math.pi, 0.0, 0.0), (0.0, 0.0, -3.1)],
)  # fmt: skip
def test_transform_is_that_of_the_rotation_vector(rotvec):
    rows = np.reshape(from_pose((1.0, 2.0, 3.0, *rotvec)), (3, 4))
    assert rows[:, :3] == pytest.approx(Rotation.from_rotvec(rotvec).as_matrix(), abs=1e-12)
    assert to_pose(tuple(rows.ravel())) == pytest.approx((1.0, 2.0, 3.0, *rotvec), abs=1e-12)


@pytest.mark.parametrize("model", sorted(MODELS))
def test_each_model_is_found_again_from_every_branch(model):
    kinematics, generator = Kinematics(MODELS[model]), np.random.default_rng(3)
    for _ in range(60):
        q = generator.uniform(0.1, 2.8, 6) * generator.choice((-1, 1), 6)
        found = kinematics.inverse(kinematics.forward(q), q + generator.uniform(-0.02, 0.02, 6))
        assert max(abs(found - q)) < 0.05
        assert kinematics.forward(found) == pytest.approx(kinematics.forward(q), abs=1e-8)
        other = kinematics.inverse(kinematics.forward(q), tuple(-q))
        assert kinematics.forward(other) == pytest.approx(kinematics.forward(q), abs=1e-8)


def test_poses_are_composed(call):
    trans = call("pose_trans", A, B)
    assert trans[:3] == pytest.approx(A[:3] + turn(A).apply(B[:3]))
    assert (turn(A) * turn(B) * turn(trans).inv()).magnitude() == pytest.approx(0, abs=1e-12)
    assert call("pose_trans", A, call("pose_inv", A)) == pytest.approx((0,) * 6, abs=1e-12)
    add = call("pose_add", A, B)
    assert add[:3] == pytest.approx(np.add(A[:3], B[:3]))
    assert turn(add).as_rotvec() == pytest.approx((turn(A) * turn(B)).as_rotvec())
    sub = call("pose_sub", A, B)
    assert sub[:3] == pytest.approx(np.subtract(A[:3], B[:3]))
    assert sub[3:] == pytest.approx((turn(A) * turn(B).inv()).as_rotvec())
    assert call("pose_dist", B, A) == pytest.approx(math.hypot(*sub))
    assert call("point_dist", A, B) == pytest.approx(math.dist(A[:3], B[:3]))


@pytest.mark.parametrize("alpha", [0.0, 0.3, 1.0])
def test_poses_are_interpolated_about_one_axis(call, alpha):
    between = call("interpolate_pose", Pose(A), Pose(B), alpha)
    assert between[:3] == pytest.approx((1 - alpha) * np.array(A[:3]) + alpha * np.array(B[:3]))
    step = Rotation.from_rotvec(alpha * (turn(B) * turn(A).inv()).as_rotvec())
    assert turn(between).as_matrix() == pytest.approx((step * turn(A)).as_matrix(), abs=1e-12)


def test_wrench_is_seen_from_another_frame(call):
    force, moment = np.array([1.0, 2.0, 3.0]), np.array([0.4, -0.5, 0.6])
    seen = call("wrench_trans", Pose(A), (*force, *moment))
    back = turn(A).inv()
    assert seen[:3] == pytest.approx(back.apply(force))
    assert seen[3:] == pytest.approx(back.apply(moment - np.cross(A[:3], force)))


def test_roll_pitch_yaw_is_about_fixed_axes(call):
    vector = call("rpy2rotvec", (0.4, -0.5, 0.6))
    assert vector == pytest.approx(Rotation.from_euler("xyz", [0.4, -0.5, 0.6]).as_rotvec())
    assert call("rotvec2rpy", vector) == pytest.approx((0.4, -0.5, 0.6))


def test_numbers_lists_and_strings(call):
    assert call("log", 2.0, 8.0) == pytest.approx(3.0)
    assert call("d2r", 180) == pytest.approx(math.pi)
    assert call("normalize", Array((3, 4, 0))) == pytest.approx((0.6, 0.8, 0.0))
    assert call("integer_to_binary_list", 5)[:4] == (True, False, True, False)
    assert call("str_sub", "hello", 5) == ""
    with pytest.raises(IndexError, match="index 6 is outside 'hello'"):
        call("str_sub", "hello", 6)
    assert (call("str_at", "hello", 1), call("str_sub", "hello", 2)) == ("e", "llo")
    assert (call("str_empty", ""), call("str_find", "a", "b")) == (True, -1)
    assert call("to_num", " -7 ") == -7


def test_kinematics_of_a_program(robot, call):
    pose = call("get_forward_kin", HOME, (0, 0, 0.1, 0, 0, 0))
    assert call("get_inverse_kin", pose, HOME, 0, 0, (0, 0, 0.1, 0, 0, 0)) == pytest.approx(HOME)
    assert call("get_inverse_kin_has_solution", pose)
    assert not call("get_inverse_kin_has_solution", (3, 0, 0, 0, 0, 0))
    assert call("is_within_safety_limits", HOME)
    assert not call("is_within_safety_limits", (7, 0, 0, 0, 0, 0))
    call("set_tcp", (0, 0, 0.1, 0, 0, 0))
    assert call("get_tcp_offset")[2] == 0.1
    assert call("get_forward_kin") == pytest.approx(pose)
    assert robot.value("tcp_offset")[2] == 0.1


def test_tool_payload_and_voltage(robot, call):
    call("set_target_payload", 2.0, (0.1, 0.2, 0.3), (1, 2, 3, 4, 5, 6))
    call("set_payload_mass", 3.0)
    assert (robot.value("payload"), robot.value("payload_cog")) == (3.0, (0.1, 0.2, 0.3))
    assert call("get_target_payload_inertia") == (1, 2, 3, 4, 5, 6)
    for volt in (12, 24, 0):
        call("set_tool_voltage", volt)
        assert robot.value("tool_output_voltage") == volt
    with pytest.raises(ValueError, match="got 13"):
        call("set_tool_voltage", 13)


def test_analog_outputs_are_shares_of_their_range(robot, call):
    call("set_standard_analog_out", 0, 1.0)
    call("set_analog_outputdomain", 1, 1)
    call("set_analog_out", 1, 0.25)
    assert robot.value("analog_io_types") == 1 << 3
    assert call("get_standard_analog_out", 0) == pytest.approx(0.02)
    names = ["standard_analog_output_mask", "standard_analog_output_type",
             "standard_analog_output_0", "standard_analog_output_1"]  # fmt: skip
    robot.write_package(names, [1, 1, 0.5, 0.9])
    assert robot.value("standard_analog_output0") == 5.0
    assert robot.value("standard_analog_output1") == 2.5
    robot.write_package(["tool_digital_output_mask", "tool_digital_output"], [2, 3])
    assert robot.value("actual_digital_output_bits") == 1 << 17


def test_joint_speeds_are_taken_on_and_kept(robot):
    run(robot, "  speedj([0.2, 0, 0, 0, 0, -0.1], 1.0, 0.5)\n  textmsg(1)\n  sleep(1)", 240)
    assert robot.arm.target_qd == pytest.approx((0.2, 0, 0, 0, 0, -0.1))
    assert robot.arm.target_qd[0] / robot.arm.target_qd[5] == pytest.approx(-2.0)
    assert not robot.told
    tick(robot, 20)
    assert robot.told


def test_a_speed_is_kept_for_as_many_cycles_as_its_time_has(robot):
    run(robot, "  speedj([0.1, 0, 0, 0, 0, 0], 0.5, 0.02)\n  textmsg(1)\n  sleep(1)", 0)
    rates = []
    while not robot.told:
        robot.tick()
        rates.append(robot.arm.target_qd[0])
    assert rates[:10] == pytest.approx([0.5 * 0.002 * k for k in range(1, 11)])
    assert len(rates) == 11  # the last one said that the ten are over


def test_force_mode_turns_the_tool_about_an_axis_of_its_frame(robot):
    begun = Rotation.from_rotvec(robot.tool.pose("target_TCP_pose")[3:])
    frame, limits = "p[0,0,0,0,0,1.5707963267948966]", "[1, 1, 1, 9, 9, 9]"
    run(
        robot,
        f"  force_mode({frame}, [0,0,0,0,1,0], [0,0,0,9,0.2,9], 2, {limits})\n  sleep(9)",
        252,
    )
    turned = Rotation.from_rotvec(robot.tool.pose("target_TCP_pose")[3:]) * begun.inv()
    # Its second axis is the base's first, the other way round: 0.5 rad/s for each Nm.
    assert turned.as_rotvec() == pytest.approx((-0.5 * 0.2 * 0.5, 0, 0), abs=1e-3)


def test_somebody_moves_a_free_arm(robot):
    run(robot, "  freedrive_mode()\n  sleep(9)", 5)
    goal = tuple(angle + 0.2 for angle in HOME)
    robot.push(goal, 0.1)
    tick(robot, 25)
    assert robot.arm.target_q == pytest.approx([angle + 0.1 for angle in HOME])
    tick(robot, 75)
    assert robot.arm.actual_q == pytest.approx(goal, abs=1e-6)


def test_arm_beyond_a_range_is_a_breach(robot):
    run(robot, "  speedj([0, 0, 0, 0, 0, 3.1], 40, 9)", 1800)
    while robot.value("safety_mode") == 1 and robot.ticks < 6000:
        robot.upload("speedj([0, 0, 0, 0, 0, 3.1], 40, 9)\n")
        tick(robot, 100)
    assert robot.safety_mode is SafetyMode.PROTECTIVE_STOP
    assert "joint 6 angle" in robot.log[-1]
    assert abs(robot.arm.target_q[5]) > 2 * math.pi


def test_power_comes_step_by_step_and_not_during_a_stop(robot):
    robot.power_off()
    robot.release_brakes()
    modes = []
    for _ in range(120):
        robot.tick()
        modes.append(robot.robot_mode)
    assert list(dict.fromkeys(modes)) == [RobotMode.POWER_ON, RobotMode.IDLE, RobotMode.RUNNING]
    robot.power_off()
    robot.release_brakes()
    tick(robot, 10)
    robot.enter(SafetyMode.ROBOT_EMERGENCY_STOP)
    tick(robot, 200)
    assert robot.robot_mode is RobotMode.POWER_OFF
    assert robot.value("joint_mode") == (239,) * 6


def test_power_that_is_taken_on_its_way_stays_off(robot):
    robot.power_off()
    robot.power_on()
    tick(robot, 5)
    robot.power_off()
    tick(robot, 200)
    assert robot.robot_mode is RobotMode.POWER_OFF
    robot.power_on()
    tick(robot, 60)
    assert (robot.robot_mode, robot.value("joint_mode")) == (RobotMode.IDLE, (255,) * 6)


def test_popup_of_the_dashboard_only_tells(robot):
    dashboard.reply(robot, "popup hello")
    assert robot.events[-1] == ("popup", "hello", "Popup", (False, False, False))


def test_a_severe_state_gives_way_to_no_milder_one(robot):
    robot.enter(SafetyMode.ROBOT_EMERGENCY_STOP)
    for mode in (SafetyMode.PROTECTIVE_STOP, SafetyMode.SAFEGUARD_STOP, SafetyMode.REDUCED):
        robot.enter(mode)
        assert robot.safety_mode is SafetyMode.ROBOT_EMERGENCY_STOP
    robot.release()
    robot.enter(SafetyMode.FAULT)
    robot.release()
    assert robot.safety_mode is SafetyMode.FAULT


@pytest.mark.parametrize(
    ("line", "oldest"),
    [("is in remote control", (5, 6)), ("get robot model", (5, 6)), ("safetystatus", (5, 4)),
     ("generate flight report system", (5, 8)), ("get operational mode", (5, 6)),
     ("get serial number", (3, 12)), ("safetystatus", (3, 11))],
)  # fmt: skip
def test_older_software_does_not_understand_newer_commands(line, oldest):
    def answer(version):
        return dashboard.reply(Controller(Behaviour(version=(*version, 0, 0))), line)

    assert "could not understand" not in answer(oldest)
    assert "could not understand" in answer((oldest[0], oldest[1] - 1))


@pytest.mark.parametrize(
    ("line", "is_allowed"),
    [("play", False), ("power on", False), ("power off", False), ("brake release", False),
     ("unlock protective stop", False), ("stop", True), ("close popup", True),
     ("restart safety", True)],
)  # fmt: skip
def test_local_control_forbids_what_moves(robot, line, is_allowed):
    robot.is_remote = False
    assert (dashboard.reply(robot, line).startswith("Command is not allowed")) is not is_allowed


def test_primary_state_is_made_of_whole_parts(robot):
    message = state_message(robot, is_first=True)
    assert struct.unpack_from(">iB", message) == (len(message), 16)
    at, parts = 5, {}
    while at < len(message):
        size, kind = struct.unpack_from(">iB", message, at)
        parts[kind] = message[at + 5 : at + size]
        at += size
    assert sorted(parts) == [0, 1, 2, 3, 4, 5, 6]
    assert [len(parts[kind]) for kind in sorted(parts)] == [42, 246, 32, 69, 96, 220, 440]
    assert struct.unpack_from(">d", parts[1]) == (HOME[0],)
    assert struct.unpack_from(">6d", parts[4]) == pytest.approx(robot.value("actual_TCP_pose"))
    again = state_message(robot, is_first=False)
    assert len(again) == len(message) - len(parts[5]) - len(parts[6]) - 10
    assert version_message(robot)[4:5] == b"\x14"


class Peer(threading.Thread):
    """A server that sends lines and keeps what it is sent."""

    def __init__(self, *lines):
        super().__init__(daemon=True)
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        self.lines, self.heard = lines, b""
        self.start()

    def run(self):
        link, _ = self.listener.accept()
        self.listener.close()
        with link:
            for line in self.lines:
                link.sendall(line)
            link.settimeout(5.0)
            while chunk := link.recv(4096):
                self.heard += chunk


def until(robot, claim, ticks=20000):
    while not claim():
        robot.tick()
        assert robot.ticks < ticks, robot.log


def test_sockets_send_and_receive(robot):
    peer = Peer(b"(1.5,2,-3)", b"hello\n", struct.pack(">3i", 7, -8, 9), b"<inside>", b"42\n")
    robot.upload(
        "def p():\n"
        f'  if socket_open("127.0.0.1", {peer.port}):\n'
        "    textmsg(socket_read_ascii_float(3, timeout=0))\n"
        "    textmsg(socket_read_line(timeout=0))\n"
        "    textmsg(socket_read_binary_integer(3, timeout=0))\n"
        '    textmsg(socket_read_string(prefix="<", suffix=">", timeout=0))\n'
        '    socket_send_line("a")\n    socket_send_int(-2)\n    socket_send_byte(300)\n'
        '    socket_send_byte("z")\n    socket_send_string(p[1,2,3,0,0,0])\n'
        '    socket_set_var("speed", 3)\n'
        '    textmsg(socket_get_var("speed"))\n'
        "    textmsg(socket_read_byte_list(2, timeout=0.1))\n"
        "    socket_close()\n"
        '    textmsg(socket_send_line("x"))\n'
        "  end\nend\n"
    )
    until(robot, lambda: robot.program is not None)
    until(robot, lambda: robot.program is None)
    assert list(robot.told) == [
        "[3, 1.5, 2, -3]", "hello", "[3, 7, -8, 9]", "inside", "42", "[0, -1, -1]", "False",
    ]  # fmt: skip
    peer.join(5.0)
    sent = b"a\n" + struct.pack(">i", -2) + b"\x2cz" + b"p[1, 2, 3, 0, 0, 0]SET speed 3\n"
    assert peer.heard == sent + b"GET speed\n"


def test_a_read_waits_for_two_seconds_unless_it_is_told_otherwise(robot):
    peer = Peer()
    robot.upload(
        f'def p():\n  socket_open("127.0.0.1", {peer.port})\n  textmsg("open")\n'
        "  socket_read_line()\n  textmsg(1)\nend\n"
    )
    until(robot, lambda: robot.told)
    begun = robot.ticks
    until(robot, lambda: len(robot.told) == 2)
    assert robot.ticks - begun == pytest.approx(1000, abs=2)
    peer.join(5.0)


def test_a_socket_that_nobody_listens_on_is_not_opened(robot):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    run(robot, f'  textmsg(socket_open("127.0.0.1", {port}))', 50)
    assert list(robot.told) == ["False"]


def test_opening_a_socket_again_closes_the_first_one(robot):
    first, second = Peer(), Peer()
    opened = "".join(f'  socket_open("127.0.0.1", {one.port})\n' for one in (first, second))
    robot.upload(f'def p():\n{opened}  socket_send_line("here")\n  sleep(9)\nend\n')
    until(robot, lambda: second.heard == b"here\n")
    first.join(5.0)
    assert (first.is_alive(), first.heard) == (False, b"")
    robot.stop()
    second.join(5.0)
    assert not second.is_alive()


def test_modes_and_states_have_the_numbers_of_the_guide():
    assert [one.name for one in sorted(RobotMode)] == [
        "DISCONNECTED", "CONFIRM_SAFETY", "BOOTING", "POWER_OFF", "POWER_ON", "IDLE", "BACKDRIVE",
        "RUNNING",
    ]  # fmt: skip
    assert list(map(int, sorted(RobotMode))) == list(range(8))
    assert list(map(int, sorted(ProgramState))) == list(range(6))
    assert [ProgramState(n).name for n in (1, 2, 4)] == ["STOPPED", "PLAYING", "PAUSED"]
    assert list(map(int, sorted(SafetyMode))) == list(range(1, 14))


@pytest.mark.parametrize("start", ["freedrive_mode", "teach_mode"])
def test_an_arm_gives_way_until_its_mode_is_ended(robot, start):
    end = f"end_{start}"
    run(robot, f"  {start}()\n  sleep(0.1)\n  {end}()\n  sleep(9)", 30)
    robot.push(HOME, 0.01)
    tick(robot, 60)
    with pytest.raises(RefusedError, match="does not give way"):
        robot.push(HOME, 0.01)


def test_a_moving_arm_does_not_give_way_even_without_a_program(robot):
    run(robot, "  speedj([0.5, 0, 0, 0, 0, 0], 10, 0.2)", 60)
    robot.stop()
    assert not robot.arm.is_still
    with pytest.raises(RefusedError, match="does not give way"):
        robot.push(HOME, 0.1)
    tick(robot, 200)
    robot.push(HOME, 0.1)


def test_dashboard_leads_a_robot_from_a_violation_to_running(robot):
    robot.enter(SafetyMode.VIOLATION)
    for line, mode in (("restart safety", RobotMode.POWER_OFF), ("power on", RobotMode.IDLE),
                       ("brake release", RobotMode.RUNNING)):  # fmt: skip
        dashboard.reply(robot, line)
        tick(robot, 120)
        assert (robot.robot_mode, robot.safety_mode) == (mode, SafetyMode.NORMAL)
