"""Robots of every version: what doctor says of them, what the driver does without."""

import os
import signal
import socket
import threading
import time

import pytest
from ur_rig import device_of, fault_of, streaming, swing

from emulated_ur import EmulatedRobot
from orientd.clock import MonotonicClock
from orientd.driver import Setpoint, Verdict
from orientd.errors import DeviceFaultError, Fault, LinkError
from orientd.floats import difference, norm
from orientd_ur import UrDriver
from orientd_ur.doctor import _link, _remote_control
from orientd_ur.probe import Probe
from orientd_ur.wire import Dashboard

pytest.importorskip("rtde_control")

pytestmark = pytest.mark.world

TOOL = [0.0, 0.0, 0.1, 0.0, 0.0, 0.0]


def driver_of(host, *, rate_hz=500, **options):
    return UrDriver(
        {"host": host, **options}, period_ns=round(1e9 / rate_hz), clock=MonotonicClock()
    )


def rows_of(host, **options):
    return {one.name: one for one in driver_of(host, **options).diagnose()}


@pytest.mark.parametrize("version", ["5.4.3", "5.5.0"])
@pytest.mark.parametrize("options", [{}, {"tcp_offset": TOOL}])
def test_tool_of_a_robot_that_does_not_say_it_is_seen(ur_host, version, options):
    with EmulatedRobot(ur_host, "--polyscope", version):
        rows = rows_of(ur_host)
        assert rows["version"].verdict is Verdict.OK
        assert rows["remote control"].verdict is Verdict.OK
        assert rows["arm"].verdict is Verdict.OK
        driver = driver_of(ur_host, **options)
        try:
            driver.open()
            start = driver.enable()
            assert not driver.notices()
            # As the planner asks, on a driver that is not open.
            arm = driver_of(ur_host, **options).mechanism(may_ask=True)
            q, position = arm.forward(start.joints)
            assert position == pytest.approx(start.position, abs=1e-6)
            assert norm(difference(q, start.q)) < 1e-6
            begin = driver.offline_start(from_device=True)
            assert begin.position == pytest.approx(start.position, abs=1e-6)
        finally:
            driver.close()


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
            driver_of(ur_host, rate_hz=125).open()


def test_rate_that_a_robot_does_not_take_is_found_before_it_runs(ur_host):
    with EmulatedRobot(ur_host, "--model", "ur5"):
        found = rows_of(ur_host)["rate"]
        assert found.verdict is Verdict.PROBLEM
        assert "`rate_hz` must be 125 at the most" in found.mend
        with pytest.raises(LinkError, match="`rate_hz` must be 125 at the most"):
            driver_of(ur_host).open()
        assert rows_of(ur_host, rate_hz=125)["rate"].verdict is Verdict.OK


def test_link_is_judged_by_the_cycle_of_the_robot():
    fields = (True, 7, 1, 1, True, 0.0005, 0.00506)
    assert _link(Probe((3, 15, 8, 0), *fields)).verdict is Verdict.OK
    assert _link(Probe((5, 12, 6, 0), *fields)).verdict is Verdict.IMPROVE


@pytest.mark.real
def test_question_that_a_dashboard_does_not_understand_is_not_answered_with_no(ur_host):
    def serve(server):
        with server.accept()[0] as client:
            client.sendall(b"Connected: Universal Robots Dashboard Server\n")
            client.recv(4096)
            client.sendall(b"could not understand: is in remote control\n")
            client.recv(4096)

    with socket.create_server((ur_host, 29999)) as server:
        thread = threading.Thread(target=serve, args=(server,))
        thread.start()
        with Dashboard(ur_host) as dashboard:
            assert dashboard.is_remote is None
        thread.join()
    found = _remote_control(
        Probe((5, 12, 6, 0), None, 7, 1, 1, True, 0.0005, 0.0005), is_needed=True
    )
    assert (found.found, found.verdict) == ("not known", Verdict.IMPROVE)


def test_polyscope_x_in_local_control_is_told_what_it_needs(ur_host):
    with EmulatedRobot(ur_host, "--polyscope", "10.11") as robot:
        robot.ask("local")
        driver = driver_of(ur_host)
        try:
            driver.open()
            with pytest.raises(DeviceFaultError, match=r"remote control only .*URCapX") as error:
                driver.enable()
            assert "before timeout" not in str(error.value)
        finally:
            driver.close()
        assert "as it must be, is not known" in rows_of(ur_host)["remote control"].mend


def streamed(robot):
    driver = driver_of(robot.host, watchdog_hz=10.0, feedback_timeout=0.5)
    driver.open()
    start = driver.enable()

    def cycle():
        driver.read()
        driver.write(Setpoint(0, start.q, position=start.position))
        time.sleep(0.002)

    for _ in range(50):
        cycle()
    return driver, cycle


def reason_of(cycle):
    for _ in range(500):
        try:
            cycle()
        except DeviceFaultError as error:
            return str(error)
    raise AssertionError("no fault")


def test_program_that_the_watchdog_ended_is_not_said_to_have_been_stopped(ur_robot):
    driver, cycle = streamed(ur_robot)
    try:
        time.sleep(0.19)
        reason = reason_of(cycle)
        assert "the robot's watchdog ended the control program: nothing was written for" in reason
        assert "100 ms are allowed" in reason
    finally:
        driver.close()


def test_program_that_somebody_stopped_is_said_to_have_been_stopped(ur_robot):
    driver, cycle = streamed(ur_robot)
    try:
        ur_robot.ask("stop")
        assert reason_of(cycle) == "the control program was stopped; reset to start it again"
    finally:
        driver.close()


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
        assert "nothing was written for" in text
