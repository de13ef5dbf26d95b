"""The command `orientd`."""

from __future__ import annotations

import os
import signal
from typing import Annotated

import typer

import orientd
from orientd.cli import (
    bench,
    certs,
    compare,
    daemon_commands,
    demo,
    device_commands,
    doctor,
    lease,
    motion_commands,
    plot,
    record,
    replay,
    service,
    sim,
    track,
    view,
)
from orientd.cli.output import say
from orientd.cli.usage import Commands

app = typer.Typer(
    name="orientd",
    cls=Commands,
    help="Plan smooth orientation motion and stream it to robots.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(is_asked: bool) -> None:
    if is_asked:
        say(f"orientd {orientd.__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    del version


for _command in (
    demo.demo,
    daemon_commands.run,
    daemon_commands.status,
    daemon_commands.devices,
    daemon_commands.methods,
    motion_commands.plan,
    motion_commands.move,
    track.track,
    compare.compare,
    plot.plot,
    record.record,
    record.export,
    replay.replay,
    device_commands.stop,
    device_commands.halt,
    device_commands.pause,
    device_commands.resume,
    device_commands.speed,
    device_commands.enable,
    device_commands.disable,
    device_commands.reset,
    doctor.doctor,
    view.view,
):
    # A negative speed is a wrong speed, not an option.
    _is_lax = _command is device_commands.speed
    app.command(context_settings={"ignore_unknown_options": _is_lax})(_command)
app.add_typer(bench.bench)
app.add_typer(sim.sim)
app.add_typer(service.service)
app.add_typer(lease.lease)
app.add_typer(certs.certs)


def main() -> None:
    """Run the command line."""
    # gRPC's own log lines are about its connections, for which our errors have words.
    os.environ.setdefault("GRPC_VERBOSITY", "NONE")
    # To be told to end is to be interrupted: a motion stops on its path, nothing is left behind.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    app()


if __name__ == "__main__":
    main()
