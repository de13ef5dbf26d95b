"""`orientd certs`: certificates for a daemon over TCP, and for whoever reaches it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from orientd.cli.command import AsJson, command
from orientd.cli.output import say, say_json, table
from orientd.errors import ConfigError

if TYPE_CHECKING:
    from orientd.certificates import Authority, Issued

Folder = Annotated[
    Path, typer.Argument(metavar="FOLDER", help="Where the authority is; keep it to yourself.")
]
Days = Annotated[float, typer.Option("--days", min=0.01, help="How long it lasts.")]

certs = typer.Typer(
    name="certs", help="Make certificates for a daemon reached over TCP.", no_args_is_help=True
)


@certs.command()
@command
def init(
    folder: Folder,
    name: Annotated[str, typer.Option("--name", help="Of the authority.")] = "orientd cell",
    as_json: AsJson = False,
) -> None:
    """Make a certificate authority."""
    _authority_class().make(folder, name)
    if as_json:
        say_json({"ca": folder / "ca.pem", "key": folder / "ca.key", "crl": folder / "crl.pem"})
    else:
        say(f"made {folder / 'ca.pem'}, its key and {folder / 'crl.pem'}")


@certs.command()
@command
def server(
    folder: Folder,
    hosts: Annotated[
        list[str], typer.Argument(metavar="HOST...", help="Names and addresses of the daemon.")
    ],
    name: Annotated[str, typer.Option("--name", help="Of the files.")] = "server",
    days: Days = 825.0,
    as_json: AsJson = False,
) -> None:
    """Make the certificate of a daemon."""
    issued = _authority_class()(folder).issue(name, days=days, hosts=hosts)
    _tell(issued, as_json=as_json)


@certs.command()
@command
def client(
    folder: Folder,
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Who it is for; [access.certificates] has roles.")
    ],
    days: Days = 825.0,
    as_json: AsJson = False,
) -> None:
    """Make the certificate of somebody who commands, or watches."""
    _tell(_authority_class()(folder).issue(name, days=days), as_json=as_json)


@certs.command()
@command
def revoke(
    folder: Folder,
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="Whose certificate is to count no longer.")
    ],
    as_json: AsJson = False,
) -> None:
    """Revoke a certificate.

    Copy crl.pem to the daemon then, and send it SIGHUP.
    """
    issued = _authority_class()(folder).revoke(name)
    if as_json:
        say_json({"revoked": _told(issued)})
    else:
        say(f"revoked {issued.name}, serial {issued.serial}; it is in {folder / 'crl.pem'}")


@certs.command("list")
@command
def list_(folder: Folder, as_json: AsJson = False) -> None:
    """List what the authority has signed."""
    issued = _authority_class()(folder).issued()
    if as_json:
        say_json({"certificates": [_told(one) for one in issued]})
        return
    rows = [
        [
            one.name,
            "daemon" if one.is_server else "client",
            f"{one.expires:%Y-%m-%d}",
            "revoked" if one.is_revoked else "",
            one.serial,
        ]
        for one in issued
    ]
    say(*table(["name", "for", "until", "state", "serial"], rows))


def _authority_class() -> type[Authority]:
    try:
        from orientd.certificates import Authority
    except ImportError as error:
        raise ConfigError(
            f"certificates need the package `cryptography`: pip install 'orientd[tls]' ({error})"
        ) from error
    return Authority


def _told(issued: Issued) -> dict[str, object]:
    return {
        "name": issued.name,
        "serial": issued.serial,
        "expires": issued.expires.isoformat(),
        "is_server": issued.is_server,
        "is_revoked": issued.is_revoked,
        "certificate": issued.certificate,
        "key": issued.key,
    }


def _tell(issued: Issued, *, as_json: bool) -> None:
    if as_json:
        say_json(_told(issued))
    else:
        say(f"made {issued.certificate} and {issued.key}, until {issued.expires:%Y-%m-%d}")
