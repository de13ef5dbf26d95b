"""A cell of daemons on this machine, which a command starts for itself and ends with it."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from pathlib import Path

from orientd.cli.own_daemon import begun
from orientd_fleet.gateway import Gateway
from orientd_fleet.settings import read_settings


@contextlib.contextmanager
def cell(daemons: int) -> Iterator[str]:
    """Run *daemons* of a cell called ``demo``; yield the endpoint of one of them.

    Their gateways run in this process.
    """
    with (
        tempfile.TemporaryDirectory(prefix="orientd-fleet-") as name,
        contextlib.ExitStack() as kept,
    ):
        folder = Path(name)
        configs = [_configured(folder, number) for number in range(1, daemons + 1)]
        for wait_ready in [kept.enter_context(begun(config)) for config in configs]:
            wait_ready()
        for config in configs:
            kept.enter_context(Gateway(read_settings(config), config.with_suffix(".sock")))
        yield _endpoint(folder, 1)


def _endpoint(folder: Path, number: int) -> str:
    return f"unixsock-stream/{folder}/arm-{number}.zenoh"


def _configured(folder: Path, number: int) -> Path:
    """Write the configuration of a daemon, and return its path."""
    name = f"arm-{number}"
    # The others find each other through the first.
    connect = f'connect = ["{_endpoint(folder, 1)}"]\n' if number > 1 else ""
    config = folder / f"{name}.toml"
    config.write_text(
        f'[daemon]\nsocket = "{folder}/{name}.sock"\n\n'
        f'[fleet]\ncell = "demo"\nname = "{name}"\nlisten = ["{_endpoint(folder, number)}"]\n'
        f'{connect}\n[planner]\nprocesses = 1\n\n[devices.arm]\ndriver = "loopback"\n',
        encoding="utf-8",
    )
    return config
