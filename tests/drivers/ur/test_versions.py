"""Robots of every version: what doctor says of them, what the driver does without."""

import os
import signal
import time

import pytest
from ur_rig import device_of, driver_of, fault_of, streaming, swing, unopened

from emulated_ur import EmulatedRobot
from orientd.driver import Verdict
from orientd.errors import DeviceFaultError, Fault, LinkError
from orientd.floats import difference, norm

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world

TOOL = [0.0, 0.0, 0.1, 0.0, 0.0, 0.0]


def rows_of(host, **options):
    return {one.name: one for one in unopened(host, **options).diagnose()}


@pytest.mark.parametrize("version", ["5.4.3", "5.5.0"])
@pytest.mark.parametrize("options", [{}, {"tcp_offset": TOOL}])
def test_tool_of_a_robot_that_does_not_say_it_is_seen(ur_host, version, options):
    with EmulatedRobot(ur_host, "--polyscope", version):
        rows = rows_of(ur_host)
        assert rows["version"].verdict is Verdict.OK
        assert rows["remote control"].verdict is Verdict.OK
        assert rows["arm"].verdict is Verdict.OK
        with driver_of(ur_host, **options) as driver:
            start = driver.enable()
            assert not driver.notices()
            # As the planner asks, on a driver that is not open.
            arm = unopened(ur_host, **options).mechanism(may_ask=True)
            q, position = arm.forward(start.joints)
            assert position == pytest.approx(start.position, abs=1e-6)
            assert norm(difference(q, start.q)) < 1e-6
            begin = driver.offline_start(from_device=True)
            assert begin.position == pytest.approx(start.position, abs=1e-6)


@pytest.mark.parametrize(
    ("model", "version", "needed"),
    [("ur5", "3.2", "3.4"), ("ur5e", "5.3", "5.4"), ("ur5e", "10.9", "10.10")],
)
def test_robot_that_is_too_old_is_refused_with_the_version_it_needs(
    ur_host, model, version, needed
):
    words = f"{needed} or newer is needed"
    with EmulatedRobot(ur_host, "--model", model, "--polyscope", version):
        found = rows_of(ur_host, rate_hz=125)["version"]
        assert found.verdict is Verdict.PROBLEM
        assert words in found.mend
        with pytest.raises(LinkError, match=words):
            unopened(ur_host, rate_hz=125).open()


def test_rate_that_a_robot_does_not_take_is_found_before_it_runs(ur_host):
    with EmulatedRobot(ur_host, "--model", "ur5"):
        found = rows_of(ur_host)["rate"]
        assert found.verdict is Verdict.PROBLEM
        assert "`rate_hz` must be 125 at the most" in found.mend
        with pytest.raises(LinkError, match="`rate_hz` must be 125 at the most"):
            unopened(ur_host).open()
        rows = rows_of(ur_host, rate_hz=125)
        assert rows["rate"].verdict is Verdict.OK
        assert rows["remote control"].verdict is Verdict.OK
        assert "does not say" in rows["remote control"].found


def test_polyscope_x_in_local_control_is_told_what_it_needs(ur_host):
    with EmulatedRobot(ur_host, "--polyscope", "10.11") as robot:
        robot.ask("local")
        with driver_of(ur_host) as driver:
            with pytest.raises(DeviceFaultError, match=r"remote control only .*URCapX") as error:
                driver.enable()
            assert "before timeout" not in str(error.value)
        assert "as it must be, is not known" in rows_of(ur_host)["remote control"].mend


def test_servo_that_stood_still_says_so(ur_robot):
    with device_of(ur_robot.host, watchdog_hz=10.0) as device:
        swing(device)
        streaming(device)
        pid = device.snapshot().servo_pid
        os.kill(pid, signal.SIGSTOP)
        time.sleep(0.19)
        os.kill(pid, signal.SIGCONT)
        fault, text, _ = fault_of(device)
        assert fault is Fault.DEVICE_FAULT
        assert "the robot's watchdog ended the control program: nothing was written for" in text
        assert "100 ms are allowed" in text
