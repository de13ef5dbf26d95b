"""Tests of minutes: many motions in a row, and one very long motion.  Run with `make soak`."""

import numpy as np
import pytest
from harness import DaemonProcess, nudge, resident_kib

from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.slow

GROWTH_KIB = 2048
"""What the allocator may keep for itself between two looks at a process that does not grow."""


def sizes(daemon):
    """Return the resident memory of the daemon without the rings, and of the servo, KiB.

    The servo has all pages of the rings from the beginning.  The daemon maps each when it first
    touches it, so what it has of them grows up to what the servo has.
    """
    pid, servo = daemon.process.pid, daemon.device().servo_pid
    shared = resident_kib(pid, "RssShmem")
    assert shared <= resident_kib(servo, "RssShmem")
    return np.array([resident_kib(pid) - shared, resident_kib(servo)])


@pytest.mark.timeout(900)
def test_a_thousand_motions_in_a_row_leave_the_memory_as_it_was(tmp_path):
    with DaemonProcess(tmp_path, memory=1.0) as daemon:
        found = []
        for number in range(1000):
            daemon.renew()
            *_, last = daemon.move(nudge(0.002 if number % 2 else -0.002))
            assert last.summary.outcome == pb.OUTCOME_DONE, last
            if number % 100 == 99:
                found.append(sizes(daemon))
        print("\nKiB of daemon and servo after each hundred:", [tuple(size) for size in found])
        assert (found[-1] - found[0] < GROWTH_KIB).all()


@pytest.mark.timeout(900)
def test_a_motion_of_100_000_keyframes_streams_with_flat_memory(tmp_path):
    times = 0.004 * np.arange(100_000)
    end = times[-1]
    # A slow wandering that grows from rest and falls back to it.
    ramp = np.clip(np.minimum(times, end - times) / 2.0, 0.0, 1.0)
    ramp = ramp**3 * (10 - 15 * ramp + 6 * ramp**2)
    x, y, z = 0.3 * np.sin(0.8 * times), 0.2 * np.sin(1.1 * times), 0.4 * np.sin(0.3 * times)
    vectors = np.stack([ramp * x, ramp * y, ramp * z], axis=1)
    columns = pb.KeyframeColumns(rotation_vectors=vectors.ravel().tolist(), times=times.tolist())
    with DaemonProcess(tmp_path, memory=1.0, lease=900.0) as daemon:
        found, outcome = [], None
        sent = {"motion": b"approach: true", "columns": columns.SerializeToString()}
        for answer in daemon.move(**sent):
            if answer.HasField("progress"):
                share = answer.progress.path_time / answer.progress.duration
                if share >= 0.1 * (len(found) + 1):
                    found.append(sizes(daemon))
            elif answer.HasField("summary"):
                outcome = answer.summary
        print("\nKiB of daemon and servo after each tenth:", [tuple(size) for size in found])
        print(outcome.statistics)
        assert outcome.outcome == pb.OUTCOME_DONE, outcome.text
        assert len(found) >= 9
        assert (found[-1] - found[0] < GROWTH_KIB).all()
        daemon.assert_limits_kept()
