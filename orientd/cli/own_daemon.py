"""A daemon that a command starts for itself and ends with it."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from orientd.errors import DaemonError, OrientdError

if TYPE_CHECKING:
    from orientd.client.robot import Robot
    from orientd.stream.records import Cycle

READY_TIMEOUT = 20.0
END_TIMEOUT = 15.0


@contextlib.contextmanager
def begun(config: Path) -> Iterator[Callable[[], None]]:
    """Start a daemon, which ends with the context; yield a function that waits until it is ready.

    Its log and its state are kept next to *config*.  The function raises a
    :class:`~orientd.errors.DaemonError` if the daemon does not start.
    """
    log = config.with_suffix(".log")
    environment = {**os.environ, "XDG_STATE_HOME": str(config.with_suffix(""))}
    environment.pop("ORIENTD_SOCKET", None)
    with log.open("wb") as errors:
        process = subprocess.Popen(
            [sys.executable, "-m", "orientd", "run", "--until-end-of-input", "-c", str(config)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            env=environment,
            # Ctrl-C is for the command, which then ends the daemon.
            process_group=0,
        )
    with process:
        try:
            yield partial(_wait_ready, process, log)
        finally:
            _end(process)


@contextlib.contextmanager
def simulated(device: str) -> Iterator[Path]:
    """Run a daemon in a temporary directory, and yield its socket.

    Args:
        device: the table of its only device ``arm``, as TOML.

    Raises:
        DaemonError: the daemon does not start.
    """
    with tempfile.TemporaryDirectory(prefix="orientd-") as name:
        socket, config = Path(name) / "control.sock", Path(name) / "simulated.toml"
        config.write_text(
            f'[daemon]\nsocket = "{socket}"\n\n[devices.arm]\n{device}', encoding="utf-8"
        )
        with begun(config) as wait_ready:
            wait_ready()
            yield socket


@contextlib.contextmanager
def recorded(robot: Robot) -> Iterator[list[Cycle]]:
    """Yield a list of every cycle of the device, which grows until the context ends."""
    cycles: list[Cycle] = []
    ended = threading.Event()

    def watch() -> None:
        with contextlib.suppress(OrientdError):
            for batch in robot.watch():
                cycles.extend(batch)
                if ended.is_set():
                    return

    thread = threading.Thread(target=watch, name="watch", daemon=True)
    thread.start()
    try:
        yield cycles
    finally:
        ended.set()
        thread.join()


def _wait_ready(process: subprocess.Popen[bytes], log: Path) -> None:
    """Wait until a daemon is ready.

    Raises:
        DaemonError: it does not become ready; the last line of its *log* has the reason.
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


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a daemon in order, or otherwise at once."""
    process.terminate()
    try:
        process.wait(END_TIMEOUT)
    except subprocess.TimeoutExpired:
        process.kill()
