"""The bare C loop, and what loads the machine while it and the servo are measured."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from orientd.errors import OrientdError


@dataclass(frozen=True, slots=True)
class Slot:
    """Lateness in one slot of measuring.

    Attributes:
        cycles: how many began.
        p50_us: microseconds.
        p99_us: microseconds.
        p99_9_us: microseconds.
        largest_us: microseconds.
        overruns: cycles that began more than half a period late.
        missed: deadlines that passed altogether.
        work_p99_us: how long a cycle worked; not a number for the C loop, which does nothing.
    """

    cycles: int
    p50_us: float
    p99_us: float
    p99_9_us: float
    largest_us: float
    overruns: int
    missed: int
    work_p99_us: float = float("nan")


@contextlib.contextmanager
def bare_loop() -> Iterator[Path]:
    """Compile the C loop for as long as the context lasts.

    Raises:
        OrientdError: there is no C compiler.
    """
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        raise OrientdError("the bare C loop needs a C compiler (cc, gcc or clang), none was found")
    with tempfile.TemporaryDirectory(prefix="orientd-bench-") as folder:
        program = Path(folder) / "loop"
        source = Path(__file__).with_name("loop.c").read_text()
        subprocess.run(
            [compiler, "-O2", "-x", "c", "-", "-o", program], input=source.encode(), check=True
        )
        yield program


def run_bare_loop(program: Path, rate_hz: float, seconds: float, priority: int) -> Slot:
    """Run the C loop for *seconds* and return its lateness.

    Raises:
        OrientdError: the system does not permit SCHED_FIFO.
    """
    period_ns = round(1e9 / rate_hz)
    cycles = round(seconds * rate_hz)
    done = subprocess.run(
        [program, str(period_ns), str(cycles), str(priority)], capture_output=True, text=True
    )
    if done.returncode == 3:
        raise OrientdError(f"SCHED_FIFO {priority} is not permitted here; see `orientd doctor`")
    if done.returncode != 0:
        raise OrientdError(f"the C loop ended with status {done.returncode}")
    *lines, last = done.stdout.splitlines()
    lateness = np.array(lines, dtype=np.float64) * 1e-3
    p50, p99, p99_9 = np.percentile(lateness, (50.0, 99.0, 99.9))
    return Slot(
        cycles=cycles,
        p50_us=float(p50),
        p99_us=float(p99),
        p99_9_us=float(p99_9),
        largest_us=float(lateness.max()),
        overruns=int((lateness > period_ns * 0.5e-3).sum()),
        missed=int(last.split()[1]),
    )


@contextlib.contextmanager
def processes(commands: Sequence[Sequence[str]]) -> Iterator[None]:
    """Run *commands* for as long as the context lasts."""
    started: list[subprocess.Popen[bytes]] = []
    try:
        started.extend(subprocess.Popen(command, stdout=subprocess.DEVNULL) for command in commands)
        yield
    finally:
        for process in started:
            process.kill()
        for process in started:
            process.wait()


def busy_cores() -> list[list[str]]:
    """Return a command for each core that does nothing but use it up."""
    count = len(os.sched_getaffinity(0))
    return [[sys.executable, "-S", "-c", "while True: pass"]] * count
