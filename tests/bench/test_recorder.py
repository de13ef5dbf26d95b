"""Cost of recording: processor time, disk and the daemon's memory."""

import os
import signal
import time
import zlib
from pathlib import Path

import pytest
from command_line import begin, environment
from harness import DaemonProcess, resident_kib, until
from recorded import OFFSET_NS, RATE_HZ, moving

from orientd.recorder.writer import RecordingWriter

pytestmark = pytest.mark.bench

MINUTE = round(60 * RATE_HZ)


@pytest.mark.parametrize("joints", [0, 6])
def test_a_minute_in_motion_takes_six_megabytes_at_the_most(tmp_path, joints):
    table = moving(MINUTE, joints=joints)
    began = time.process_time()
    with RecordingWriter(tmp_path / "a.mcap", offset_ns=OFFSET_NS) as writer:
        writer.add_device("arm", RATE_HZ)
        for at in range(0, MINUTE, 125):
            writer.add_cycles("arm", table[at : at + 125])
            writer.flush()
    spent = time.process_time() - began
    size = (tmp_path / "a.mcap").stat().st_size
    peer = len(zlib.compress(table.tobytes(), 6))
    print(
        f"\n{joints} joints: {size / 1e6:.2f} MB and {spent / 0.6:.2f} % of a core for a minute; "
        f"the records deflated: {peer / 1e6:.2f} MB, ratio {size / peer:.2f}"
    )
    assert size < 6_000_000
    assert size < peer


def spent(pid):
    """Return the processor time of a process, s."""
    ticks = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(ticks[11]) + int(ticks[12])) / os.sysconf("SC_CLK_TCK")


def shares(seconds, *pids):
    """Return what share of a core each process takes."""
    before, began = [spent(pid) for pid in pids], time.monotonic()
    time.sleep(seconds)
    passed = time.monotonic() - began
    return [(spent(pid) - b) / passed for pid, b in zip(pids, before, strict=True)]


@pytest.mark.timeout(300)
def test_recording_takes_five_percent_of_a_core_at_the_most(tmp_path):
    with DaemonProcess(tmp_path / "daemon") as daemon:
        (alone,) = shares(10.0, daemon.process.pid)
        path = tmp_path / "a.mcap"
        recorder = begin("record", path, env=environment(ORIENTD_SOCKET=str(daemon.socket)))
        until(lambda: path.exists() and path.stat().st_size, "a recording", 30.0)
        recorded, recording = shares(10.0, daemon.process.pid, recorder.pid)
        recorder.send_signal(signal.SIGINT)
        recorder.communicate(timeout=20)
        print(f"\ndaemon {alone:.1%}, while recorded {recorded:.1%}, recorder {recording:.1%}")
        assert recorded - alone + recording <= 0.05


@pytest.mark.timeout(300)
def test_the_daemon_is_small_with_a_minute_in_memory(tmp_path):
    with DaemonProcess(tmp_path / "daemon") as daemon:
        before = resident_kib(daemon.process.pid) / 1024
        time.sleep(65.0)
        resident = resident_kib(daemon.process.pid) / 1024
        print(f"\ndaemon {before:.1f} MiB, with a minute in memory {resident:.1f} MiB")
        assert resident <= 80.0
