"""Controllers and dashboards that take their time: a reset waits for them, a stop does not."""

import threading
import time

import pytest
from ur_rig import device_of, fault_of, is_holding, streaming, swing, until

from emulated_ur import EmulatedRobot
from orientd.errors import DaemonError, Fault, StateError

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world


def test_reset_waits_for_the_device_and_lets_a_stop_pass(ur_host):
    with EmulatedRobot(ur_host, "--unlock-after", "3") as robot, device_of(ur_host) as device:
        swing(device)
        streaming(device)
        robot.ask("protective_stop")
        fault_of(device)
        resetting = threading.Thread(target=device.reset)
        resetting.start()
        time.sleep(0.5)
        for is_quickest in (False, True):
            with pytest.raises(DaemonError, match="reset is under way, for"):
                device.stop(is_quickest=is_quickest)
        # Neither stop has waited for the reset, which is still under way.
        with pytest.raises(StateError, match="reset is under way, for"):
            device.enable()
        with pytest.raises(StateError, match="another reset is under way"):
            device.reset()
        assert robot.state()["safety_mode"] == "PROTECTIVE_STOP"
        resetting.join(20.0)
        until(lambda: is_holding(device), "holding after the reset")
        assert device.snapshot().fault is Fault.NONE


@pytest.mark.parametrize("pace", ["0.3", "1000"])
def test_dashboard_that_trickles_or_is_silent_is_named(ur_robot, pace):
    with device_of(ur_robot.host) as device:
        ur_robot.ask(f"dashboard {pace}")
        ur_robot.ask("protective_stop")
        fault_of(device)
        with pytest.raises(DaemonError, match=r"dashboard server at .* did not send its greeting"):
            device.reset()
        ur_robot.ask("dashboard 0")
        device.reset()
        until(lambda: is_holding(device), "holding after the reset")
