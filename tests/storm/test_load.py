"""The punctuality of a motion with a crowd that plans large files and without, in paired slots.

Run with `make storm`.  For a smaller crowd: ORIENTD_STORM_CLIENTS, ORIENTD_STORM_KEYFRAMES and
ORIENTD_STORM_AT_ONCE; for shorter slots: ORIENTD_STORM_SLOT, s.
"""

import contextlib
import json
import os
import random
import statistics
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import grpc
import numpy as np
import pytest
from harness import until
from motions import through
from storm_rig import Rig, await_idle, memory_mib

from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.storm

CLIENTS = int(os.environ.get("ORIENTD_STORM_CLIENTS", "20"))
KEYFRAMES = int(os.environ.get("ORIENTD_STORM_KEYFRAMES", "100000"))
AT_ONCE = int(os.environ.get("ORIENTD_STORM_AT_ONCE", "100"))
SLOT = float(os.environ.get("ORIENTD_STORM_SLOT", "20"))
PAIRS = int(os.environ.get("ORIENTD_STORM_PAIRS", "5"))

DEVICE = "arm"
PATIENCE = 20.0
"""How long a retarget is waited for, s."""

MOST_LATENESS, MOST_RETARGET = 1.2, 2.0
"""How many times as late, and as long, under load."""


@dataclass
class Slot:
    """Measurements of one slot, s, and its faults."""

    lateness: list[float] = field(default_factory=list)
    retargets: list[float] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)

    def p99(self, name):
        return float(np.percentile(getattr(self, name), 99.0))


class Cycles:
    """Reads every cycle: how late it was, and when the setpoints of each motion began."""

    def __init__(self, stub):
        self.first, self.lateness = {}, []
        self._begun = {}
        self._stream = stub.WatchState(pb.WatchStateRequest(device=DEVICE, rate_hz=10.0))
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self):
        with contextlib.suppress(grpc.RpcError):
            for batch in self._stream:
                for cycle in batch.cycles:
                    self.lateness.append(1e-9 * cycle.lateness_ns)
                    # The setpoint at which one motion leaves another belongs to both.
                    begun = self._begun.setdefault(cycle.motion_number, cycle.path_index)
                    if cycle.path_index + cycle.path_fraction > begun:
                        self.first.setdefault(cycle.motion_number, cycle.deadline_ns)

    def end(self):
        self._stream.cancel()
        self._thread.join()


def aims(count, chance):
    """Return *count* keyframes a third of a radian or less apart, the first of them anywhere."""
    vector = [chance.uniform(-1.0, 1.0) for _ in range(3)]
    keyframes = []
    for _ in range(count):
        keyframes.append(vector)
        vector = [part + chance.uniform(-0.15, 0.15) for part in vector]
    return through(keyframes, approach=True)


def run_slot(stub, token, chance):
    """Move, and give new aims on the way, for one slot."""
    slot, sent_ns, calls = Slot(), {}, []
    cycles = Cycles(stub)
    end = time.monotonic() + SLOT
    while time.monotonic() < end:
        stub.RenewLease(pb.RenewLeaseRequest(token=token), timeout=PATIENCE)
        motion = aims(chance.choice((1, 20)), chance)
        request = pb.MoveRequest(
            lease_token=token, device=DEVICE, motion=motion, progress_rate_hz=0.1
        )
        begun_ns = time.monotonic_ns()
        call = stub.Move(request, timeout=PATIENCE)
        calls.append(call)  # gRPC cancels a call without references, which stops its motion
        try:
            number = next(call).started.motion_number
        except grpc.RpcError as error:
            slot.faults += mended(stub, token)
            if error.code() is grpc.StatusCode.DEADLINE_EXCEEDED:
                slot.retargets.append(PATIENCE)
            elif not slot.faults:
                raise
            continue
        if len(calls) > 1:  # the first one begins at rest
            sent_ns[number] = begun_ns
        time.sleep(chance.uniform(0.08, 0.16))
    stub.Stop(pb.StopRequest(device=DEVICE, caller="storm"), timeout=PATIENCE)
    with contextlib.suppress(AssertionError):
        until(lambda: sent_ns.keys() <= cycles.first.keys(), "the last motion", 5.0)
    cycles.end()
    slot.faults += mended(stub, token)
    slot.lateness = cycles.lateness
    for number, begun_ns in sent_ns.items():
        if number in cycles.first:
            slot.retargets.append(1e-9 * (cycles.first[number] - begun_ns))
    return slot


def mended(stub, token):
    """Return the fault that the device is in, if any, and clear it."""
    (report,) = stub.GetState(pb.GetStateRequest(), timeout=PATIENCE).devices
    if report.fault == pb.FAULT_NONE:
        return []
    stub.Reset(pb.CommandRequest(lease_token=token, device=DEVICE), timeout=PATIENCE)
    return [report.fault_text]


@contextlib.contextmanager
def crowd(socket, clients=CLIENTS, keyframes=KEYFRAMES, at_once=AT_ONCE):
    """Have many plan large files; give a dictionary that has counted their calls at the end."""
    program = Path(__file__).with_name("crowd.py")
    words = [sys.executable, program, socket, DEVICE, clients, keyframes, at_once]
    process = subprocess.Popen(
        [str(word) for word in words], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    met = {}
    try:
        assert process.stdout.readline() == "sending\n"
        time.sleep(2.0)  # until their requests have arrived
        yield met
    finally:
        said, _ = process.communicate()
        met.update(json.loads(said))


def test_a_crowd_that_plans_large_files_makes_no_motion_late(tmp_path):
    chance = random.Random(1)
    alone, company, answered = [], [], []
    rig = Rig(tmp_path, devices=[DEVICE])
    text = rig.config.read_text()
    # A servo that spins before a deadline has no lateness, so there is no ratio.
    rig.config.write_text(text.replace("rate_hz = 500.0", "rate_hz = 500.0\nspin_us = 0"))
    with rig:
        token = rig.stub.AcquireLease(pb.AcquireLeaseRequest(holder="storm")).lease.token
        first = run_slot(rig.stub, token, chance)  # what is loaded with the first motions is loaded
        for number in range(PAIRS):
            for slots in (alone, company) if number % 2 == 0 else (company, alone):
                around = crowd(rig.socket) if slots is company else contextlib.nullcontext({})
                with around as met:
                    slots.append(run_slot(rig.stub, token, chance))
                answered.append(met)
                await_idle(rig)
        sizes = [memory_mib(rig.pid), *map(memory_mib, rig.planners())]
    pairs = zip(alone, company, strict=True)
    lateness = statistics.median(b.p99("lateness") / a.p99("lateness") for a, b in pairs)
    print(f"\n{CLIENTS} clients, {KEYFRAMES} keyframes, {AT_ONCE} at once, {PAIRS} pairs of slots")
    p99 = []
    for name, slots in (("alone", alone), ("in company", company)):
        late = " ".join(f"{1e6 * slot.p99('lateness'):.0f}" for slot in slots)
        retargets = [one for slot in slots for one in slot.retargets]
        p50, most = np.percentile(retargets, (50.0, 99.0)).tolist()
        p99.append(most)
        print(f"{name}: lateness p99 {late} us;", end=" ")
        print(f"{len(retargets)} retargets, p50 {1e3 * p50:.1f} ms, p99 {1e3 * most:.1f} ms")
    retarget = p99[1] / p99[0]
    faults = [fault for slot in (first, *alone, *company) for fault in slot.faults]
    print(f"ratios: lateness {lateness:.2f}, retarget {retarget:.2f}; faults: {faults}")
    print("plans:", *filter(None, answered))
    print("peak resident of the daemon and of planners, MiB:", *map(round, sizes))
    assert not faults
    assert lateness <= MOST_LATENESS
    assert retarget <= MOST_RETARGET
