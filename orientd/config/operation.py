"""The tables that say how the daemon is operated: who may reach it and how, and what is kept.

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

from orientd.bounded_file import MEBIBYTE
from orientd.config.table import Positive, SomePath, Table, checked


class Role(IntEnum):
    """What somebody may do; each role may do what the ones before it may."""

    OBSERVER = 1
    """Look, and stop."""
    OPERATOR = 2
    """Plan, take the lease, and move."""
    ADMINISTRATOR = 3
    """Take the lease away from others."""


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
        socket: where to listen; ``None`` is the user's runtime directory.
        lease_seconds: how long a lease lasts when its holder does not renew it, s.
        log_level: of what is logged.
    """

    socket: SomePath | None = None
    lease_seconds: Annotated[float, Field(ge=0.2, le=3600.0)] = 5.0
    log_level: Literal["debug", "info", "warning", "error"] = "info"


class RecorderSettings(Table):
    """The table ``[recorder]``: the flight recorder, which writes a file on every fault.

    Attributes:
        directory: where to; ``None`` is ``orientd/recordings`` in the user's state directory.
        seconds: that are kept in memory and written, 0 for no flight recorder at all; a device
            takes 344 bytes a cycle, 10 MB for 60 s at 500 Hz.
        keep_files: how many files are kept, the newest.
        keep_megabytes: how large they may be altogether.
    """

    directory: SomePath | None = None
    seconds: Annotated[float, Field(ge=0.0, le=600.0)] = 60.0
    keep_files: Annotated[int, Field(ge=1, le=100_000)] = 20
    keep_megabytes: Positive = 200.0


class AccessSettings(Table):
    """The table ``[access]``: who may do what, and how much of it.

    The user that runs the daemon is always an administrator, and so is root, which nothing could
    keep from being one.  Nobody else may do anything unless a table here says so.

    Attributes:
        users: roles by name or number of a user, on the Unix socket.
        groups: roles by name or number of a group, on the Unix socket.
        certificates: roles by the name in a certificate, over TCP.
        audit: where commands are recorded; ``None`` is ``audit.jsonl`` in the user's state
            directory.
        audit_bytes: how large that file becomes before another is begun.
        audit_files: how many of those before it are kept.
        message_bytes: the largest message; 200,000 keyframes with times take 8 MB.
        keyframes: the most keyframes of one motion.
        streams: calls of one identity at the same time; stops and renewals do not count.
        connections: of one identity at the same time; an idle one gives way to a later one.
    """

    users: dict[str, SomeRole] = Field(default_factory=dict)
    groups: dict[str, SomeRole] = Field(default_factory=dict)
    certificates: dict[str, SomeRole] = Field(default_factory=dict)
    audit: SomePath | None = None
    audit_bytes: Annotated[int, Field(ge=4096)] = 10 * MEBIBYTE
    audit_files: Annotated[int, Field(ge=1, le=1000)] = 5
    message_bytes: Annotated[int, Field(ge=4096, le=512 * MEBIBYTE)] = 8 * MEBIBYTE
    keyframes: Count = 200_000
    streams: Count = 128
    connections: Count = 128


class MetricsSettings(Table):
    """The table ``[metrics]``: what Prometheus scrapes, at 127.0.0.1 alone.

    Attributes:
        port: where; 0 is any that is free, which the log tells.
    """

    port: Annotated[int, Field(ge=0, le=65535)]


class TcpSettings(Table):
    """The table ``[tcp]``: a second way in, with TLS 1.3 and certificates on both sides.

    Attributes:
        listen: address and port.
        certificate: of the daemon, PEM.
        key: of that certificate, PEM.
        ca: certificates that those of clients are signed with, PEM.
        crl: which of them are revoked, PEM.
        revoked: serial numbers of more that are, hexadecimal.
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
        processes: how many; ``None`` is one for each core, from 3 to 6.
        plan_timeout: how long a plan may take at the most, waiting for its turn included, s.
    """

    processes: Annotated[int, Field(ge=1, le=64)] | None = None
    plan_timeout: Annotated[float, Field(ge=0.05, le=3600.0)] = 10.0
