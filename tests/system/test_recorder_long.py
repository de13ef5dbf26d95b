"""Recordings that take as long as what they hold.  Run with `make soak`."""

import json
import os
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from command_line import begin, environment
from harness import DEVICE, DaemonProcess, resident_kib, spin, until
from recorded import validated

from orientd.protocol import control_pb2 as pb
from orientd.recorder.reader import load_recording

pytestmark = pytest.mark.slow

RATE_HZ = 500.0
MINUTES = float(os.environ.get("ORIENTD_RECORD_MINUTES", "10"))
NOISY = 'model = "orientd_loopback.joint:LaggedBody"\nmodel_options = {noise = 2e-5}'
"""What is measured, rad: recordings are small where everything is smooth."""

ALONE = 30.0
"""s in which the daemon settles, and in which it is looked at while nothing is recorded."""


def spent(pid):
    """Return the processor time of a process, s."""
    ticks = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(ticks[11]) + int(ticks[12])) / os.sysconf("SC_CLK_TCK")


def patient(folder, **options):
    """Return a daemon whose lease lasts as long as a test."""
    return DaemonProcess(folder, rate_hz=RATE_HZ, lease=1800.0, **options)


@pytest.mark.timeout(0)
def test_minutes_in_motion_are_recorded_whole_small_and_cheaply(tmp_path):
    seconds, path = 60.0 * MINUTES, tmp_path / "a.mcap"
    with patient(tmp_path / "daemon", options=NOISY) as daemon:
        stream = daemon.move(spin(seconds + 2.0 * ALONE + 30.0))
        reading = threading.Thread(target=lambda: [None for _ in stream], daemon=True)
        reading.start()
        daemon_pid = daemon.process.pid
        recorder = begin("record", path, "--json", env=environment(ORIENTD_SOCKET=daemon.socket))
        until(lambda: path.exists() and path.stat().st_size > 0, "a recording", 30.0)
        time.sleep(ALONE)
        before, began = spent(daemon_pid), time.monotonic()
        before_recorder = spent(recorder.pid)
        time.sleep(seconds)
        passed = time.monotonic() - began
        recorded = (spent(daemon_pid) - before) / passed
        recording = (spent(recorder.pid) - before_recorder) / passed
        recorder.send_signal(signal.SIGINT)
        output, errors = recorder.communicate(timeout=30.0)
        assert (recorder.returncode, errors) == (0, "")
        # Afterwards: at first the daemon plans, and loads its compiled kernels.
        before, began = spent(daemon_pid), time.monotonic()
        time.sleep(ALONE)
        alone = (spent(daemon_pid) - before) / (time.monotonic() - began)
        state = daemon.device().state
        daemon.stub.Stop(pb.StopRequest())
        reading.join(10.0)
    told = json.loads(output)
    table = load_recording(path).cycles[DEVICE]
    size = path.stat().st_size / (len(table) / RATE_HZ / 60.0)
    cost = recorded - alone + recording
    print(
        f"\n{len(table)} cycles, {size / 1e6:.2f} MB a minute; daemon {alone:.1%} of a core, while "
        f"recorded {recorded:.1%}; recorder {recording:.1%}: recording costs {cost:.1%}"
    )
    assert state == pb.STATE_STREAMING
    assert told["lost"] == {DEVICE: 0}
    assert len(table) >= seconds * RATE_HZ
    assert np.all(np.diff(table["index"]) == 1)
    assert validated(path)[f"/{DEVICE}/cycles"] == len(table)
    assert size < 6_000_000
    assert cost <= 0.05


@pytest.mark.timeout(0)
def test_a_fault_leaves_the_whole_minute_before_it(tmp_path):
    fault = tmp_path / "fault"
    with patient(tmp_path / "daemon", options=f'fault_file = "{fault}"') as daemon:
        daemon.move(spin(120.0))
        until(lambda: daemon.device().path_time > 63.0, "a minute of motion", 90.0)
        assert resident_kib(daemon.process.pid) <= 80 * 1024  # with that minute in memory
        fault.write_text("device_fault")
        folder = daemon.folder / "state"
        (path,) = until(lambda: sorted(folder.rglob("flight-*.mcap")), "a file", 30.0)
    cycles = load_recording(path).cycles[DEVICE]
    (at,) = np.flatnonzero(np.diff(np.minimum(cycles["fault"], 1).astype(int)) == 1)
    held = (cycles["deadline_ns"][at] - cycles["deadline_ns"][0]) * 1e-9
    print(f"\n{held:.2f} s before the fault, {len(cycles) - at - 1} cycles from it on")
    assert np.all(np.diff(cycles["index"]) == 1)
    assert held >= 60.0
    assert cycles["fault"][at + 1] == 3  # Fault.DEVICE_FAULT
    assert validated(path)[f"/{DEVICE}/cycles"] == len(cycles)
