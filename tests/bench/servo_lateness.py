"""Punctuality of the servo, against a bare C loop at the same priority in the same run.

Slots alternate, so that both run under the same conditions.  In a slot of the servo, a real daemon
with the loopback driver streams a motion.  Under load it also plans without pause and streams its
state to four watchers, and every core has a busy process.  The C loop has the busy processes only.
"""

from __future__ import annotations

import contextlib
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import busy_clients
import grpc
from bare_loop import Slot, bare_loop, busy_cores, processes, run_bare_loop
from busy_clients import STEP, motion

from orientd.client.channel import Way
from orientd.client.connection import Connection
from orientd.config import SPIN_US
from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb

PRIORITY = 80
DEVICE = "bench"
_TIMEOUT = 30.0


class Condition(NamedTuple):
    """The conditions of one comparison of a full report.

    Attributes:
        rate_hz: cycles per second.
        is_loaded: whether the daemon and every core are busy.
        priority: SCHED_FIFO priority, 0 for the ordinary scheduler.
        spin_us: how long the servo spins before a deadline; the C loop never does.
    """

    rate_hz: float
    is_loaded: bool
    priority: int
    spin_us: int


@dataclass(frozen=True, slots=True)
class Comparison:
    """The servo and the C loop under the same conditions.

    Attributes:
        servo: slots of the servo.
        bare: slots of the C loop, each next to one of the servo.
    """

    servo: tuple[Slot, ...]
    bare: tuple[Slot, ...]

    @property
    def p99_ratio(self) -> float:
        """Median over the pairs of slots of the servo's p99 lateness over the C loop's."""
        return statistics.median(
            a.p99_us / b.p99_us for a, b in zip(self.servo, self.bare, strict=True)
        )

    @property
    def work_p99_us(self) -> float:
        """Median over the slots of the p99 of a cycle's work."""
        return statistics.median(slot.work_p99_us for slot in self.servo)

    @property
    def overruns(self) -> tuple[int, int]:
        """Overruns of the servo and of the C loop, over all slots."""
        return sum(s.overruns for s in self.servo), sum(s.overruns for s in self.bare)


def compare(condition: Condition, *, slots: int, seconds: float) -> Comparison:
    """Measure *slots* pairs of slots of *seconds* each.

    Raises:
        OrientdError: there is no C compiler, or no permission for the priority.
    """
    servo: list[Slot] = []
    bare: list[Slot] = []
    with bare_loop() as program:
        order: list[tuple[list[Slot], Callable[[], Slot]]] = [
            (servo, lambda: _servo_slot(condition, seconds)),
            (bare, lambda: run_bare_loop(program, condition.rate_hz, seconds, condition.priority)),
        ]
        for number in range(slots):
            for found, take in order if number % 2 == 0 else reversed(order):
                with processes(busy_cores() if condition.is_loaded else []):
                    found.append(take())
    return Comparison(tuple(servo), tuple(bare))


def _servo_slot(condition: Condition, seconds: float) -> Slot:
    rate_hz, is_loaded, priority, spin_us = condition
    with (
        tempfile.TemporaryDirectory(prefix="orientd-bench-") as folder,
        daemon(Path(folder), rate_hz, priority, spin_us) as socket,
    ):
        load = [[sys.executable, busy_clients.__file__, str(socket), DEVICE]]
        with processes(load if is_loaded else []):
            return stream(socket, seconds, priority, progress_hz=20.0 if is_loaded else 1.0)


@contextlib.contextmanager
def daemon(
    folder: Path, rate_hz: float, priority: int, spin_us: int = SPIN_US, *, more: str = ""
) -> Iterator[Path]:
    """Run a daemon with one loopback device while the context lasts.

    Args:
        folder: for its files.
        rate_hz: of the device.
        priority: SCHED_FIFO priority of its servo, 0 for the ordinary scheduler.
        spin_us: how long the servo spins before a deadline.
        more: further tables of the configuration.
    """
    socket = folder / "control.sock"
    config = folder / "config.toml"
    config.write_text(
        f'[daemon]\nsocket = "{socket}"\nlease_seconds = 60.0\n'
        f'[devices.{DEVICE}]\ndriver = "loopback"\n'
        f"rate_hz = {rate_hz!r}\npriority = {priority}\nspin_us = {spin_us}\n{more}"
    )
    environment = {**os.environ, "XDG_STATE_HOME": str(folder)}
    process = subprocess.Popen(
        [sys.executable, "-m", "orientd", "run", "--config", str(config)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=environment,
    )
    try:
        line = process.stdout.readline() if process.stdout else ""
        if not line.startswith("ready"):
            raise OrientdError(f"the daemon did not become ready, it said {line.strip()!r}")
        yield socket
    finally:
        process.terminate()
        process.communicate()  # closes the pipe, too


@contextlib.contextmanager
def control(socket: Path) -> Iterator[Any]:
    """Give a stub of the control service for as long as the context lasts.

    Args:
        socket: of the daemon.

    Raises:
        OrientdError: a call in the context failed, whatever gRPC said of it.
    """
    connection = Connection(Way(socket), timeout=_TIMEOUT)
    try:
        yield connection.stub
    except grpc.RpcError as error:
        raise connection.explain(error) from error
    finally:
        connection.close()


def stream(socket: Path, seconds: float, priority: int, *, progress_hz: float = 1.0) -> Slot:
    """Move for *seconds* and return the statistics of the motion.

    Args:
        socket: of the daemon that :func:`daemon` started.
        seconds: duration of the motion.
        priority: SCHED_FIFO priority of the servo.
        progress_hz: rate of the progress reports to this client.

    Raises:
        OrientdError: the priority is not permitted, or the motion was refused or did not end well.
    """
    with control(socket) as stub:
        token = stub.AcquireLease(pb.AcquireLeaseRequest(holder="orientd bench")).lease.token
        scheduling = stub.GetState(pb.GetStateRequest(device=DEVICE)).devices[0].scheduling
        if priority and not scheduling.startswith("SCHED_FIFO"):
            raise OrientdError(f"SCHED_FIFO {priority} is not permitted here; see `orientd doctor`")
        request = pb.MoveRequest(
            lease_token=token,
            device=DEVICE,
            motion=motion(count=round(seconds / STEP) + 1),
            progress_rate_hz=progress_hz,
        )
        summary = None
        for answer in stub.Move(request):
            stub.RenewLease(pb.RenewLeaseRequest(token=token))
            if answer.HasField("summary"):
                summary = answer.summary
        stub.ReleaseLease(pb.ReleaseLeaseRequest(token=token))
    if summary is None or summary.outcome != pb.OUTCOME_DONE:
        raise OrientdError(f"the motion did not end well: {summary.text if summary else 'no end'}")
    found = summary.statistics
    return Slot(
        cycles=found.cycles,
        p50_us=found.lateness.p50 * 1e6,
        p99_us=found.lateness.p99 * 1e6,
        p99_9_us=found.lateness.p99_9 * 1e6,
        largest_us=found.lateness.largest * 1e6,
        overruns=found.overruns,
        missed=found.missed,
        work_p99_us=found.work.p99 * 1e6,
    )


def conditions() -> list[Condition]:
    """Return the conditions of every comparison of a full report."""
    return [
        Condition(rate, is_loaded, priority, spin_us)
        for rate in (500.0, 1000.0)
        for is_loaded in (False, True)
        for priority, spin_us in ((PRIORITY, SPIN_US), (PRIORITY, 0), (0, SPIN_US))
    ]
