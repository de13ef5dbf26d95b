"""Effects on a motion when a process is killed during it."""

import json
import os
import random
import signal
import subprocess
import time

import numpy as np
import pytest
from command_line import begin, inside
from harness import (
    DEVICE,
    DaemonProcess,
    assert_limits_kept,
    is_alive,
    planned_path,
    spin,
    until,
)

from orientd import rotation
from orientd.protocol import control_pb2 as pb
from orientd.recorder.reader import load_recording

pytestmark = pytest.mark.world

RANDOM = random.Random(7)
MOMENTS = [
    pytest.param(round(RANDOM.uniform(0.02, 3.2), 3), marks=() if k < 3 else pytest.mark.slow)
    for k in range(10)
]


def largest_deviation(sent, motion):
    """Return how far off the planned path what was sent lies, rad.

    The setpoints come in the order of the path, so each is looked for beyond the one before it.
    """
    time, worst = 0.0, 0.0
    for q in sent:
        low, high = time, min(time + 1.5 * motion.period, motion.duration)
        for _ in range(60):
            a, b = low + (high - low) / 3, high - (high - low) / 3
            gap_a, gap_b = rotation.angle(motion.sample([a, b]).q, q)
            low, high = (low, b) if gap_a <= gap_b else (a, high)
        time = 0.5 * (low + high)
        worst = max(worst, float(rotation.angle(motion.sample([time]).q, q)[0]))
    return worst


def is_moving(sent):
    return len(sent) > 1 and not np.array_equal(sent[-1], sent[-2])


def moving_part(sent):
    """Return the setpoints from the last one at the start to the first at the final rest."""
    changes = np.flatnonzero(np.any(sent[1:] != sent[:-1], axis=1))
    return sent[changes[0] : changes[-1] + 2] if len(changes) else sent[:1]


@pytest.mark.parametrize("moment", MOMENTS)
def test_a_killed_daemon_leaves_a_stop_on_the_path_and_nothing_else(tmp_path, moment):
    with DaemonProcess(tmp_path, patience=None) as daemon:
        request = spin(3.0)
        daemon.move(request)
        servo = daemon.device().servo_pid
        time.sleep(moment)
        os.kill(daemon.process.pid, signal.SIGKILL)
        daemon.process.wait()
        until(lambda: not is_alive(servo), "the servo process ends")
        daemon.end()

        report = json.loads(daemon.report.read_text())
        assert report["reason"] == "the daemon is gone"
        assert report["state"] == "holding"
        # Others may test beside this one.
        assert not [name for name in os.listdir("/dev/shm") if "orientd" in name]
        sent = daemon.sent()
        daemon.assert_limits_kept()
        assert np.array_equal(sent[-1], sent[-2])  # it ends at rest
        path = moving_part(sent)
        motion = planned_path(daemon, request)
        exact = motion.sample(np.arange(len(path)) * daemon.period).q
        off_grid = np.flatnonzero(rotation.angle(exact, path) > 1e-12)
        first = off_grid[0] if len(off_grid) else len(path)
        stop = path[first:]
        if len(stop):
            begin = max(0.0, (first - 1) * daemon.period)
            tail = _shifted(motion, begin)
            assert largest_deviation(stop, tail) < 5e-7

        with DaemonProcess(tmp_path) as successor:  # the same socket, at once
            assert successor.device().state == pb.STATE_HOLDING


LONG = {
    "keyframes": [{"rotation_vector": [0, 0, 0.0]}, {"rotation_vector": [0, 0, 3.0]}],
    "limits": {"velocity": 0.05},
}
LOST_MOTION = "lost the daemon during motion 1; the device brakes on its path"


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (("move", "{0}/motion.json"), LOST_MOTION),
        (("turn", "--rate", "0.2"), LOST_MOTION),
        (("track",), "lost the daemon; the device comes to rest"),
        (
            ("record", "{0}/run.mcap"),
            "lost the daemon at {0}/control.sock; {0}/run.mcap is whole up to there",
        ),
    ],
    ids=lambda one: one[0] if isinstance(one, tuple) else "",
)
def test_a_command_says_what_it_has_lost_when_its_daemon_is_killed(tmp_path, command, message):
    (tmp_path / "motion.json").write_text(json.dumps(LONG))
    run = tmp_path / "run.mcap"
    with DaemonProcess(tmp_path) as daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        arguments = [part.format(tmp_path) for part in command]
        process = begin(*arguments, "--socket", daemon.socket, stdin=subprocess.PIPE)
        if command[0] == "track":
            # Afterwards nothing comes through standard input, and it stays open.
            process.stdin.write('{"rotation_vector": [0, 0, 0.1]}\n')
            process.stdin.flush()
            until(lambda: daemon.device().cycle.q.z > 0.0, "the first target is followed")
        else:
            assert process.stdout.readline()
        if command[0] == "record":
            until(lambda: run.exists() and run.stat().st_size > 20_000, "cycles in the file")
        daemon.process.kill()
        assert process.wait(30.0) == 1
        _, errors = process.communicate()
        assert errors == f"orientd: {message.format(tmp_path)}\n"
    if command[0] == "record":
        assert load_recording(run).is_complete


def _shifted(motion, begin):
    """Return *motion* with its path time beginning at *begin*."""

    class Rest:
        period = motion.period
        duration = motion.duration - begin

        @staticmethod
        def sample(times):
            return motion.sample(np.asarray(times) + begin)

    return Rest


def test_a_killed_servo_is_told_and_reset_brings_it_back(tmp_path):
    with DaemonProcess(tmp_path, patience=None) as daemon:
        stream = daemon.move(spin(12.0))
        servo = daemon.device().servo_pid
        until(lambda: is_moving(daemon.sent()), "the motion")
        os.kill(servo, signal.SIGKILL)
        report = until(
            lambda: (found := daemon.device()).state == pb.STATE_FAULT and found, "the fault"
        )
        assert report.fault == pb.FAULT_SERVO_DIED
        assert "signal 9" in report.fault_text
        summary = [answer for answer in stream if answer.HasField("summary")][-1].summary
        assert summary.outcome == pb.OUTCOME_FAULT
        assert "signal 9" in summary.text

        daemon.stub.Reset(pb.CommandRequest(lease_token=daemon.token, device=DEVICE))
        assert daemon.device().state == pb.STATE_HOLDING
        ended = daemon.device().ended
        assert (ended.motion_number, ended.outcome) == (1, pb.OUTCOME_FAULT)
        assert 0.0 < ended.path_time < ended.duration
        assert "signal 9" in inside("status", "--socket", daemon.socket).stdout
        assert daemon.device().servo_pid not in (0, servo)
        *_, last = daemon.move(spin(1.0))
        assert last.summary.outcome == pb.OUTCOME_DONE


def test_a_stopped_daemon_process_is_a_lost_heartbeat(tmp_path):
    """SIGSTOP: the daemon is there but does nothing; when it goes on, it tells the fault."""
    with DaemonProcess(tmp_path, patience=None) as daemon:
        daemon.move(spin(12.0))
        # With the path fed as far ahead as it is to be: a motion begins with less.
        until(lambda: daemon.device().path_time > 0.2, "the motion")
        daemon.process.send_signal(signal.SIGSTOP)
        until(lambda: not is_moving(daemon.sent()), "the stop")
        stopped = daemon.sent()
        daemon.process.send_signal(signal.SIGCONT)
        assert_limits_kept(stopped, daemon.period)
        report = until(
            lambda: (found := daemon.device()).state == pb.STATE_FAULT and found, "the fault"
        )
        assert report.fault == pb.FAULT_HEARTBEAT_LOST
        assert "no heartbeat from the daemon" in report.fault_text
