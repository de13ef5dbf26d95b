"""`orientd lease` and `orientd audit`: who commands, and whether the log of that is whole."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from orientd.cli.command import AsJson, ConfigFile, DeviceName, Socket, command
from orientd.cli.output import answer, say, say_json
from orientd.errors import OrientdError

lease = typer.Typer(
    name="lease", help="Hand the lease to command over, or seize it.", no_args_is_help=True
)
audit = typer.Typer(name="audit", help="Look after the audit log.", no_args_is_help=True)


@lease.command()
@command
def give(
    to: Annotated[
        str, typer.Argument(metavar="WHOM", help="A user's name or number, or certificate:NAME.")
    ],
    device: DeviceName = "",
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Hand the lease of your running move over, and the move with it.

    They acquire it by their next command; until then, and for no longer than a lease lasts, the
    move goes on.
    """
    from orientd.cli.shared_lease import commander

    with commander(socket, "lease give", device, is_beside=True) as robot:
        seconds = robot.transfer_lease(to, device)
    said = f"the lease waits {seconds:.1f} s for {to}"
    answer({"to": to, "seconds": seconds}, said, as_json=as_json)


@lease.command()
@command
def seize(
    reason: Annotated[str, typer.Option("--reason", help="Recorded, and told to the holder.")],
    device: DeviceName = "",
    socket: Socket = None,
    as_json: AsJson = False,
) -> None:
    """Take the lease from whoever holds it, and free it.

    Of a device, or of all of them; what runs under it stops.  For administrators.
    """
    from orientd.cli.shared_lease import connect_as
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
@command
def verify(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="FILE", help="The log; default: that of the configuration."),
    ] = None,
    config: ConfigFile = None,
    as_json: AsJson = False,
) -> None:
    """Follow the chain of the audit log, those put aside included, and name every gap.

    The end of a log that was cut off shows in its last digest alone, which the daemon logs when it
    begins and ends.
    """
    from orientd import config as configuration
    from orientd.cli.texts import count
    from orientd.daemon import audit_path, verify_audit

    if file is None:
        path = config or configuration.find()
        settings = configuration.load(path) if path else configuration.default_settings()
        file = audit_path(settings.access)
    found = verify_audit(file)
    if as_json:
        say_json({"is_whole": not found.problems, **vars(found)})
    else:
        before = f", those before line {found.first} forgotten" if found.first > 1 else ""
        say(f"{count(found.lines, 'line')} in {count(len(found.files), 'file')}{before}")
        say(f"the last is line {found.last}, {found.digest}", *found.problems)
    if found.problems:
        raise OrientdError(f"{file}: the chain is broken in {len(found.problems)} places")
