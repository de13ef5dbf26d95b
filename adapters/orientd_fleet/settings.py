"""The table of the daemon's configuration that makes it one of several: its cell, over Zenoh.

.. code-block:: toml

    [fleet]
    cell = "line"
    name = "arm-3"
    connect = ["tls/192.168.10.1:7447"]
    certificate = "~/cell/arm-3.pem"
    key = "~/cell/arm-3.key"
    ca = "~/cell/ca.pem"
    daemons = ["arm-1", "arm-2"]
    routers = ["router"]
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field, model_validator

from orientd import config
from orientd.config.operation import Endpoint, is_host_and_port
from orientd.config.table import Name, SomePath, Table, checked
from orientd.errors import ConfigError, RequestError

UNIX = "unixsock-stream/"
TLS = "tls/"


def _zenoh_endpoint(value: str) -> str:
    address = value.removeprefix(TLS)
    is_tls = value.startswith(TLS) and is_host_and_port(address) and "#" not in address
    if not (is_tls or value.startswith(f"{UNIX}/")):
        raise ValueError
    return value


ZenohEndpoint = Annotated[str, checked(f"{TLS}HOST:PORT or {UNIX}/PATH", _zenoh_endpoint)]


class FleetSettings(Table):
    """The table ``[fleet]``: reach this daemon, and have it found, over Zenoh.

    ``orientd fleet serve`` reads this table.  Over TLS a caller is who their certificate says, with
    the role that ``[access.certificates]`` gives them.  A Unix socket is for the daemon's own user
    alone.

    Attributes:
        cell: name of the cell; a stop of the cell stops all daemons with this name.
        name: name of this daemon, unique in its cell.
        listen: endpoints to listen on: ``tls/HOST:PORT`` or ``unixsock-stream/PATH``.
        connect: endpoints of daemons or routers, through which this daemon finds the others.
        certificate: file with this daemon's certificate, PEM; default: that of ``[tcp]``.
        key: file with the key of the certificate, PEM; default: that of ``[tcp]``.
        ca: file with the CAs that sign all certificates, PEM; default: that of ``[tcp]``.
        daemons: names in the certificates of the other daemons of the cell.
        routers: names in the certificates of routers.  The daemon trusts them to check the
            certificates of clients.
        address: ``HOST:PORT`` at which others reach the daemon's TLS port; by default
            ``tcp.listen``.
        state_hz: rate at which the gateway publishes the daemon's state while a client listens, Hz.
    """

    cell: Name
    name: Name
    listen: list[ZenohEndpoint] = Field(default_factory=list)
    connect: list[ZenohEndpoint] = Field(default_factory=list)
    certificate: SomePath | None = None
    key: SomePath | None = None
    ca: SomePath | None = None
    daemons: list[str] = Field(default_factory=list)
    routers: list[str] = Field(default_factory=list)
    address: Endpoint | None = None
    state_hz: Annotated[float, Field(gt=0.0, le=100.0)] = 10.0

    @property
    def is_tls(self) -> bool:
        """Whether endpoints use TLS, with certificates on both sides."""
        return any(endpoint.startswith(TLS) for endpoint in self.listen + self.connect)

    @model_validator(mode="after")
    def _check_endpoints(self) -> FleetSettings:
        endpoints = self.listen + self.connect
        if not endpoints:
            raise RequestError("listen", "expected an endpoint here or in fleet.connect, got none")
        if self.is_tls and any(endpoint.startswith(UNIX) for endpoint in endpoints):
            raise RequestError("listen", "expected TLS everywhere, or Unix sockets everywhere")
        return self


class MemberSettings(config.Settings):
    """A daemon's configuration as its gateway reads it.

    Attributes:
        fleet: the table ``[fleet]``.
    """

    fleet: FleetSettings


def read_settings(path: Path | None = None) -> MemberSettings:
    """Return the settings in *path*, or in the file that the daemon uses if none is named.

    Raises:
        ConfigError: there is no such file, it has no table ``[fleet]``, or it is not well formed.
    """
    path = path or config.find()
    if path is None:
        raise ConfigError("there is no configuration: name one with a table [fleet] (--config)")
    return config.parse_as(MemberSettings, config.read_table(path), source=str(path))
