"""A real browser's display while a process behind the page stands still.

Run with `make storm`; fewer rounds: ORIENTD_STORM_FREEZES=3.
"""

import os
import random
import signal
import time

import pytest
from browser import CHROMIUM, open_browser, page_of, view_of
from gimbal_bench import await_hold
from harness import DEVICE, DaemonProcess

from orientd.protocol import control_pb2 as pb

pytest.importorskip("websockets")
pytest.importorskip("playwright.sync_api")
pytestmark = [
    pytest.mark.storm,
    pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium (Debian: chromium)"),
]

ROUNDS = int(os.environ.get("ORIENTD_STORM_FREEZES", "90"))
"""A third of them of each process."""

MARKED = 1.5
"""Until the page says so, s."""

READY = "ready to move"


def test_whatever_freezes_the_page_says_so_and_never_ready(tmp_path):
    rng, took = random.Random(1), {}
    with DaemonProcess(tmp_path) as daemon, open_browser() as browser:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with view_of(daemon.socket) as view, page_of(view, browser, 900, 400) as page:
            for number in range(ROUNDS):
                page.get_by_text(READY).wait_for()
                time.sleep(rng.uniform(0.0, 1.0))
                which = ("page", "daemon", "servo")[number % 3]
                pid = {
                    "page": view.pid,
                    "daemon": daemon.process.pid,
                    "servo": daemon.device().servo_pid,
                }[which]
                frozen = time.monotonic()
                os.kill(pid, signal.SIGSTOP)
                try:
                    page.get_by_text(READY).wait_for(state="hidden")
                    took.setdefault(which, []).append(time.monotonic() - frozen)
                    time.sleep(0.5)
                    assert not page.get_by_text(READY).is_visible()
                finally:
                    os.kill(pid, signal.SIGCONT)
                await_hold(daemon, DEVICE)
    for which, times in took.items():
        print(f"{which}: marked after {max(times):.2f} s at the most of {len(times)}")
    assert max(max(times) for times in took.values()) <= MARKED
