"""The driver without the daemon: its feedback, its setpoints, its faults and how they end."""

import math
import re
import threading
import time
from contextlib import suppress
from itertools import pairwise

import numpy as np
import pytest
from arm_recording import read_arm, read_setpoints
from ur_rig import driver_of, press, push, stream_of

from emulated_ur import EmulatedRobot, LaunchError
from orientd.errors import (
    AxisFaultError,
    DeviceError,
    DeviceFaultError,
    FeedbackError,
    LinkError,
)
from orientd.floats import difference, exp, norm
from orientd_ur.wire import RtdeClient

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world


SERVO = 24
"""The command in the registers while setpoints are sent."""


def register(robot, name):
    """Return what the controller has in a register."""
    with RtdeClient(robot.host, 2.0) as client:
        client.subscribe(125.0, [name])
        (value,) = client.sample()[name]
        return value


def hold_away(robot, joint, angle):
    """Hold a joint, counted from 1, away from where the controller commands it to be."""
    robot.ask(f"block {joint} {angle}")
    robot.wait_until(lambda s: abs(lag(s, joint)) > 0.9 * abs(angle))


def lag(state, joint):
    return state["target_q"][joint - 1] - state["actual_q"][joint - 1]


def fault_while(run, kind=DeviceFaultError):
    """Run cycles until one raises an error; return its words."""
    with pytest.raises(kind) as caught:
        run(5.0)
    return str(caught.value)


# Where the arm is


def test_start_is_the_pose_that_the_controller_commands(ur_robot):
    hold_away(ur_robot, 2, 0.005)  # a load bends the arm
    with driver_of(ur_robot.host) as driver:
        start, state = driver.enable(), ur_robot.state()
        q, position = driver.mechanism(may_ask=False).forward(state["target_q"])
        assert norm(difference(start.q, q)) < 1e-9
        assert start.position == pytest.approx(position, abs=1e-9)
        assert start.joints == pytest.approx(state["actual_q"])
        assert lag(state, 2) == pytest.approx(-0.005)


def test_arm_that_is_not_where_it_is_commanded_to_be_is_not_enabled(ur_robot):
    hold_away(ur_robot, 2, 0.3)
    words = r"joint shoulder is 17\.2 deg from where"
    with driver_of(ur_robot.host) as driver, pytest.raises(DeviceFaultError, match=words):
        driver.enable()


def test_arm_is_enabled_once_it_stands(ur_robot):
    with stream_of(ur_robot.host, lookahead=0.2) as stream:
        stream.send(turn=(0.0, 0.0, 0.1))
        stream.run(0.02)
        assert norm(difference(stream.driver.enable().q, stream.q)) < 0.01
    with stream_of(ur_robot.host, lookahead=0.2) as stream:
        ur_robot.ask("slider 0.1")
        ur_robot.wait_until(lambda s: s["speed_scaling"] < 0.1001)
        stream.send(turn=(0.0, 0.0, 0.4))
        stream.run(0.02)
        with pytest.raises(DeviceFaultError, match="does not come to rest"):
            stream.driver.enable()


def test_feedback_is_measured_and_its_angular_velocity_is_the_tools(ur_robot):
    with stream_of(ur_robot.host) as stream:
        for _ in range(300):
            feedback = stream.step((0.0, 0.0, 0.001))
        assert norm(feedback.omega_body) > 0.01
        assert feedback.omega_body == pytest.approx((0.0, 0.0, norm(feedback.omega_body)), abs=1e-6)
        q, position = stream.driver.mechanism(may_ask=False).forward(feedback.joints)
        assert norm(difference(feedback.q, q)) < 1e-6
        assert feedback.position == pytest.approx(position, abs=1e-6)
        stream.run(0.5)
        assert stream.step().joints == pytest.approx(ur_robot.state()["actual_q"], abs=1e-4)


def test_speed_is_slider_times_limiter(ur_robot):
    with stream_of(ur_robot.host) as stream:
        ur_robot.ask("slider 0.5")
        ur_robot.ask("limiter 0.5")
        stream.run(0.4)
        assert stream.driver.speed_scaling == pytest.approx(0.25)


# Setpoints


def test_setpoint_has_the_options_of_its_motion(ur_robot):
    with stream_of(ur_robot.host, lookahead=0.05, gain=500) as stream:
        for options, servoing in (
            ({}, [0.05, 500.0]),
            ({"gain": 900, "lookahead": 0.2}, [0.2, 900.0]),
            ({}, [0.05, 500.0]),
        ):
            stream.driver.tune(options)
            stream.run(0.05)
            assert ur_robot.state()["servoing"] == servoing
        assert register(ur_robot, "input_double_register_8") == 0.002


def test_rotation_vectors_go_on_beyond_half_a_turn(ur_robot, tmp_path):
    with stream_of(ur_robot.host) as stream:
        begin = np.array(ur_robot.state()["actual_pose"][3:])
        ur_robot.ask("record on")
        for x, y in ((0.002, 0.0), (-0.002, 0.0), (0.0, 0.002), (0.0, -0.002)):
            for way in (1.0, -1.0):
                for _ in range(100):
                    stream.step((way * x, way * y, 0.0))
        ur_robot.ask(f"record write {tmp_path / 'run'}")
    rows = np.array([row.target[3:] for row in read_setpoints(tmp_path / "run")])
    assert len(rows) == 800
    assert rows[0] == pytest.approx(begin, abs=0.01)
    assert np.max(np.linalg.norm(np.diff(rows, axis=0), axis=1)) < 0.01
    lengths = np.linalg.norm(rows, axis=1)
    assert lengths.min() < math.pi - 0.05 < math.pi + 0.05 < lengths.max()


def test_gaps_are_those_of_the_tool_and_of_each_joint_behind_its_command(ur_robot):
    with stream_of(ur_robot.host, arrival_tolerance_deg=1.0) as stream:
        ur_robot.ask("slider 0")
        stream.run(0.6)
        hold_away(ur_robot, 3, 0.02)
        stream.send(shift=(0.0, 0.0, 0.05))
        stream.run(0.05)
        tool, *joints = stream.driver.gaps()
        assert tool.gap == pytest.approx(0.05, abs=1e-6)
        assert tool.tolerance == pytest.approx(math.radians(1.0))
        assert [one.gap for one in joints] == pytest.approx([0, 0, -0.02, 0, 0, 0], abs=1e-6)
        assert joints[0].name == "joint base"
        stream.send(turn=(0.2, 0.0, 0.0), shift=(0.0, 0.0, -0.05))
        assert stream.driver.gaps()[0].gap == pytest.approx(0.2, abs=1e-6)


# Feedback that does not come


def freeze(robot, stream):
    """Freeze the controller; read what it has sent."""
    time.sleep(0.01)
    robot.ask("freeze")
    time.sleep(0.01)
    stream.driver.read()


def test_pause_of_our_own_is_no_missing_feedback(ur_robot):
    with stream_of(ur_robot.host, feedback_timeout=0.1, link_timeout=2.0) as stream:
        freeze(ur_robot, stream)
        time.sleep(0.3)
        stream.driver.read()
        stream.driver.read()
        words = r"no feedback .*; the newest package .*, so the controller or the network is late"
        with pytest.raises(FeedbackError, match=words):
            stream.driver.read()


def test_frozen_controller_is_not_waited_for(ur_robot):
    with stream_of(ur_robot.host, feedback_timeout=0.1, link_timeout=2.0) as stream:
        freeze(ur_robot, stream)
        time.sleep(0.15)
        begun = time.monotonic()
        stream.driver.rest_in_fault()
        for call in (stream.driver.read, stream.driver.disable, stream.driver.close):
            call()
        assert time.monotonic() - begun < 0.3


# Orders


@pytest.mark.parametrize(("deceleration", "least", "most"), [(2.0, 0.2, 0.5), (40.0, 0.0, 0.15)])
def test_disabled_arm_stops_with_the_deceleration_of_the_options(
    ur_robot, deceleration, least, most
):
    with stream_of(ur_robot.host, stop_deceleration=deceleration) as stream:
        stream.run(0.6, rate=0.5)
        begun = time.monotonic()
        stream.driver.disable()
        assert ur_robot.state()["is_still"]
        assert least < time.monotonic() - begun < most


def test_arm_gives_way_while_it_is_free(ur_robot):
    with driver_of(ur_robot.host) as driver:
        driver.free()
        push(ur_robot, (0.1, 0.0, 0.0, 0.0, 0.0, 0.1))
        driver.enable()
        with pytest.raises(LaunchError, match="freedrive is off"):
            ur_robot.ask("push 0 0 0 0 0 0")


@pytest.mark.parametrize(
    ("registers", "first", "other"), [("lower", 0, "upper"), ("upper", 24, "lower")]
)
def test_registers_of_another_client_are_named_with_the_way_out(ur_robot, registers, first, other):
    words = rf"holds the {registers} registers .* set the option `registers` to {other}"
    with (
        RtdeClient(ur_robot.host, 2.0) as client,
        driver_of(ur_robot.host, registers=registers) as driver,
    ):
        assert client.claim(f"input_int_register_{first}")
        with pytest.raises(LinkError, match=words):
            driver.enable()


def test_registers_that_are_given_back_late_are_asked_for_again(ur_robot):
    client = RtdeClient(ur_robot.host, 2.0)
    assert client.claim("input_int_register_0")
    with driver_of(ur_robot.host) as driver:
        giving_back = threading.Timer(0.3, client.sock.close)
        giving_back.start()
        driver.enable()
        giving_back.join()


def test_program_ends_with_the_driver(ur_robot):
    with driver_of(ur_robot.host) as driver:
        driver.enable()
    assert ur_robot.state()["runtime_state"] == "STOPPED"


# A robot that does not follow


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ("protective_stop", "protective stop: look for its cause"),
        ("pause", "the control program is paused on the pendant"),
        ("stop", "the control program was stopped; reset to start it again"),
        ("power off", "robot mode: power off"),
        ("power on", "robot mode: idle"),
    ],
)
def test_robot_that_does_not_follow_is_a_fault_in_words(ur_robot, order, words):
    with stream_of(ur_robot.host) as stream:
        stream.run(0.05)
        if order.startswith("power"):
            press(ur_robot.host, "power off", order)
            ur_robot.wait_until(lambda s: s["robot_mode"] in ("POWER_OFF", "IDLE"))
        else:
            ur_robot.ask(order)
        time.sleep(0.05)
        assert words in fault_while(lambda _: stream.driver.read())
        assert register(ur_robot, "input_int_register_0") == SERVO
        stream.driver.rest_in_fault()
        stream.read_for(0.02)
        assert register(ur_robot, "input_int_register_0") == 0  # no setpoint waits for a program


@pytest.mark.parametrize("angle", [0.1, -0.1])
def test_joint_that_stays_away_from_its_command_is_a_fault_once(ur_robot, angle):
    with stream_of(ur_robot.host) as stream:
        for _ in range(2):
            stream.run(0.05)
            begun = time.monotonic()
            ur_robot.ask(f"block 6 {angle}")
            text = fault_while(stream.read_for, AxisFaultError)
            assert time.monotonic() - begun > 0.1
            assert text.startswith(
                "joint wrist 3 does not follow: it is 5.7 deg behind for more than 0.1 s"
            )
            stream.read_for(0.3)  # the stop has feedback
            assert stream.driver.read().joints == pytest.approx(ur_robot.state()["actual_q"])
            stream.driver.disable()
            ur_robot.ask("unblock 6")
            ur_robot.wait_until(lambda s: abs(lag(s, 6)) < 1e-6)
            stream.start()


def test_joints_that_stay_away_are_all_named(ur_robot):
    with stream_of(ur_robot.host) as stream:
        stream.run(0.05)
        for joint, angle in ((1, 0.2), (6, 0.1)):
            hold_away(ur_robot, joint, angle)
        text = fault_while(stream.read_for, AxisFaultError)
    assert re.match(r"joint base .* 11\.5 deg .*; joint wrist 3 .* 5\.7 deg", text), text


def test_arm_that_is_guided_by_hand_or_disabled_is_not_judged(ur_robot):
    with stream_of(ur_robot.host) as stream:
        stream.driver.disable()
        hold_away(ur_robot, 6, 0.3)
        stream.read_for(0.3)
        stream.driver.free()
        stream.read_for(0.3)
        ur_robot.ask("unblock 6")
        ur_robot.wait_until(lambda s: abs(lag(s, 6)) < 1e-6)
        stream.start()
        stream.driver.rest_in_fault()
        hold_away(ur_robot, 6, 0.3)
        stream.read_for(0.3)


# Faults and the way out of them


def test_arm_is_commanded_to_be_where_it_is_before_a_fault_ends_the_program(ur_robot, tmp_path):
    with stream_of(ur_robot.host, lookahead=0.05, gain=500) as stream:
        stream.run(0.05)
        hold_away(ur_robot, 6, -0.1)
        begin = ur_robot.state()["target_q"]
        ur_robot.ask("record on")
        stream.driver.rest_in_fault()
        stream.read_for(0.6)
        ur_robot.ask(f"record write {tmp_path / 'run'}")
        end = ur_robot.state()
    assert end["runtime_state"] == "STOPPED"
    assert end["servoing"] == [0.05, 500.0]
    assert abs(lag(end, 6)) < math.radians(0.5)
    assert end["target_q"][:5] == pytest.approx(begin[:5])
    turns = [exp(row.target_pose[3:]) for row in read_arm(tmp_path / "run")]
    assert 0.001 < max(norm(difference(p, q)) for p, q in pairwise(turns)) < 0.0021


def test_program_ends_in_a_fault_although_the_command_does_not_come_back(ur_robot):
    with stream_of(ur_robot.host) as stream:
        ur_robot.ask("slider 0")
        stream.run(0.6)
        hold_away(ur_robot, 6, 0.3)
        stream.driver.rest_in_fault()
        stream.read_for(4.8)
        assert ur_robot.state()["runtime_state"] == "PLAYING"
        stream.read_for(0.4)
        assert ur_robot.state()["runtime_state"] == "STOPPED"


def test_arm_that_was_cut_off_is_not_commanded_back(ur_robot):
    with stream_of(ur_robot.host) as stream:
        stream.run(0.05)
        hold_away(ur_robot, 6, 0.3)
        stream.driver.rest_in_fault()
        stream.driver.disable()
        sent = ur_robot.state()["setpoints"]
        stream.read_for(0.1)
        state = ur_robot.state()
        assert (state["runtime_state"], state["setpoints"]) == ("STOPPED", sent)


def test_every_fault_ends_the_stream_and_the_program(ur_robot):
    with stream_of(ur_robot.host) as stream:
        for _ in range(2):
            stream.run(0.05)
            time.sleep(0.02)
            sent = ur_robot.state()["setpoints"]
            stream.driver.rest_in_fault()
            for _ in range(20):
                stream.step()
            state = ur_robot.wait_until(lambda s: s["runtime_state"] == "STOPPED")
            assert state["setpoints"] == sent
            assert "watchdog" not in " ".join(state["log"])
            stream.read_for(0.1)
            assert not stream.driver.notices()
            stream.driver.reset()
            stream.start()


def test_paused_program_is_ended_once_the_dashboard_answers(ur_robot):
    with stream_of(ur_robot.host) as stream:
        stream.run(0.05)
        ur_robot.ask("dashboard 1000")
        ur_robot.ask("pause")
        stream.run(1.3)
        assert ur_robot.state()["runtime_state"] == "PAUSED"
        ur_robot.ask("dashboard 0")
        stream.run(1.2)
        assert ur_robot.state()["runtime_state"] == "STOPPED"
        assert not stream.driver.notices()


def test_reset_powers_up_only_if_it_may(ur_robot):
    with stream_of(ur_robot.host, release_brakes=False) as stream:
        stream.driver.reset()
        press(ur_robot.host, "power off")
        stream.run(0.2)
        with pytest.raises(DeviceFaultError, match="power off"):
            stream.driver.reset()
        assert ur_robot.state()["robot_mode"] == "POWER_OFF"


def test_protective_stop_that_stays_locked_is_named_with_the_answer(ur_host):
    with EmulatedRobot(ur_host) as robot, stream_of(ur_host, unlock_timeout=0.2) as stream:
        robot.ask("protective_stop")
        stream.run(0.2)
        words = "stays locked: Cannot unlock protective stop until 5s after"
        with pytest.raises(DeviceFaultError, match=words):
            stream.driver.reset()


def test_local_control_is_named_by_enable_and_reset_if_it_matters(ur_robot):
    ur_robot.ask("local")
    with driver_of(ur_robot.host) as driver:
        for call in (driver.enable, driver.reset):
            with pytest.raises(DeviceFaultError, match="is in local control; switch it to remote"):
                call()
    with driver_of(ur_robot.host, check_remote_control=False) as driver, suppress(DeviceError):
        driver.reset()
