"""A device's timeouts are as long as its configuration says, and the shipped ones are."""

import math
import os
import signal
import time

import grpc
import pytest
from harness import DaemonProcess, nudge, until
from motions import through

from orientd.protocol import control_pb2 as pb
from orientd_loopback import read_recording

pytestmark = pytest.mark.world

SPEED = 0.3
EARLY, LATE = 0.2, 0.06
"""Shares of a timeout, or time in s, by which a stop may begin early or late.

The daemon's last heartbeat is a little older than its stop, and a cycle ends what it began.
"""

SHIPPED = {"heartbeat": 1.0, "feedback": 0.1, "stall": 0.5}


@pytest.fixture
def turning(tmp_path):
    """Return a function that makes a daemon, turning at a steady speed, of its timeouts."""
    daemons = []

    def make(**timeouts):
        options = f'fault_file = "{tmp_path / "fault"}"\n'
        daemon = DaemonProcess(tmp_path, patience=None, options=options)
        given = "".join(f"{name}_timeout = {value}\n" for name, value in timeouts.items())
        head = '[devices.arm]\ndriver = "loopback"\n'
        text = daemon.config.read_text()
        assert head in text
        daemon.config.write_text(text.replace(head, head + given))
        daemon.start()
        daemons.append(daemon)
        daemon.move(through([(0, 0, 3)], limits={"velocity": SPEED}))
        until(lambda: daemon.device().path_time > 1.0, "the steady speed")
        return daemon

    yield make
    for daemon in daemons:
        daemon.process.send_signal(signal.SIGCONT)
        daemon.end()


def slowed(daemon, since_ns):
    """Return how long after a time the device was slowed down, s; ``None`` if it was not."""
    for setpoint in read_recording(daemon.recording):
        if setpoint.time_ns > since_ns and math.hypot(*setpoint.omega_body) < 0.999 * SPEED:
            return (setpoint.time_ns - since_ns) * 1e-9
    return None


@pytest.mark.parametrize("timeout", [0.4, SHIPPED["heartbeat"]])
def test_the_servo_brakes_once_the_daemon_was_silent_for_the_heartbeat_timeout(turning, timeout):
    daemon = turning(**({} if timeout == SHIPPED["heartbeat"] else {"heartbeat": timeout}))
    began = time.monotonic_ns()
    daemon.process.send_signal(signal.SIGSTOP)
    until(lambda: slowed(daemon, began), "the stop")
    assert (1.0 - EARLY) * timeout <= slowed(daemon, began) <= timeout + LATE


@pytest.mark.parametrize("timeout", [0.3, SHIPPED["feedback"]])
def test_the_servo_brakes_once_the_feedback_is_older_than_the_feedback_timeout(
    turning, tmp_path, timeout
):
    daemon = turning(**({} if timeout == SHIPPED["feedback"] else {"feedback": timeout}))
    began = time.monotonic_ns()
    (tmp_path / "fault").write_text("feedback_stale")
    until(lambda: slowed(daemon, began), "the stop")
    assert (1.0 - EARLY) * timeout <= slowed(daemon, began) <= timeout + LATE
    until(lambda: daemon.device().fault == pb.FAULT_FEEDBACK_STALE, "the fault")


@pytest.mark.parametrize("share", [0.8, 1.2])
@pytest.mark.parametrize("timeout", [0.25, SHIPPED["stall"]])
def test_a_motion_resumes_after_a_stall_shorter_than_the_stall_timeout_alone(
    turning, timeout, share
):
    daemon = turning(**({} if timeout == SHIPPED["stall"] else {"stall": timeout}))
    servo = daemon.device().servo_pid
    os.kill(servo, signal.SIGSTOP)
    time.sleep(share * timeout)
    os.kill(servo, signal.SIGCONT)
    resumed = time.monotonic()
    until(lambda: time.monotonic() > resumed + 0.3, "some cycles")
    is_fault = daemon.device().state == pb.STATE_FAULT
    assert is_fault == (share > 1.0)
    assert (daemon.device().state == pb.STATE_STREAMING) == (share < 1.0)


def test_no_client_plans_for_longer_than_the_configuration_allows(tmp_path):
    daemon = DaemonProcess(tmp_path)
    table = "[planner]\nprocesses = 1\nplan_timeout = 1.0\n"
    daemon.config.write_text(daemon.config.read_text() + table)
    with daemon:
        for planner in daemon.planners():
            os.kill(planner, signal.SIGSTOP)
        with pytest.raises(grpc.RpcError, match="planning took longer than 1 s"):
            daemon.stub.Plan(pb.PlanRequest(motion=nudge(0.1), plan_timeout=20.0))
