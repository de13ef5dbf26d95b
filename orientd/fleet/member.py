"""The way to one daemon of a cell, for whatever calls a daemon."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from orientd.errors import OrientdError
from orientd.rpc import Way, default_socket

if TYPE_CHECKING:
    import grpc

    from orientd.fleet.client import Fleet

ADDRESS = "fleet:"
"""What the address of a daemon of a cell begins with: ``fleet:DAEMON``."""


@dataclass(frozen=True)
class FleetMember(Way):
    """The way to a daemon of a cell.

    Attributes:
        fleet: knows the cell.
        name: of the daemon.
    """

    fleet: Fleet | None = None
    name: str = ""

    @classmethod
    def of(cls, fleet: Fleet, name: str) -> FleetMember:
        """Return the way to the daemon *name* of a cell that is known."""
        return cls(_kept(name), f"{fleet.cell}/{name}", fleet=fleet, name=name)

    @classmethod
    def at(
        cls,
        address: str,
        certificate: str | Path | None,
        key: str | Path | None,
        ca: str | Path | None,
    ) -> FleetMember:
        """Return the way to ``fleet:NAME``, of the cell that the environment names.

        The certificates are as for :func:`connect_fleet`.
        """
        name = address.removeprefix(ADDRESS)
        return cls(
            _kept(name),
            address,
            certificate=None if certificate is None else Path(certificate),
            key=None if key is None else Path(key),
            ca=None if ca is None else Path(ca),
            name=name,
        )

    def why_not(self) -> OrientdError | None:
        """Return nothing: whether a daemon is there is what the call has found out."""
        return None

    def open(self) -> grpc.Channel:
        """Return a channel to the daemon; without a fleet, one that ends its own.

        Raises:
            DaemonError: there is no such daemon, or no such cell.
        """
        if self.fleet is not None:
            return self.fleet.channel(self.name)
        from orientd.fleet.client import connect_fleet

        fleet = connect_fleet(
            wait_for=[self.name], certificate=self.certificate, key=self.key, ca=self.ca
        )
        return fleet.channel(self.name, on_close=fleet.close)


def _kept(name: str) -> Path:
    """Return where what belongs to a daemon of a cell is kept."""
    return default_socket().with_name(f"{name}.fleet")
