"""`orientd sim`: emulated devices on real sockets, for trying drivers without hardware."""

from __future__ import annotations

import importlib
from typing import Annotated, Any

import typer

from orientd.cli.output import command
from orientd.errors import DaemonError

sim = typer.Typer(
    name="sim",
    help="Run an emulated device until Ctrl-C.",
    no_args_is_help=True,
)


@sim.command("ur")
@command
def ur(
    host: Annotated[str, typer.Option(help="An address of this machine; each robot needs one.")],
) -> None:
    """Run an emulated UR5e: RTDE on 30004, dashboard on 29999, script port 30003.

    Prints a line that begins with `ready` when it can be used. Any address of 127.0.0.0/8 serves.
    """
    emulator: Any = importlib.import_module("orientd_sim.ur")
    try:
        emulator.serve(host)
    except OSError as error:
        raise DaemonError(f"cannot serve an emulated UR at {host}: {error.strerror}") from error
