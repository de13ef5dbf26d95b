"""Eight devices on one machine: how late their cycles are, and what the servos cost together.

    python -m pytest tests/bench/test_phases.py -m bench -s

One run spreads their phases over the period, as by default; the other gives all one phase.
"""

import contextlib
import statistics
import time
from pathlib import Path

import numpy as np
import pytest
from harness import DaemonProcess
from test_servo import show

import orientd
from orientd.config import FIRST_PHASE
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.bench

DEVICES, RATE_HZ, SECONDS, SLOTS = 8, 500.0, 10.0, 3


@contextlib.contextmanager
def cell(folder, phase):
    """Run a daemon with eight devices, all at *phase*, or each at its own where that is none."""
    daemon = DaemonProcess(folder)
    own = "" if phase is None else f"phase = {phase}\n"
    daemon.config.write_text(
        f'[daemon]\nsocket = "{daemon.socket}"\nlease_seconds = 600.0\n'
        + "".join(
            f'[devices.arm{k}]\ndriver = "loopback"\nrate_hz = {RATE_HZ}\n'
            f"heartbeat_timeout = 10.0\n{own}"
            for k in range(DEVICES)
        )
    )
    with daemon:
        daemon.token = ""
        with orientd.connect(daemon.socket) as robot:
            robot.seize_lease("to measure")
            yield robot


def worked_ns(pids):
    """Return for how long processes have had a processor."""
    return sum(int(Path(f"/proc/{pid}/schedstat").read_text().split()[0]) for pid in pids)


def slot(robot):
    """Have all devices move and return the p99 of their lateness, ms, and the share of a core."""
    times = np.linspace(0.0, SECONDS, round(SECONDS / 0.4) + 1)
    turns = [{"rotation_vector": [0.3 * np.sin(t), 0.2 * np.sin(1.3 * t), 0.2 * t]} for t in times]
    names = [device.name for device in robot.devices()]
    pids = [robot.state().devices[name].servo_pid for name in names]
    handles = [
        robot.move(turns, device=name, times=times, approach=True, progress_rate_hz=0.1)
        for name in names
    ]
    time.sleep(1.0)  # what planning has left behind is done
    began, before = time.monotonic_ns(), worked_ns(pids)
    time.sleep(0.7 * SECONDS)
    share = (worked_ns(pids) - before) / (time.monotonic_ns() - began)
    summaries = [handle.wait(3.0 * SECONDS) for handle in handles]
    assert [summary.text for summary in summaries if summary.outcome != pb.OUTCOME_DONE] == []
    return statistics.mean(s.statistics.lateness.p99 for s in summaries) * 1e3, share


@pytest.mark.timeout(900)
def test_eight_devices_are_punctual_and_cheap(tmp_path):
    found = {"spread": [], "at once": []}
    for number in range(SLOTS):
        for name, phase in (("spread", None), ("at once", FIRST_PHASE)):
            with cell(tmp_path / f"{name}{number}", phase) as robot:
                found[name].append(slot(robot))
    p99 = {name: statistics.median(late for late, _ in slots) for name, slots in found.items()}
    cores = {name: statistics.median(share for _, share in slots) for name, slots in found.items()}
    for name, slots in found.items():
        show(
            f"eight devices, {name}",
            p99_ms=[round(late, 3) for late, _ in slots],
            cores=[round(share, 3) for _, share in slots],
        )
    ratio = p99["spread"] / p99["at once"]
    show("spread beside at once", p99=round(ratio, 2), cores=cores["spread"] / cores["at once"])
    assert p99["spread"] <= 0.15
    assert ratio <= 0.5
    assert cores["spread"] <= 0.6
