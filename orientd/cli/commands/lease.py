"""`orientd lease`: hand it over, or break the glass."""

from __future__ import annotations

from typing import Annotated

import typer

from orientd.cli.command import AsJson, Socket, command
from orientd.cli.commands.device_commands import holder
from orientd.cli.output import say, say_json

lease = typer.Typer(
    name="lease", help="Hand the lease to command over, or seize it.", no_args_is_help=True
)


@lease.command()
@command
def give(
    to: Annotated[
        str, typer.Argument(metavar="WHOM", help="A user's name or number, or certificate:NAME.")
    ],
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Hand the lease of your running move over, and the move with it.

    They acquire it by their next command; until then, and for no longer than a lease lasts, the
    move goes on.
    """
    from orientd.cli.shared_lease import commander

    with commander(socket, holder("lease give")) as robot:
        seconds = robot.transfer_lease(to)
    if as_json:
        say_json({"to": to, "seconds": seconds})
    else:
        say(f"the lease waits {seconds:.1f} s for {to}")


@lease.command()
@command
def seize(
    reason: Annotated[str, typer.Option("--reason", help="Recorded, and told to the holder.")],
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Take the lease from whoever holds it, and free it.

    What runs under it stops.  For administrators.
    """
    from orientd.rpc import connect

    with connect(socket, holder=holder("lease seize")) as robot:
        before = robot.state().daemon
        robot.seize_lease(reason)
    if as_json:
        say_json({"holder": before.lease_holder, "identity": before.lease_identity})
    else:
        whose = f"{before.lease_holder} ({before.lease_identity})" if before.lease_holder else ""
        say(f"taken from {whose}; it is free now" if whose else "nobody held it; it is free")
