"""Interfaces of the emulated controller: RTDE names, dashboard, primary messages."""

import struct

import pytest

from emulated_ur import Behaviour, Controller, dashboard, faults
from emulated_ur.primary import event_message
from emulated_ur.recording import ARM_ROW, SETPOINT_ROW, Recording
from emulated_ur.rtde import Layout, RtdeSession
from emulated_ur.server import Server
from emulated_ur.variables import VARIABLES

OUTPUTS = {name: one.kind for name, one in VARIABLES.items() if one.is_output}

ROS_DRIVER = """
    timestamp actual_q actual_qd speed_scaling target_speed_fraction runtime_state actual_TCP_force
    actual_TCP_pose actual_digital_input_bits actual_digital_output_bits standard_analog_input0
    standard_analog_input1 standard_analog_output0 standard_analog_output1 analog_io_types tool_mode
    tool_analog_input_types tool_analog_input0 tool_analog_input1 tool_output_voltage
    tool_output_current tool_temperature robot_mode safety_mode robot_status_bits safety_status_bits
    actual_current tcp_offset target_q target_qd target_current target_TCP_pose
"""


@pytest.fixture
def robot():
    return Controller()


def ask_outputs(names, version=(5, 25, 1, 1)):
    robot = Controller(Behaviour(version=version))
    session = RtdeSession(robot, {}, lambda _names, _values: None)
    session.feed(struct.pack(">HBH", 5, ord("V"), 2))
    packed = struct.pack(">d", 125.0) + ",".join(names).encode()
    answer = session.feed(struct.pack(">HB", 3 + len(packed), ord("O")) + packed)
    return answer[4:].decode().split(",")


def test_every_output_has_its_type_and_a_value_that_fits(robot):
    names = list(OUTPUTS)
    for first in range(0, len(names), 60):  # a recipe holds 2,048 bytes
        some = names[first : first + 60]
        assert ask_outputs(some) == [OUTPUTS[name] for name in some]
    for name, kind in OUTPUTS.items():
        Layout([name], [kind]).pack([robot.value(name)])


def test_recipe_of_the_ros_driver_is_taken():
    assert "NOT_FOUND" not in ask_outputs(ROS_DRIVER.split(), (5, 12, 6, 1))


@pytest.mark.parametrize(
    ("name", "version"),
    [
        ("nonsense", (5, 25, 0, 0)),
        ("output_bit_register_63", (5, 25, 0, 0)),
        ("output_int_register_48", (5, 25, 0, 0)),
        ("time_scale_source", (5, 12, 6, 0)),
        ("ft_raw_wrench", (3, 15, 8, 0)),
        ("tcp_offset", (5, 5, 0, 0)),
        ("safety_status", (5, 3, 0, 0)),
        ("output_int_register_24", (5, 2, 0, 0)),
        ("input_bit_register_64", (3, 8, 0, 0)),
        ("output_int_register_0", (3, 3, 0, 0)),
    ],
)
def test_name_that_is_not_there_is_refused_by_name(name, version):
    assert ask_outputs(["timestamp", name], version) == ["DOUBLE", "NOT_FOUND"]


def test_bits_of_both_forms_are_the_same_registers(robot):
    names = [f"input_bit_register{name}" for name in ("s32_to_63", "_64", "s0_to_31")]
    robot.write_package(names, [1 << 3, 1, 5])
    bits = " + ".join(f"read_input_boolean_register({n})" for n in (0, 2, 35, 64))
    none = " or ".join(f"read_input_boolean_register({n})" for n in (1, 31, 32, 36, 63, 65, 127))
    robot.upload(
        f"def p():\n  textmsg({bits})\n  textmsg({none})\n"
        "  write_output_boolean_register(127, True)\n"
        "  write_output_boolean_register(31, True)\n"
        "  write_output_boolean_register(62, True)\nend\n"
    )
    for _ in range(20):
        robot.tick()
    assert list(robot.told) == ["4", "False"]
    assert robot.value("input_bit_registers0_to_31") == 5
    assert robot.value("input_bit_register_64") == 1
    assert robot.value("output_bit_register_127") == 1
    assert robot.value("output_bit_registers0_to_31") == 1 << 31
    assert robot.value("output_bit_registers32_to_63") == 1 << 30


def test_force_that_a_client_writes_is_measured_once_it_is_enabled(robot):
    robot.write_package(["external_force_torque"], [(3.0, 4.0, 0.0, 0.0, 0.0, 0.0)])
    assert robot.value("tcp_force_scalar") == 0.0
    robot.uses_external_force = True
    assert robot.value("tcp_force_scalar") == 5.0


def test_elbow_is_where_the_upper_arm_ends(robot):
    robot.arm.actual_q = (0.0, -1.5707963267948966, 0.0, 0.0, 0.0, 0.0)
    assert robot.value("elbow_position") == pytest.approx((0.0, 0.0, 0.1625 + 0.425))
    robot.arm.actual_qd = (0.0, 1.0, 0.0, 0.0, 0.0, 0.0)
    assert robot.value("elbow_velocity") == pytest.approx((-0.425, 0.0, 0.0))


@pytest.mark.parametrize(
    ("line", "answer"),
    [
        ("version", "5.12.6.1102099"),
        ("load installation default.installation", "Loading installation: default.installation"),
        ("load installation gone.installation", "File not found: gone.installation"),
        ("load gone.urp", "File not found: gone.urp"),
        ("get operational mode", "NONE"),
        ("set operational mode manual", "Setting operational mode: manual"),
        ("set operational mode other", "Failed setting operational mode: other"),
        ("generate flight report system", "Flight Report generated with id: 0"),
        ("generate support file /tmp", "Completed successfully: /tmp/ur_support_file.zip"),
        ("setUserRole operator", "could not understand: setUserRole operator"),
        ("popup hello", "showing popup"),
        ("close popup", "closing popup"),
        ("saveLog", "could not understand: saveLog"),
    ],
)
def test_dashboard(robot, line, answer):
    robot.missing_files |= {"gone.urp", "gone.installation"}
    assert dashboard.reply(robot, line) == answer
    assert not robot.loaded_program


def test_operational_mode_is_kept_until_it_is_cleared(robot):
    dashboard.reply(robot, "set operational mode automatic")
    assert dashboard.reply(robot, "get operational mode") == "AUTOMATIC"
    assert "'AUTOMATIC'" in dashboard.reply(robot, "clear operational mode")
    assert dashboard.reply(robot, "get operational mode") == "NONE"


def test_user_roles_are_those_of_cb3():
    robot = Controller(Behaviour(version=(3, 15, 8, 0)))
    assert dashboard.reply(robot, "setUserRole operator") == "Setting user role: operator"
    assert dashboard.reply(robot, "getUserRole") == "OPERATOR"


@pytest.mark.parametrize(
    ("verb", "mode", "status", "bits", "can_move"),
    [
        ("reduced", 2, 2, 0b11, True),
        ("recovery", 4, 4, 1 << 3, False),
        ("safeguard", 5, 5, 1 << 4 | 1 << 10, False),
        ("automatic_safeguard", 5, 12, 1 << 4 | 1 << 10, False),
        ("three_position", 5, 13, 1 << 4 | 1 << 10, False),
        ("system_emergency_stop", 6, 6, 1 << 5 | 1 << 7 | 1 << 10, False),
        ("emergency_stop", 7, 7, 1 << 6 | 1 << 7 | 1 << 10, False),
        ("violation", 8, 8, 1 << 8 | 1 << 10, False),
        ("fault", 9, 9, 1 << 9 | 1 << 10, False),
    ],
)
def test_safety_state(verb, mode, status, bits, can_move):
    class Rig:
        robot = Controller()

    assert faults.carry_out(Rig, verb) == "ok"
    robot = Rig.robot
    found = [robot.value(name) for name in ("safety_mode", "safety_status", "safety_status_bits")]
    assert found == [mode, status, bits]
    assert robot.can_move is can_move
    assert dashboard.reply(robot, "safetystatus").removeprefix("Safetystatus: ").isupper()
    robot.release()
    robot.restart_safety()
    assert robot.value("safety_mode") == 1


def test_inputs_are_set_by_the_control_channel():
    server = Server.__new__(Server)
    server.robot = Controller()
    assert faults.carry_out(server, "input digital 9 1") == "ok"
    assert faults.carry_out(server, "input analog 3 0.5") == "ok"
    assert faults.carry_out(server, "input analog 4 0.5").startswith("error: expected digital")
    assert server.robot.value("actual_digital_input_bits") == 1 << 9
    assert server.robot.value("tool_analog_input1") == 0.5


def test_primary_interface_tells_start_words_exception_and_end(robot):
    robot.upload('def p():\n  textmsg("hi")\n  sleep(0.01)\n  x = 1 / 0\nend\n')
    for _ in range(30):
        robot.tick()
    messages = [event_message(robot, one) for one in robot.events]
    started, said, failed, stopped = filter(None, messages)  # its log is not for this port
    assert started[14] == 7
    assert started[23:] == b"\x13PROGRAM_XXX_STARTEDp"
    assert said[14:] == b"\x00hi"
    assert struct.unpack_from(">Bii", failed, 14) == (10, 4, 0)
    assert failed[23:] == b"division by zero"
    assert stopped.endswith(b"PROGRAM_XXX_STOPPEDp")
    for message in (started, said, failed, stopped):
        assert struct.unpack_from(">iB", message) == (len(message), 20)


def test_record_is_kept_cleared_and_written(robot, tmp_path):
    class Rig:
        recording = Recording()

    names = ["input_int_register_0", *(f"input_double_register_{n}" for n in range(11))]
    packages = [24, *range(1, 12)], [11, *range(2, 13)], [1, *range(12)]
    for line in ("record on", "record clear", "record off", "record on"):
        assert faults.carry_out(Rig, line) == "ok"
        for values in packages:
            Rig.recording.add_package(7, names, values)
    assert (Rig.recording.setpoints, Rig.recording.overwritten) == (8, 7)
    Rig.recording.add_tick(robot)
    assert faults.carry_out(Rig, f"record write {tmp_path}/it") == "ok"
    assert faults.carry_out(Rig, "record").startswith("error: record must be on, off")
    rows = list(SETPOINT_ROW.iter_unpack((tmp_path / "it.setpoints").read_bytes()))
    assert [row[1:] for row in rows] == [(7, *range(k, k + 6)) for k in (1, 2)] * 2
    (row,) = ARM_ROW.iter_unpack((tmp_path / "it.arm").read_bytes())
    assert row[8:14] == pytest.approx(robot.value("actual_TCP_pose"))
