"""`orientd lease`: who commands."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orientd.cli.command import AsJson, ConfigFile, DeviceName, Socket, connect_as
from orientd.cli.output import say, say_json
from orientd.errors import OrientdError

lease = typer.Typer(name="lease", help="Seize the lease to command.", no_args_is_help=True)
audit = typer.Typer(name="audit", help="No longer there.", no_args_is_help=True)


@lease.command(hidden=True)
def give(
    to: Annotated[str, typer.Argument(metavar="WHOM", help="Not used.")],  # noqa: ARG001 - as it was
    device: DeviceName = "",  # noqa: ARG001
    socket: Socket = None,  # noqa: ARG001
) -> None:
    """Say that leases are not handed over any more."""
    raise OrientdError(
        "leases are not handed over any more: release yours, or have an administrator seize it"
    )


@lease.command()
def seize(
    reason: Annotated[str, typer.Option("--reason", help="Recorded, and told to the holder.")],
    device: DeviceName = "",
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Take the lease from whoever holds it, and free it.

    Of a device, or of all of them; what runs under it stops.  For administrators.
    """
    from orientd.rpc import LeaseReport

    with connect_as(socket, "lease seize") as robot:
        leases = robot.state().daemon.leases
        before = [one for one in leases if not device or device in one.devices]
        robot.seize_lease(reason, *filter(None, [device]))
    if as_json:
        first = before[0] if before else LeaseReport("", 0.0)
        say_json({"holder": first.holder, "identity": first.identity, "leases": before})
    else:
        whose = ", ".join(f"{one.holder} ({one.identity})" for one in before)
        say(f"taken from {whose}; it is free now" if whose else "nobody held it; it is free")


@audit.callback()
def _group() -> None:
    pass


@audit.command()
def verify(
    file: Annotated[Path | None, typer.Argument(metavar="FILE", help="Not used.")] = None,  # noqa: ARG001 - as it was
    config: ConfigFile = None,  # noqa: ARG001 - as it was
) -> None:
    """Say that the audit log has no chain any more."""
    raise OrientdError("the audit log is no chain any more: there is nothing to verify")
