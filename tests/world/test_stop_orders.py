"""Client, daemon, servo and link stand still, in every order, and go on in another one.

Whatever the order, the device comes to rest on its path within its limits, nothing moves after a
fault, and a reset and a motion work afterwards.
"""

import itertools
import json
import os
import random
import signal
import time

import numpy as np
import pytest
from command_line import begin
from harness import DEVICE, DaemonProcess, assert_limits_kept, nudge, until
from scipy.spatial import cKDTree

from orientd import motion_file, rotation
from orientd.model.limits import DEFAULT_LIMITS
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.protocol import control_pb2 as pb
from orientd.servo.watchdog import SHORTEST_NS
from orientd_loopback import read_recording

pytestmark = pytest.mark.world

ORDERS = list(itertools.permutations(("client", "daemon", "servo", "link")))
SEEDS = int(os.environ.get("ORIENTD_CASES", "1"))

EXPECTED = {
    pb.FAULT_FEEDBACK_STALE,
    pb.FAULT_HEARTBEAT_LOST,
    pb.FAULT_PATH_STARVED,
    pb.FAULT_SERVO_STALLED,
}
"""What they may end in; none of them makes the servo break a limit."""

LEASE = 2.0
SECONDS = 4.0
OFF_PATH = 5e-7
"""Angle of a setpoint from its path, rad: half way between two records."""

VECTORS = [[0.0, 0.0, 0.0], [0.3, 0.1, 0.7], [0.2, -0.4, 1.6], [-0.3, 0.2, 2.4], [0.0, 0.0, 2.9]]
TIMES = [SECONDS * k / (len(VECTORS) - 1) for k in range(len(VECTORS))]


MOTION = {
    "keyframes": [{"time": t, "rotation_vector": v} for t, v in zip(TIMES, VECTORS, strict=True)],
    "approach": True,
}


class Life:
    """A daemon, a client with a motion, and what stops each of them."""

    def __init__(self, folder):
        self.fault, self.motion = folder / "fault", folder / "motion.json"
        self.motion.write_text(json.dumps(MOTION))
        options = f'fault_file = "{self.fault}"'
        self.daemon = DaemonProcess(folder, patience=None, lease=LEASE, options=options)

    def begin(self):
        """Start the daemon and the client, and wait for the motion."""
        self.daemon.start()
        self.daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=self.daemon.token))
        self.client = begin("move", self.motion, "--socket", self.daemon.socket)
        until(lambda: self.daemon.device().path_time > 0.2, "the motion")
        self.servo = self.daemon.device().servo_pid

    def signal(self, which, number):
        """Stop one of them, or let it go on."""
        if which == "link":
            self.fault.write_text("feedback_stale" if number == signal.SIGSTOP else "")
        elif which == "servo":
            os.kill(self.servo, number)
        else:
            (self.client if which == "client" else self.daemon.process).send_signal(number)

    def sent(self):
        """Return times, ns, and orientations of what the device was sent."""
        setpoints = read_recording(self.daemon.recording)
        return (
            np.array([setpoint.time_ns for setpoint in setpoints]),
            np.array([setpoint.q for setpoint in setpoints]),
        )


def assert_within_limits(times, q, period):
    """Check the limits of all setpoints; a device that is sent nothing holds the last one."""
    gaps = np.flatnonzero(np.diff(times) > SHORTEST_NS)
    for first, last in itertools.pairwise([0, *gaps, len(q) - 1]):
        assert_limits_kept(q[first : last + 1], period)


def assert_on_path(q, motion):
    """Check that setpoints lie on a motion's path, each of them not before the one before."""
    times = np.arange(0.0, motion.duration, motion.period / 20.0)
    path = motion.sample(times)
    grid = path.q * np.sign(path.q @ q[0])[:, None]
    q = q * np.sign(q @ q[0])[:, None]
    place = cKDTree(grid).query(q)[1]
    away = rotation.log(rotation.multiply(rotation.conjugate(grid[place]), q))
    omega = path.omega_body[place]
    speed = np.maximum(np.linalg.norm(omega, axis=1, keepdims=True), 1e-9)
    along = np.sum(away * omega, axis=1, keepdims=True) / speed
    assert np.linalg.norm(away - along * omega / speed, axis=1).max() < OFF_PATH
    passed = times[place] + (along / speed)[:, 0]
    is_moving = speed[:, 0] > 1e-3
    assert np.all(np.diff(passed[is_moving]) > -1e-6)


def live(life, order, rng):
    """Stop all of them in one order, let them go on in another, and judge what was sent."""
    life.begin()
    scale = rng.choice([0.1, 0.5, 1.0])
    for which in order:
        life.signal(which, signal.SIGSTOP)
        time.sleep(scale * rng.uniform(0.0, 0.5))
    time.sleep(scale * rng.uniform(0.0, 1.5))
    for which in rng.sample(order, 4):
        life.signal(which, signal.SIGCONT)
        time.sleep(scale * rng.uniform(0.0, 0.8))

    daemon = life.daemon
    state = until(
        lambda: (found := daemon.device().state) in (pb.STATE_FAULT, pb.STATE_HOLDING) and found,
        "rest",
    )
    if state == pb.STATE_FAULT:
        assert daemon.device().fault in EXPECTED
        before = len(life.sent()[1])
        time.sleep(0.5)
        assert np.ptp(life.sent()[1][before - 1 :], axis=0).max() == 0.0
    until(lambda: life.client.poll() is not None, "the end of the client's motion")

    times, q = life.sent()
    assert_within_limits(times, q, daemon.period)
    start = State.at_rest((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    limits = DEFAULT_LIMITS
    request = motion_file.parse(MOTION)
    assert_on_path(q, plan(request, start=start, limits=limits, period=daemon.period))

    life.client.communicate()
    until(lambda: not daemon.stub.GetState(pb.GetStateRequest()).daemon.leases, "the lease")
    daemon.token = daemon.stub.AcquireLease(pb.AcquireLeaseRequest(holder="test")).lease.token
    if state == pb.STATE_FAULT:
        daemon.stub.Reset(pb.CommandRequest(lease_token=daemon.token, device=DEVICE))
    for answer in daemon.move(nudge(0.4)):
        daemon.renew()
        summary = answer.summary
    assert (summary.outcome, summary.text) == (pb.OUTCOME_DONE, "")
    return state, life.client.returncode


@pytest.mark.parametrize("seed", range(SEEDS))
@pytest.mark.parametrize("order", ORDERS, ids="-".join)
def test_in_whatever_order_all_stand_still_the_device_rests_on_its_path(tmp_path, order, seed):
    rng = random.Random(f"{seed} {' '.join(order)}")
    life = Life(tmp_path)
    try:
        print(*live(life, order, rng))
    finally:
        life.daemon.end()


def test_a_command_to_a_servo_that_stands_still_is_answered_when_it_goes_on(tmp_path):
    """The daemon tells the servo to stop all that time, and that displaces no other command."""
    with DaemonProcess(tmp_path) as daemon:
        moving = daemon.move(nudge(0.8))
        until(lambda: daemon.device().path_time > 0.2, "the motion")
        servo = daemon.device().servo_pid
        os.kill(servo, signal.SIGSTOP)
        moving.cancel()
        time.sleep(0.1)
        command = pb.CommandRequest(lease_token=daemon.token, device=DEVICE)
        enabling = daemon.stub.Enable.future(command, timeout=5.0)
        time.sleep(0.3)
        os.kill(servo, signal.SIGCONT)
        enabling.result()
        *_, last = daemon.move(nudge(-0.4))
    assert last.summary.outcome == pb.OUTCOME_DONE
