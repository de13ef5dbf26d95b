"""Controllers and dashboard servers that take their time: calls are answered, stops at once."""

import pytest
from ur_rig import device_of, fault_of, is_holding, reset, streaming, swing, until

from emulated_ur.process import EmulatedRobot
from orientd.errors import DaemonError, Fault, PendingError, StateError
from orientd.stream import Command

pytest.importorskip("rtde_control")


def test_reset_that_takes_its_time_says_so_and_lets_a_stop_pass(ur_host):
    with EmulatedRobot(ur_host, "--unlock-after", "3") as robot, device_of(ur_host) as device:
        swing(device)
        streaming(device)
        robot.ask("protective_stop")
        fault_of(device)
        with pytest.raises(PendingError, match="reset is under way, for"):
            device.reset()
        device.stop()
        device.halt()
        with pytest.raises(StateError, match="reset is under way"):
            device.enable()
        # The stops were not waited for: the reset they were given during still goes on.
        assert robot.state()["safety_mode"] == "PROTECTIVE_STOP"
        reset(device)
        until(lambda: is_holding(device), "holding after the reset")
        assert device.snapshot().fault is Fault.NONE


@pytest.mark.parametrize("pace", ["0.3", "1000"])
def test_dashboard_that_trickles_or_is_silent_is_named(ur_robot, pace):
    with device_of(ur_robot.host) as device:
        ur_robot.ask(f"dashboard {pace}")
        ur_robot.ask("protective_stop")
        fault_of(device)
        with pytest.raises(DaemonError, match=r"dashboard server at .* did not send its greeting"):
            reset(device)
        ur_robot.ask("dashboard 0")
        reset(device)
        until(lambda: is_holding(device), "holding after the reset")


def test_answer_of_a_slow_command_waits_for_whoever_gives_it_again(ur_host):
    with EmulatedRobot(ur_host, "--unlock-after", "1.5") as robot, device_of(ur_host) as device:
        robot.ask("protective_stop")
        fault_of(device)
        with pytest.raises(PendingError):
            device.reset()
        link = device._servo.link
        assert link.busy_with is Command.RESET
        robot.wait_until(lambda state: state["runtime_state"] == "PLAYING")
        reset(device)
        assert link.busy_with is None
