"""A daemon to be stormed, its processes as the system sees them, and what it has sent."""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from harness import DaemonProcess, children, until

from orientd.protocol import control_pb2 as pb

DEVICES = ("left", "right")
RATE_HZ = 500.0
PERIOD = 1.0 / RATE_HZ

NEARLY_NS, STALL_NS = 30_000_000, 75_000_000
"""A servo process that did not run for 50 ms resumes from rest.  A setpoint has only its deadline,
so between these two limits it may resume from rest or not."""

MOST_CUTS = 30
"""Looked back at, of those that may be."""

SETPOINT = np.dtype(
    [("time_ns", "i8"), ("q", "f8", 4), ("rates", "f8", 6), ("position", "f8", 3), ("v", "f8", 3)]
)
"""One record of the loopback driver's recording."""


class Rig(DaemonProcess):
    """A daemon with loopback devices that record their setpoints; its lease is free."""

    def __init__(
        self,
        folder: Path,
        *,
        devices: Sequence[str] = DEVICES,
        planner: str = "",
        patience: float | None = None,
    ) -> None:
        """Prepare a daemon in *folder*.

        Args:
            folder: for its files.
            devices: their names.
            planner: of the configuration's table ``[planner]``; nothing for none.
            patience: stall timeout of the devices, s; ``None`` for the default.
        """
        super().__init__(folder)
        self.recordings = {name: folder / f"sent-{name}" for name in devices}
        tables = [f'[daemon]\nsocket = "{self.socket}"\nlease_seconds = 3600.0\n']
        if planner:
            tables.append(f"[planner]\n{planner}\n")
        for name, path in self.recordings.items():
            tables.append(f'[devices.{name}]\ndriver = "loopback"\nrate_hz = {RATE_HZ!r}\n')
            if patience is not None:
                tables.append(f"stall_timeout = {patience!r}\n")
            tables.append(f'[devices.{name}.options]\nrecord = "{path}"\n')
        self.config.write_text("".join(tables))

    def start(self) -> None:
        """Start it and leave the lease to others."""
        super().start()
        self.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=self.token))

    # Processes

    @property
    def pid(self) -> int:
        """The daemon's process."""
        return self.process.pid

    def servos(self) -> set[int]:
        """Return the servo processes."""
        reports = self.stub.GetState(pb.GetStateRequest(), timeout=30.0).devices
        return {report.servo_pid for report in reports if report.servo_pid}

    def planners(self) -> set[int]:
        """Return the planners: children of the process from which they fork."""
        forking = {pid for pid in children(self.pid) if "planners" in command_line(pid)}
        return {pid for parent in forking for pid in children(parent)}

    def busiest_planner(self) -> int:
        """Return the process that plans right now."""
        planners = self.planners()
        assert planners, "the daemon has no planner process"
        begun = {pid: processor_seconds(pid) for pid in planners}

        def busy() -> int:
            spent = {pid: processor_seconds(pid) - begun[pid] for pid in planners}
            pid = max(spent, key=spent.__getitem__)
            return pid if spent[pid] > 0.03 else 0

        return until(busy, "a planner at work")


def command_line(pid: int) -> str:
    """Return the words that a process was started with; nothing once it has ended."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ").decode()
    return ""


def memory_mib(pid: int, field: str = "VmHWM") -> float:
    """Return a process's peak resident memory, or another *field*; 0 once it has ended."""
    with contextlib.suppress(OSError):
        status = Path(f"/proc/{pid}/status").read_text()
        found = re.search(rf"^{field}:\s+(\d+) kB", status, re.MULTILINE)
        return int(found[1]) / 1024.0 if found else 0.0
    return 0.0


def processor_seconds(pid: int) -> float:
    """Return how long a process has had a processor so far, s; 0 once it has ended."""
    with contextlib.suppress(OSError):
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return 0.0


def is_idle(rig):
    """Whether the daemon and its planners have hardly had a processor for a while."""
    pids = {rig.pid, *rig.planners()}
    before = sum(map(processor_seconds, pids))
    time.sleep(0.5)
    return sum(map(processor_seconds, pids)) - before < 0.1


def await_idle(rig, seconds=120.0):
    """Wait until whatever was asked for has been planned, or given up."""
    until(lambda: is_idle(rig), "an idle daemon", seconds)


# What was sent


def sent(path: Path) -> np.ndarray:
    """Return the setpoints of a recording, the last one left out if it is incomplete."""
    content = path.read_bytes()
    return np.frombuffer(content[: len(content) // SETPOINT.itemsize * SETPOINT.itemsize], SETPOINT)


def stretches(setpoints: np.ndarray, limits) -> list[np.ndarray]:
    """Return the sections of setpoints between stalls, each from rest at the previous setpoint.

    A late cycle carries its deadline, so the first cycle from rest may be next to the gap.  A short
    gap may be no stall.  The function chooses the division that keeps *limits* best.
    """
    gaps = np.diff(setpoints["time_ns"])
    near = {gap + after for gap in np.flatnonzero(gaps > NEARLY_NS).tolist() for after in range(3)}
    certain = np.flatnonzero(gaps > STALL_NS)
    best: dict[int, tuple[float, list[int]]] = {0: (0.0, [0])}
    for end in [*sorted(near & set(range(1, len(setpoints)))), len(setpoints)]:
        # Every certain stall has a cut next to it, so only so many cuts may be the one before.
        stalled = certain[certain + 2 < end]
        least = max(stalled[-1] if len(stalled) else 0, sorted(best)[-MOST_CUTS:][0])
        best[end] = min(
            (
                (
                    max(worst, *_shares(_from_rest(setpoints, begin, end), limits).values()),
                    [*cuts, end],
                )
                for begin, (worst, cuts) in best.items()
                if begin >= least
            ),
            key=lambda found: (found[0], len(found[1])),
            default=(np.inf, [0, end]),
        )
    return [_from_rest(setpoints, *ends) for ends in itertools.pairwise(best[len(setpoints)][1])]


def _from_rest(setpoints: np.ndarray, begin: int, end: int) -> np.ndarray:
    rest = setpoints[max(begin - 1, 0) : max(begin, 1)]
    return np.concatenate([rest, rest, rest, setpoints[begin:end]])


def shares_of_limits(setpoints: np.ndarray, limits) -> tuple[dict[str, float], int]:
    """Return the largest rates that were sent, as shares of *limits*, and the stalls between."""
    pieces = stretches(setpoints, limits)
    shares = [_shares(piece, limits) for piece in pieces]
    return {name: max(share[name] for share in shares) for name in shares[0]}, len(pieces) - 1


def _shares(stretch: np.ndarray, limits) -> dict[str, float]:
    """Return the largest rates of a section as shares of *limits*, by backward differences."""
    omega = rotation_vectors(stretch["q"]) / PERIOD
    alpha = np.diff(omega, axis=0) / PERIOD
    velocity = np.diff(stretch["position"], axis=0) / PERIOD
    rates = {
        "velocity": omega,
        "acceleration": alpha,
        "jerk": np.diff(alpha, axis=0) / PERIOD,
        "linear_velocity": velocity,
        "linear_acceleration": np.diff(velocity, axis=0) / PERIOD,
    }
    return {
        name: float(np.sqrt((rate * rate).sum(axis=1)).max(initial=0.0) / getattr(limits, name))
        for name, rate in rates.items()
    }


def rotation_vectors(q: np.ndarray) -> np.ndarray:
    """Return the shortest turns from each orientation to the next, rad, body axes, ``(n-1, 3)``."""
    before, after = q[:-1], q[1:]
    w = (before * after).sum(axis=1)
    vector = (
        before[:, :1] * after[:, 1:]
        - after[:, :1] * before[:, 1:]
        - np.cross(before[:, 1:], after[:, 1:])
    )
    sine = np.sqrt((vector * vector).sum(axis=1))
    angle = 2.0 * np.arctan2(sine, np.abs(w))
    factor = np.where(sine > 0.0, angle / np.where(sine > 0.0, sine, 1.0), 2.0)
    return (np.where(w < 0.0, -factor, factor))[:, None] * vector
