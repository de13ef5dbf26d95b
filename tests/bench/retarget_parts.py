"""Latency of a retarget, from the call to the first setpoint that it changes.

A real daemon with the loopback driver moves and is retargeted while it moves.  The client and the
daemon read one monotonic clock, so the latency splits into these parts:

``rpc``
    until the daemon has the request;
``planning``
    until the motion is planned and certified;
``splicing``
    until the servo has taken it up;
``waiting``
    until the first setpoint that differs.  The planner chooses the point of departure before it
    plans, far enough ahead to finish by then.
"""

from __future__ import annotations

import contextlib
import itertools
import random
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import grpc
import numpy as np
from motions import through
from servo_lateness import DEVICE, control, daemon

from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb

PARTS = ("rpc", "planning", "splicing", "waiting", "total")

_REST = (0.08, 0.16)
"""The shortest and the longest time between two retargets, s."""

_WARM_UP = 30
_STEP = 0.3
"""Turn from each keyframe to the next, rad."""


@dataclass(frozen=True, slots=True)
class Part:
    """Latency of one part.

    Attributes:
        p50: median, s.
        p99: 99th percentile, s.
    """

    p50: float
    p99: float


@dataclass(frozen=True, slots=True)
class RetargetLatency:
    """Retargets to motions with a number of keyframes.

    Attributes:
        keyframes: of each motion.
        retargets: number of retargets.
        replanned: number of retargets planned more than once, because the device had passed the
            point of departure meanwhile.
        parts: by the names in :data:`PARTS`; the last is the total.
    """

    keyframes: int
    retargets: int
    replanned: int
    parts: dict[str, Part]


@dataclass(frozen=True, slots=True)
class _Retarget:
    number: int
    attempts: int
    marks_ns: tuple[int, ...]
    """The times at which it was sent, received, planned and taken up."""

    def parts(self, first_ns: int) -> list[float]:
        """Return the parts of the latency in s, if the first setpoint changed at *first_ns*."""
        marks = (*self.marks_ns, first_ns)
        steps = [(b - a) * 1e-9 for a, b in itertools.pairwise(marks)]
        return [*steps, (first_ns - marks[0]) * 1e-9]


def measure_retargets(
    keyframes: Sequence[int], *, count: int, rate_hz: float, priority: int = 0
) -> list[RetargetLatency]:
    """Measure *count* retargets for each number of keyframes.

    Args:
        keyframes: numbers of keyframes; the motions have no times and an approach.
        count: retargets for each, after a few uncounted ones.
        rate_hz: of the device.
        priority: of its servo; 0 for the ordinary scheduler.

    Raises:
        OrientdError: the daemon does not become ready or refuses a motion, or its device faults.
    """
    with (
        tempfile.TemporaryDirectory(prefix="orientd-bench-") as folder,
        daemon(Path(folder), rate_hz, priority) as socket,
        control(socket) as stub,
        _first_setpoints(stub) as first,
    ):
        chance = random.Random(1)
        # The first motions load and compile the planner.
        _measure(stub, first, max(keyframes), _WARM_UP, chance)
        return [_measure(stub, first, some, count, chance) for some in keyframes]


def _measure(
    stub: SimpleNamespace, first: dict[int, int], keyframes: int, count: int, chance: random.Random
) -> RetargetLatency:
    token = stub.AcquireLease(pb.AcquireLeaseRequest(holder="orientd bench")).lease.token
    found: list[_Retarget] = []
    calls = []
    for number in range(1 + count):
        stub.RenewLease(pb.RenewLeaseRequest(token=token))
        call, retarget = _retarget(stub, token, aims(keyframes, chance))
        calls.append(call)  # a call that is dropped is cancelled, and its motion stopped
        if number:  # the first one begins at rest
            found.append(retarget)
        time.sleep(chance.uniform(*_REST))
    stub.Stop(pb.StopRequest(device=DEVICE, caller="orientd bench"))
    for call in calls:
        for answer in call:
            if answer.summary.outcome == pb.OUTCOME_FAULT:
                raise OrientdError(f"the device faulted: {answer.summary.text}")
    stub.ReleaseLease(pb.ReleaseLeaseRequest(token=token))
    _await(first, found[-1].number)
    parts = np.array([one.parts(first[one.number]) for one in found if one.number in first])
    p50, p99 = np.percentile(parts, (50.0, 99.0), axis=0).tolist()
    return RetargetLatency(
        keyframes=keyframes,
        retargets=len(parts),
        replanned=sum(one.attempts > 1 for one in found),
        parts={name: Part(*figures) for name, *figures in zip(PARTS, p50, p99, strict=True)},
    )


def _retarget(
    stub: SimpleNamespace, token: str, motion: bytes
) -> tuple[Iterator[pb.MoveResponse], _Retarget]:
    request = pb.MoveRequest(lease_token=token, device=DEVICE, motion=motion, progress_rate_hz=0.1)
    sent_ns = time.monotonic_ns()
    call = stub.Move(request)
    started = next(call).started
    timing = started.timing
    planned_ns = timing.received_ns + round(timing.planning * 1e9)
    taken_ns = planned_ns + round(timing.splicing * 1e9)
    marks_ns = (sent_ns, timing.received_ns, planned_ns, taken_ns)
    return call, _Retarget(started.motion_number, timing.attempts, marks_ns)


def aims(count: int, chance: random.Random) -> bytes:
    """Return *count* keyframes at most a third of a radian apart, the first of them anywhere."""
    vector = [chance.uniform(-1.0, 1.0) for _ in range(3)]
    keyframes = []
    for _ in range(count):
        keyframes.append(vector)
        vector = [part + chance.uniform(-_STEP, _STEP) / 2.0 for part in vector]
    return through(keyframes, approach=True)


@contextlib.contextmanager
def _first_setpoints(stub: SimpleNamespace) -> Iterator[dict[int, int]]:
    """Record the time of the first setpoint of each motion, while the context lasts.

    Two consecutive motions share a setpoint, which counts for the first of them.  So the recorded
    setpoint is the next one.
    """
    first: dict[int, int] = {}
    begun: dict[int, int] = {}
    stream = stub.WatchState(pb.WatchStateRequest(device=DEVICE, rate_hz=10.0))

    def read() -> None:
        with contextlib.suppress(grpc.RpcError):
            for batch in stream:
                for cycle in batch.cycles:
                    index = begun.setdefault(cycle.motion_number, cycle.path_index)
                    if cycle.path_index + cycle.path_fraction > index:
                        first.setdefault(cycle.motion_number, cycle.deadline_ns)

    thread = threading.Thread(target=read, daemon=True)
    thread.start()
    try:
        yield first
    finally:
        stream.cancel()
        thread.join()


def _await(first: dict[int, int], number: int) -> None:
    end = time.monotonic() + 5.0
    while number not in first:
        if time.monotonic() > end:
            raise OrientdError(f"motion {number} was never seen to begin")
        time.sleep(0.05)
