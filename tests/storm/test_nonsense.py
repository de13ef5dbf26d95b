"""The punctuality of a motion with a flood of nonsense calls and without, in paired slots.

Run with `make storm`.  For fewer calls: ORIENTD_FUZZ_CALLS.
"""

import os
import random
import statistics
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from every_call import SERVICE
from harness import DaemonProcess, resident_kib, spin, until
from nonsense import pour

from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.storm

CALLS = int(os.environ.get("ORIENTD_FUZZ_CALLS", "1000000"))
PAIRS = 10
ALONE = 20.0
"""How long a slot without calls lasts, s."""

MOST = 1.2
"""How many times as late."""

GROWTH_KIB = 8 * 1024

WITHOUT = ("Stop", "Halt", "SeizeLease")
"""What anybody may do who comes in, and what ends a motion."""


def lateness(daemon, until_done):
    """Return the p99 lateness of the cycles until then, s."""
    late = []
    stream = daemon.stub.WatchState(pb.WatchStateRequest(rate_hz=10.0))
    for batch in stream:
        late += [1e-9 * cycle.lateness_ns for cycle in batch.cycles]
        if until_done(late):
            break
    stream.cancel()
    return float(np.percentile(late, 99.0))


def test_calls_of_nonsense_disturb_no_motion(tmp_path):
    ratios, codes, sizes = [], set(), []
    process = DaemonProcess(tmp_path, lease=3600.0)
    text = process.config.read_text()
    # A servo that spins before a deadline has no lateness, so there is no ratio.
    process.config.write_text(text.replace("rate_hz = 500.0", "rate_hz = 500.0\nspin_us = 0"))
    with (
        process as daemon,
        ProcessPoolExecutor(1, get_context("spawn")) as others,
    ):
        daemon.move(spin(3000.0))
        until(lambda: daemon.device().path_time > 0.05, "motion")
        before = daemon.device()

        def poured(seed, count):
            return others.submit(pour, daemon.socket, random.Random(seed), count, WITHOUT)

        poured(0, CALLS // 100).result()  # what is loaded with the first calls is loaded
        for number in range(PAIRS):
            alone = lateness(daemon, lambda late: len(late) > ALONE * 500.0)
            pouring = poured(1 + number, CALLS // PAIRS)
            company = lateness(daemon, lambda _: pouring.done())  # noqa: B023
            codes |= set(pouring.result())
            ratios.append(company / alone)
            sizes.append(resident_kib(daemon.process.pid))
            now = daemon.device()
            print(
                f"\n{(number + 1) * (CALLS // PAIRS)} calls: lateness p99 {1e6 * alone:.0f} us "
                f"alone, {1e6 * company:.0f} us in company; {sizes[-1]} KiB",
                end="",
            )
            assert (now.state, now.motion_number) == (pb.STATE_STREAMING, before.motion_number)
            assert (now.servo_pid, now.fault) == (before.servo_pid, pb.FAULT_NONE)
        assert b"Traceback" not in (daemon.folder / "log").read_bytes()
        daemon.assert_limits_kept()
    print(f"\nratio of p99: {statistics.median(ratios):.2f} in the median")
    assert {method for method, _ in codes} == {one.name for one in SERVICE.methods} - {*WITHOUT}
    assert sizes[-1] - sizes[0] < GROWTH_KIB
    assert statistics.median(ratios) <= MOST
