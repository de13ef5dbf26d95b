"""Every fault of a UR controller, through a real servo process: typed, in time, recovered from."""

import pytest
from ur_rig import (
    device_of,
    fault_of,
    is_holding,
    launched,
    press,
    recover,
    streaming,
    swing,
    until,
)

from emulated_ur import EmulatedRobot
from orientd.config import DeviceSettings
from orientd.errors import DaemonError, Fault, StateError
from orientd_ur.wire import RtdeClient

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world


def settings_of(robot):
    return DeviceSettings(name="arm", driver="ur", options={"host": robot.host})


@pytest.mark.parametrize(
    ("order", "release", "words"),
    [
        ("protective_stop", "", "protective stop"),
        ("emergency_stop", "release", "emergency stop"),
        ("safeguard", "release", "safeguard"),
        ("stop", "", "control program was stopped"),
        ("pause", "", "control program is paused"),
    ],
)
def test_stop_is_a_device_fault_and_reset_moves_the_arm_again(ur_robot, order, release, words):
    with device_of(ur_robot.host) as device:
        swing(device)
        streaming(device)
        ur_robot.ask(order)
        fault, text, _ = fault_of(device)
        assert fault is Fault.DEVICE_FAULT
        assert words in text
        ur_robot.wait_until(lambda s: s["is_still"])
        if release:
            ur_robot.ask(release)
        recover(device)


@pytest.mark.parametrize("leaves", ["playing", "stopped"])
def test_protective_stop_is_recovered_whatever_the_program_becomes(ur_host, leaves):
    robot = EmulatedRobot(ur_host, "--unlock-after", "0.3", "--protective-stop-leaves", leaves)
    with robot, device_of(ur_host) as device:
        swing(device)
        streaming(device)
        robot.ask("protective_stop")
        fault, text, _ = fault_of(device)
        assert fault is Fault.DEVICE_FAULT
        assert "protective stop" in text
        recover(device)


def test_reset_says_which_hand_is_needed(ur_robot):
    with device_of(ur_robot.host) as device:
        ur_robot.ask("safeguard")
        fault_of(device)
        with pytest.raises(DaemonError, match="close the safeguard"):
            device.reset()


def test_safety_violation_needs_the_safety_system_restarted_and_is_then_recovered_from(ur_robot):
    with device_of(ur_robot.host) as device:
        swing(device)
        streaming(device)
        ur_robot.ask("violation")
        fault, text, _ = fault_of(device)
        assert fault is Fault.DEVICE_FAULT
        assert "safety violation" in text
        with pytest.raises(DaemonError, match="restart the safety system"):
            device.reset()
        press(ur_robot.host, "restart safety")
        recover(device)


def test_local_control_is_named_when_enabling(ur_robot):
    with device_of(ur_robot.host) as device:
        device.disable()
        ur_robot.ask("stop")
        ur_robot.ask("local")
        with pytest.raises((DaemonError, StateError), match="remote control"):
            device.enable()


def test_motion_of_an_arm_that_could_not_be_enabled_is_refused_with_the_reason(ur_robot):
    ur_robot.ask("local")
    words = r"is idle, not holding: .*local control.*; then reset"
    with launched(settings_of(ur_robot)) as device:
        assert device.wait_ready(20.0), device.failure
        with pytest.raises(StateError, match=words):
            device.commanded()


def test_frozen_controller_is_stale_feedback_then_a_lost_link(ur_robot):
    with device_of(ur_robot.host) as device:
        swing(device)
        streaming(device)
        pid = device.snapshot().servo_pid
        ur_robot.ask("freeze")
        fault, *_ = fault_of(device)
        assert fault in (Fault.FEEDBACK_STALE, Fault.LINK_LOST)
        until(lambda: device.snapshot().fault is Fault.LINK_LOST, "the lost link")
        until(lambda: device.snapshot().servo_pid != pid, "the servo's end")
        assert "clock" in device.snapshot().fault_text
        ur_robot.ask("thaw")
        recover(device)


def test_short_freeze_costs_no_process(ur_robot):
    with device_of(ur_robot.host, feedback_timeout=0.1, link_timeout=1.5) as device:
        pid = device.snapshot().servo_pid
        ur_robot.ask("freeze 0.3")
        fault, _, _ = fault_of(device)
        assert fault is Fault.FEEDBACK_STALE
        until(lambda: "0" not in ur_robot.state()["runtime_state"], "thawed")
        recover(device)
        assert device.snapshot().servo_pid == pid


@pytest.mark.parametrize(
    "what",
    [
        "control",
        "receive",
        "rtde",
    ],
)
def test_closed_connection_is_a_lost_link(ur_robot, what):
    with device_of(ur_robot.host) as device:
        swing(device)
        streaming(device)
        ur_robot.ask(f"drop {what}")
        fault, *_ = fault_of(device)
        assert fault in (Fault.LINK_LOST, Fault.SERVO_DIED)
        recover(device)


def test_dead_controller_is_a_lost_link_and_the_next_one_is_found(ur_robot):
    with device_of(ur_robot.host) as device:
        swing(device)
        streaming(device)
        ur_robot.ask("die")
        fault, *_ = fault_of(device)
        assert fault in (Fault.LINK_LOST, Fault.SERVO_DIED)
        with pytest.raises(DaemonError, match=r"no dashboard server|no RTDE server"):
            device.reset()
        ur_robot.end()
        ur_robot.start()
        recover(device)


def test_garbage_on_the_link_is_named_and_recovered_from(ur_robot):
    with device_of(ur_robot.host) as device:
        swing(device)
        streaming(device)
        ur_robot.ask("garbage 7")
        fault, text, _ = fault_of(device)
        # The client library may not survive what it reads; which of its threads is first decides.
        assert fault in (Fault.SERVO_DIED, Fault.LINK_LOST)
        told = (
            "closed the connection",
            f"no RTDE packages: see what the controller at {ur_robot.host} sends",
            "the client library crashed",
        )
        assert any(words in text for words in told), text
        recover(device)


@pytest.mark.real
def test_second_client_with_the_registers_is_named(ur_robot):
    rtde_control = pytest.importorskip("rtde_control")
    other = rtde_control.RTDEControlInterface(ur_robot.host)
    try:
        with launched(settings_of(ur_robot)) as device:
            assert device.wait_ready(20.0), device.failure
            fault, text, _ = fault_of(device, 5.0)
            assert fault is Fault.DEVICE_FAULT
            assert "another client holds the lower registers" in text
            assert "set the option `registers` to upper" in text
        assert other.isProgramRunning()
    finally:
        other.disconnect()


@pytest.mark.real
def test_upper_registers_work_beside_a_client_with_the_lower_ones(ur_robot):
    with RtdeClient(ur_robot.host, 2.0) as other:
        assert other.claim("input_int_register_0", "input_double_register_3")
        with device_of(ur_robot.host, registers="upper") as device:
            swing(device, seconds=1.0)
            streaming(device)
            until(lambda: is_holding(device), "the end")
            assert device.snapshot().fault is Fault.NONE


def test_silent_controller_is_named_when_opening(ur_robot):
    ur_robot.ask("silence")
    with launched(settings_of(ur_robot)) as device:
        assert not device.wait_ready(20.0)
        assert "did not send data packages" in device.failure


def test_half_slider_slows_the_motion_and_keeps_its_path(ur_robot):
    with device_of(ur_robot.host) as device:
        ur_robot.ask("slider 0.5")
        ur_robot.wait_until(lambda s: s["speed_scaling"] < 0.5001)
        swing(device, seconds=1.2)
        until(lambda: device.snapshot().path_time > 0.5, "streaming")
        assert device.snapshot().cycle.speed == pytest.approx(0.5, abs=1e-3)
        until(lambda: is_holding(device), "the end")


def test_fault_of_one_robot_leaves_the_other_moving(ur_robot):
    other_host = ur_robot.host.rsplit(".", 1)[0] + ".253"
    with (
        EmulatedRobot(other_host) as other,
        device_of(ur_robot.host) as first,
        device_of(other.host) as second,
    ):
        swing(first)
        queued = swing(second)
        streaming(second)
        ur_robot.ask("die")
        fault_of(first)
        until(lambda: is_holding(second), "the other's end")
        assert second.snapshot().fault is Fault.NONE
        assert second.snapshot().motion_number == queued.number


def test_reset_after_a_lost_link_unlocks_a_protective_stop_too(ur_robot):
    with device_of(ur_robot.host) as device:
        swing(device)
        streaming(device)
        ur_robot.ask("drop rtde")
        fault, *_ = fault_of(device)
        assert fault in (Fault.LINK_LOST, Fault.SERVO_DIED)
        ur_robot.ask("protective_stop")
        assert ur_robot.state()["safety_mode"] == "PROTECTIVE_STOP"
        recover(device)
        assert ur_robot.state()["safety_mode"] == "NORMAL"
