"""A daemon to be stormed, its processes as the system sees them, and what it has sent."""

from __future__ import annotations

import contextlib
import os
import re
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from harness import DaemonProcess, children, until
from judge import Judge, judged

from orientd.driver import Setpoint
from orientd.protocol import control_pb2 as pb

DEVICES = ("left", "right")
RATE_HZ = 500.0
PERIOD = 1.0 / RATE_HZ

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


def shares_of_limits(setpoints: np.ndarray, limits) -> tuple[dict[str, float], Judge]:
    """Return the largest rates that were sent, as shares of *limits*, and their judge."""
    rows = zip(*(setpoints[name].tolist() for name in ("time_ns", "q", "position")), strict=True)
    sent = [Setpoint(at, q, position=position) for at, q, position in rows]
    _, judge = judged(sent, {}, PERIOD)
    names = ("velocity", "acceleration", "jerk", "linear_velocity", "linear_acceleration")
    return {name: judge.peaks[name] / getattr(limits, name) for name in names}, judge


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
