"""A daemon that a command runs for itself, and that ends with it."""

from __future__ import annotations

import subprocess
import threading
from pathlib import Path

from orientd.errors import DaemonError

READY_TIMEOUT = 20.0
END_TIMEOUT = 15.0


def wait_ready(process: subprocess.Popen[bytes], log: Path) -> None:
    """Wait until a daemon says that it is ready.

    Raises:
        DaemonError: it does not; the last line of its *log* says why.
    """
    timer = threading.Timer(READY_TIMEOUT, process.kill)
    timer.start()
    try:
        line = process.stdout.readline() if process.stdout else b""
    finally:
        timer.cancel()
    if not line.startswith(b"ready"):
        last = (log.read_text(errors="replace").strip().splitlines() or ["it said nothing"])[-1]
        raise DaemonError(f"the daemon did not start: {last}")


def end(process: subprocess.Popen[bytes]) -> None:
    """Have a daemon end in order, or else at once."""
    process.terminate()
    try:
        process.wait(END_TIMEOUT)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            stream.close()
