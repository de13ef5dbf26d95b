"""Cost of recording: processor time, disk and the daemon's memory."""

import time
import zlib

import pytest
from harness import DaemonProcess, resident_kib
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


@pytest.mark.timeout(300)
def test_the_daemon_is_small_with_a_minute_in_memory(tmp_path):
    with DaemonProcess(tmp_path / "daemon") as daemon:
        before = resident_kib(daemon.process.pid) / 1024
        time.sleep(65.0)
        resident = resident_kib(daemon.process.pid) / 1024
        print(f"\ndaemon {before:.1f} MiB, with a minute in memory {resident:.1f} MiB")
        assert resident <= 80.0
