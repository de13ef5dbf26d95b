"""Recordings of a real daemon are complete and correct, and disturb no motion."""

import json
import os
import resource
import signal
import time

import numpy as np
import pytest
from command_line import assert_refused, begin, environment, orientd
from hand_held import recorded as hand_held
from hand_held import truth
from harness import DEVICE, DaemonProcess, nudge, spin, until
from recorded_facts import configurations, states

from orientd import rotation
from orientd.protocol import control_pb2 as pb
from orientd.recorder.planned import planned_orientations
from orientd.recorder.reader import load_recording

pytestmark = pytest.mark.world


@pytest.fixture
def daemon(tmp_path):
    with DaemonProcess(tmp_path / "daemon") as process:
        yield process


def run_motion(daemon, seconds):
    """Run a motion to its end and return its summary."""
    for response in daemon.move(spin(seconds)):
        daemon.renew()
        summary = response.summary
    return summary


def recorder(daemon, path):
    """Return a recorder that has begun."""
    process = begin("record", path, "--json", env=environment(ORIENTD_SOCKET=str(daemon.socket)))

    def is_begun():
        daemon.renew()
        assert process.poll() is None, process.communicate()
        return path.exists() and path.stat().st_size > 0

    until(is_begun, "a recording", 30.0)
    return process


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A daemon that has run a motion, the recording of it, and what the recorder has said."""
    folder = tmp_path_factory.mktemp("recorded")
    path = folder / "a.mcap"
    with DaemonProcess(folder / "daemon") as daemon:
        process = recorder(daemon, path)
        run_motion(daemon, 1.0)
        process.send_signal(signal.SIGINT)
        output, errors = process.communicate(timeout=20)
        assert (process.returncode, errors) == (0, "")
        yield daemon, load_recording(path), json.loads(output)


def test_a_recording_of_one_second_has_the_cycles_of_one_second(daemon, tmp_path):
    done = orientd(
        "record",
        tmp_path / "a.mcap",
        "--seconds",
        "1",
        "--json",
        env=environment(ORIENTD_SOCKET=str(daemon.socket)),
    )
    cycles = load_recording(tmp_path / "a.mcap").cycles[DEVICE]
    assert json.loads(done.stdout)["cycles"] == {DEVICE: len(cycles)}
    lasted = 1e-9 * float(cycles["deadline_ns"][-1] - cycles["deadline_ns"][0])
    assert 0.9 < lasted < 1.0


def test_a_recording_has_every_cycle_as_it_was_sent_and_measured(recorded):
    daemon, recording, told = recorded
    cycles = recording.cycles[DEVICE]
    assert told["cycles"] == {DEVICE: len(cycles)}
    assert told["lost"] == {DEVICE: 0}
    assert np.all(np.diff(cycles["index"]) == 1)
    # What the driver itself has written down, one setpoint a cycle from the first one on.
    sent, index = daemon.sent(), cycles["index"]
    errors = [
        rotation.angle(cycles["sent_q"], sent[index - first]).max()
        for first in range(int(index[-1]) + 1 - len(sent), int(index[0]) + 1)
    ]
    assert min(errors) < 1e-9
    # The loopback returns every setpoint two cycles later, and that is read in the next one.
    lag = rotation.angle(cycles["measured_q"][10:], cycles["sent_q"][7:-3])
    assert float(np.median(lag)) < 2e-8
    assert np.all(cycles["feedback_time_ns"] < cycles["deadline_ns"])


def test_a_recording_has_plan_certificate_request_and_settings(recorded):
    daemon, recording, _ = recorded
    kinds = [event.kind for event in recording.events]
    assert kinds == [pb.EVENT_KIND_MOTION_STARTED, pb.EVENT_KIND_MOTION_DONE]
    started = recording.events[0]
    assert started.plan == daemon.started.plan
    assert json.loads(started.motion)["end_velocity"] == [0.3, 0.0, 0.5]
    path = daemon.folder.with_name("a.mcap")
    assert configurations(path)[""]["devices"][DEVICE]["driver"] == "loopback"
    assert states(path)[0].devices[0].name == DEVICE
    _, planned = planned_orientations(recording, DEVICE)
    known = np.isfinite(planned[:, 0])
    assert np.count_nonzero(known) >= started.plan.duration * 500
    away = rotation.angle(planned[known], recording.cycles[DEVICE]["sent_q"][known])
    assert float(away.max()) < 1e-12


def test_planned_values_are_those_of_the_plan(daemon, tmp_path):
    """Through a pause, changes of speed and a motion that replaces the first one."""
    command = {"lease_token": daemon.token, "device": DEVICE}

    def is_beyond(seconds):
        until(lambda: daemon.device().path_time > seconds, "motion")

    process = recorder(daemon, tmp_path / "a.mcap")
    replaced = daemon.move(spin(8.0))
    wanted = pb.GetPlanRequest(device=DEVICE, sample_rate_hz=500.0)
    plan = daemon.stub.GetPlan(wanted).plan
    is_beyond(0.3)
    daemon.stub.Pause(pb.CommandRequest(**command))
    until(lambda: daemon.device().cycle.speed == 0.0, "a pause")
    daemon.stub.Resume(pb.CommandRequest(**command))
    is_beyond(0.6)
    daemon.stub.SetSpeed(pb.SetSpeedRequest(speed=0.4, **command))
    is_beyond(0.9)
    daemon.stub.SetSpeed(pb.SetSpeedRequest(speed=1.0, **command))
    *_, last = daemon.move(nudge(0.4))
    assert last.summary.outcome == pb.OUTCOME_DONE
    *_, first = replaced
    assert first.summary.outcome == pb.OUTCOME_REPLACED
    process.send_signal(signal.SIGINT)
    assert process.communicate(timeout=20)[1] == ""
    done = orientd("export", tmp_path / "a.mcap", "-o", tmp_path / "a.npz")
    assert done.returncode == 0, done.stderr
    with np.load(tmp_path / "a.npz") as opened:
        table = dict(opened)
    planned, sent = (
        np.stack([table[f"{group}_q{axis}"] for axis in "wxyz"], axis=1)
        for group in ("planned", "sent")
    )
    on_path = table["motion"] > 0
    numbers = first.summary.motion_number, last.summary.motion_number
    assert set(table["motion"][on_path]) == set(numbers)
    assert np.isnan(planned[~on_path]).all()
    away = rotation.angle(planned[on_path], sent[on_path])
    assert float(away.max()) < 1e-12
    assert max(one.summary.statistics.path_error for one in (first, last)) < 1e-12
    # Up to the pause, each cycle is at a record of the plan.
    of_first, speed = table["motion"] == numbers[0], table["speed"]
    paused = np.flatnonzero(of_first & (speed == 0.0) & (table["path_time_s"] > 0.0))[0]
    rows = np.flatnonzero((of_first & (speed == 1.0))[:paused])
    records = np.rint(table["path_time_s"][rows] * 500.0).astype(int)
    own = np.reshape(plan.samples.q, (-1, 4))[records]
    assert len(rows) > 100
    assert float(rotation.angle(planned[rows], own).max()) < 1e-9


@pytest.mark.real
def test_a_full_disk_ends_the_recording_and_not_the_motion(daemon, tmp_path):
    process = recorder(daemon, tmp_path / "a.mcap")
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (30_000, 30_000))
    summary = run_motion(daemon, 2.0)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=20)
    assert process.returncode == 1
    (line,) = errors.splitlines()
    assert "File too large" in line
    assert "Traceback" not in line
    assert summary.outcome == pb.OUTCOME_DONE
    assert daemon.device().state == pb.STATE_HOLDING


def test_a_device_that_is_not_there_is_refused(daemon, tmp_path):
    done = orientd("record", tmp_path / "a.mcap", "-d", "leg", "--socket", daemon.socket)
    assert_refused(done, "expected one of arm, got 'leg'")


def flight_files(daemon):
    return sorted((daemon.folder / "state").rglob("flight-*.mcap"))


def test_a_fault_leaves_a_file_with_its_cycle_and_all_before(tmp_path):
    fault = tmp_path / "fault"
    with DaemonProcess(tmp_path / "daemon", options=f'fault_file = "{fault}"') as daemon:
        events = daemon.stub.WatchEvents(pb.WatchEventsRequest())
        assert not next(events).events
        daemon.move(spin(20.0))
        until(lambda: daemon.device().path_time > 0.5, "motion")
        fault.write_text("device_fault")
        (path,) = until(lambda: flight_files(daemon), "a file")
        seen = []
        while pb.EVENT_KIND_RECORDED not in (event.kind for event in seen):
            seen += next(events).events
        events.cancel()
    assert seen[-1].text == str(path)
    recording = load_recording(path)
    cycles = recording.cycles[DEVICE]
    np.testing.assert_array_equal(cycles["index"], np.arange(len(cycles)))
    (at,) = np.flatnonzero(np.diff(np.minimum(cycles["fault"], 1).astype(int)) == 1)
    assert cycles["fault"][at] == 0
    assert cycles["fault"][at + 1] == 3  # Fault.DEVICE_FAULT
    # The second after it, of which a busy machine may have missed some cycles.
    assert cycles["deadline_ns"][-1] - cycles["deadline_ns"][at] > 800_000_000
    kinds = [event.kind for event in recording.events]
    assert pb.EVENT_KIND_FAULT in kinds
    assert pb.EVENT_KIND_MOTION_STARTED in kinds
    (started,) = (e for e in recording.events if e.kind == pb.EVENT_KIND_MOTION_STARTED)
    assert started.plan.certificate.duration > 20.0


@pytest.mark.world
def test_faults_that_follow_each_other_within_a_second_leave_one_file(tmp_path):
    fault = tmp_path / "fault"

    def fail():
        fault.write_text("device_fault")
        until(lambda: daemon.device().state == pb.STATE_FAULT, "the fault")
        fault.unlink()
        daemon.stub.Reset(pb.CommandRequest(lease_token=daemon.token, device=DEVICE))

    with DaemonProcess(tmp_path / "daemon", options=f'fault_file = "{fault}"') as daemon:
        time.sleep(0.5)  # in which there are cycles to record
        for _ in range(3):
            fail()
        until(lambda: flight_files(daemon), "the file of the first fault")
        time.sleep(2.0)
        assert len(flight_files(daemon)) == 1
        fail()
        until(lambda: len(flight_files(daemon)) == 2, "the file of a later fault")


def test_a_servo_that_is_killed_leaves_a_file_up_to_its_last_cycle(daemon):
    run_motion(daemon, 0.5)
    last = daemon.device().cycle.index
    os.kill(daemon.device().servo_pid, signal.SIGKILL)
    (path,) = until(lambda: flight_files(daemon), "a file")
    cycles = load_recording(path).cycles[DEVICE]
    np.testing.assert_array_equal(cycles["index"], np.arange(len(cycles)))
    assert len(cycles) > last


def test_a_flight_recorder_that_cannot_write_says_so_and_the_daemon_goes_on(tmp_path):
    process = DaemonProcess(tmp_path / "daemon")
    (tmp_path / "taken").write_text("a file where a directory is to be")
    text = process.config.read_text()
    directory = f'directory = "{tmp_path}/taken/here"'
    process.config.write_text(text.replace("[recorder]", f"[recorder]\n{directory}"))
    with process as daemon:
        os.kill(daemon.device().servo_pid, signal.SIGKILL)
        log = daemon.folder / "log"
        until(lambda: "recording failed: " in log.read_text(), "a line in the log")
        daemon.stub.Reset(pb.CommandRequest(lease_token=daemon.token, device=DEVICE))
        until(lambda: daemon.device().state == pb.STATE_HOLDING, "rest")
        (line,) = [line for line in log.read_text().splitlines() if "recording failed" in line]
        assert "Not a directory" in line


def test_a_replay_moves_the_device_through_what_was_recorded(daemon, tmp_path):
    table = tmp_path / "hand.csv"
    times, q = hand_held(2, seconds=4.0, wild=2)
    rows = [",".join(map(str, (t, *one))) for t, one in zip(times, q, strict=True)]
    table.write_text("\n".join(["time_s,qw,qx,qy,qz", *rows]))
    daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
    done = orientd("replay", table, "--json", "--socket", daemon.socket)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["slower"] == pytest.approx(1.0)
    sent = daemon.sent()
    daemon.assert_limits_kept()
    # Every tenth of a second of the turning is passed, in its order.
    place = 0
    for t in np.arange(0.4, 3.6, 0.1):
        away = rotation.angle(sent[place:], truth(t))
        place += int(np.argmin(away))
        assert float(away.min()) < np.radians(1.0)
