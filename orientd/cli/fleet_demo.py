"""A cell of daemons on this machine for as long as it is looked at, for `orientd fleet demo`."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from orientd.cli.own_daemon import end, wait_ready


@contextlib.contextmanager
def cell(daemons: int) -> Iterator[str]:
    """Run *daemons* of a cell of their own, ``demo``; yield where one of them listens."""
    with (
        tempfile.TemporaryDirectory(prefix="orientd-fleet-") as name,
        contextlib.ExitStack() as kept,
    ):
        folder = Path(name)
        running = [(_begin(folder, number, kept), number) for number in range(1, daemons + 1)]
        for process, number in running:
            wait_ready(process, folder / f"arm-{number}.log")
        yield _endpoint(folder, 1)


def _endpoint(folder: Path, number: int) -> str:
    return f"unixsock-stream/{folder}/arm-{number}.zenoh"


def _begin(folder: Path, number: int, kept: contextlib.ExitStack) -> subprocess.Popen[bytes]:
    name = f"arm-{number}"
    # The others find each other by the first.
    connect = f'connect = ["{_endpoint(folder, 1)}"]\n' if number > 1 else ""
    config = folder / f"{name}.toml"
    config.write_text(
        f'[daemon]\nsocket = "{folder}/{name}.sock"\n\n'
        f'[fleet]\ncell = "demo"\nname = "{name}"\nlisten = ["{_endpoint(folder, number)}"]\n'
        f'{connect}\n[planner]\nprocesses = 1\n\n[devices.arm]\ndriver = "loopback"\n',
        encoding="utf-8",
    )
    environment = {**os.environ, "XDG_STATE_HOME": str(folder / name)}
    environment.pop("ORIENTD_SOCKET", None)
    with (folder / f"{name}.log").open("wb") as errors:
        process = subprocess.Popen(
            [sys.executable, "-m", "orientd", "run", "--until-end-of-input", "-c", str(config)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=errors,
            env=environment,
            # Ctrl-C is for the demo, which then ends the daemons.
            start_new_session=True,
        )
    kept.callback(end, process)
    return process
