"""The tables of the daemon's operation: access, endpoints, recordings, metrics, planning.

.. code-block:: toml

    [access.users]
    alice = "operator"

    [tcp]
    listen = "192.168.10.1:7450"
    certificate = "~/cell/server.pem"
    key = "~/cell/server.key"
    ca = "~/cell/ca.pem"
    crl = "~/cell/crl.pem"

    [access.certificates]
    pendant = "operator"
"""

from __future__ import annotations

from enum import IntEnum
from typing import Annotated, Literal

from pydantic import Field, PlainSerializer

from orientd.config.table import Positive, SomePath, Table, checked
from orientd.files import MEBIBYTE


class Role(IntEnum):
    """Rights of a user; each role includes the ones before it."""

    OBSERVER = 1
    """Watch, and stop."""
    OPERATOR = 2
    """Plan, take the lease, and move."""
    ADMINISTRATOR = 3
    """Seize the leases of others."""


def is_host_and_port(address: str) -> bool:
    """Return whether *address* is ``HOST:PORT``."""
    host, _, port = address.rpartition(":")
    return bool(host) and port.isascii() and port.isdigit() and int(port) < 65536


def _endpoint(value: str) -> str:
    if not is_host_and_port(value):
        raise ValueError
    return value


def _serial(value: str) -> str:
    digits = value.replace(":", "").upper()
    if not 0 < len(digits) <= 40 or set(digits) - set("0123456789ABCDEF"):
        raise ValueError
    return digits.lstrip("0")


_ROLES = {role.name.lower(): role for role in Role}

SomeRole = Annotated[
    Role,
    checked(f"one of {', '.join(_ROLES)}", _ROLES.__getitem__),
    PlainSerializer(lambda role: role.name.lower(), return_type=str),
]
Endpoint = Annotated[str, checked("HOST:PORT", _endpoint)]
Serial = Annotated[str, checked("a serial number of at most 40 hexadecimal digits", _serial)]
Count = Annotated[int, Field(ge=1)]


class DaemonSettings(Table):
    """The table ``[daemon]``.

    Attributes:
        socket: path of the daemon's socket; by default in the user's runtime directory.
        lease_seconds: time after which a lease expires if its holder does not renew it, s.
        log_level: lowest level of messages to log.
    """

    socket: SomePath | None = None
    lease_seconds: Annotated[float, Field(ge=0.2, le=3600.0)] = 5.0
    log_level: Literal["debug", "info", "warning", "error"] = "info"


class RecorderSettings(Table):
    """The table ``[recorder]``: the flight recorder, which writes a file at every fault.

    Attributes:
        directory: folder of the recordings; by default ``orientd/recordings`` in the user's state
            directory.
        seconds: length of a recording, s; 0 turns the flight recorder off.  It needs 440 bytes of
            memory per cycle: 10 MB for 60 s at 500 Hz.
        keep_files: number of recordings to keep; the oldest are deleted.
        keep_megabytes: total size of the recordings to keep, MB.
    """

    directory: SomePath | None = None
    seconds: Annotated[float, Field(ge=0.0, le=600.0)] = 60.0
    keep_files: Annotated[int, Field(ge=1, le=100_000)] = 20
    keep_megabytes: Positive = 200.0


class AccessSettings(Table):
    """The table ``[access]``: roles of users, and limits of one caller.

    Root and the user that runs the daemon are always administrators.  Other users have only the
    roles that you give them here.

    Attributes:
        users: roles by name or number of a user, on the Unix socket.
        groups: roles by name or number of a group, on the Unix socket.
        certificates: roles by the name in a certificate, over TCP.
        audit: file of the audit log; by default ``audit.jsonl`` in the user's state directory.
        audit_bytes: size at which the daemon starts a new audit log.
        audit_files: number of earlier audit logs to keep.
        message_bytes: largest size of a message.  A motion file of 8 MiB fits into the default; so
            do 200,000 keyframes with times, as columns.
        keyframes: largest number of keyframes of a motion.
        streams: largest number of simultaneous calls of one identity; stops and lease renewals do
            not count.
        connections: largest number of simultaneous connections of one identity.  A new connection
            closes an idle one.  If all are busy, as many more may connect, but only to stop
            devices.
    """

    users: dict[str, SomeRole] = Field(default_factory=dict)
    groups: dict[str, SomeRole] = Field(default_factory=dict)
    certificates: dict[str, SomeRole] = Field(default_factory=dict)
    audit: SomePath | None = None
    audit_bytes: Annotated[int, Field(ge=4096)] = 10 * MEBIBYTE
    audit_files: Annotated[int, Field(ge=1, le=1000)] = 5
    message_bytes: Annotated[int, Field(ge=4096, le=512 * MEBIBYTE)] = 9 * MEBIBYTE
    keyframes: Count = 200_000
    streams: Count = 128
    connections: Count = 128


class MetricsSettings(Table):
    """The table ``[metrics]``: metrics for Prometheus, at 127.0.0.1 only.

    Attributes:
        port: TCP port; 0 chooses a free one, which the log shows.
    """

    port: Annotated[int, Field(ge=0, le=65535)]


class TcpSettings(Table):
    """The table ``[tcp]``: an endpoint with TLS 1.3 and certificates on both sides.

    Attributes:
        listen: address and port.
        certificate: file with the daemon's certificate, PEM.
        key: file with the key of the daemon's certificate, PEM.
        ca: file with the CAs that sign the certificates of clients, PEM.
        crl: file with the CA's list of revoked certificates, PEM.
        revoked: serial numbers of further revoked certificates, hexadecimal.
    """

    listen: Endpoint
    certificate: SomePath
    key: SomePath
    ca: SomePath
    crl: SomePath | None = None
    revoked: list[Serial] = Field(default_factory=list)

    @property
    def host_and_port(self) -> tuple[str, int]:
        """Where to listen."""
        host, _, port = self.listen.rpartition(":")
        return host.removeprefix("[").removesuffix("]"), int(port)


class PlannerSettings(Table):
    """The table ``[planner]``: the processes that plan.

    Attributes:
        processes: number of processes; by default one per core, at least 3 and at most 6.
        plan_timeout: longest time for a plan, including its wait in the queue, s.
    """

    processes: Annotated[int, Field(ge=1, le=64)] | None = None
    plan_timeout: Annotated[float, Field(ge=0.05, le=3600.0)] = 10.0
