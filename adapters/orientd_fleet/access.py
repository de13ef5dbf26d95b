"""The Zenoh session of a member of a cell: endpoints, TLS on both sides, access control.

Zenoh checks the common name of a certificate at the link that a message comes by.  A name in no
list reads nothing and asks nothing.  A caller reads presence, clocks and states, and stops in its
own name.  All commands go to a daemon's control socket or TLS port, which knows the roles.
"""

from __future__ import annotations

import contextlib
import json
import os
import ssl
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from orientd import config
from orientd.client.trust import check_folder
from orientd.errors import ConfigError, DaemonError
from orientd_fleet.keys import ROOT, UNIX_ADDRESS, key_of
from orientd_fleet.settings import TLS, UNIX, FleetSettings, MemberSettings

if TYPE_CHECKING:
    import zenoh

LINK_LEASE_MS = 3000
"""A link without a sign of life for so long is given up."""

LARGEST_BYTES = 16 * 1024 * 1024
"""Of one message."""

_WATCHING = ["declare_liveliness_subscriber", "liveliness_query"]
_ANSWERING = ["put", "delete", "reply", "declare_queryable", "declare_subscriber",
              "liveliness_token", *_WATCHING]  # fmt: skip
_ALL = ["query", *_ANSWERING]

_NO_DEVICE = {"devices": {"none": {"driver": "loopback"}}}
_WILDCARDS = ("0.0.0.0", "::", "*")

Tree = dict[str, Any]


def member_configuration(settings: MemberSettings, *, is_router: bool = False) -> Tree:
    """Return Zenoh's configuration of a daemon, or of a router.

    Raises:
        ConfigError: TLS lacks a certificate.
        DaemonError: the folder of a Unix socket is open to others.
    """
    fleet, tcp = settings.fleet, settings.tcp
    tree = session_configuration(fleet.listen, fleet.connect, is_router=is_router)
    if fleet.is_tls:
        files: list[Path] = []
        for name in ("certificate", "key", "ca"):
            path = getattr(fleet, name) or getattr(tcp, name, None)
            if path is None:
                raise ConfigError(f"fleet.{name}: missing, and there is none of [tcp] either")
            files.append(path)
        tree["transport"]["link"]["tls"] = tls_configuration(*files)
        tree["access_control"] = _access_control(fleet, settings.access.certificates)
    return tree


def router_configuration(path: Path) -> Tree:
    """Return Zenoh's configuration of the router that the file at *path* describes.

    The file has the tables ``[fleet]`` and ``[access.certificates]`` of a daemon's, and no devices.

    Raises:
        ConfigError: the file cannot be read or is not well formed.
    """
    table = _NO_DEVICE | config.read_table(path)
    settings = config.parse_as(MemberSettings, table, source=str(path))
    return member_configuration(settings, is_router=True)


def address_of(settings: MemberSettings, socket: Path) -> str:
    """Return the address at which a daemon of a cell takes calls.

    Args:
        settings: of the daemon.
        socket: its control socket, the address in a cell without TLS.

    Raises:
        ConfigError: the cell has TLS, and the daemon has no address that others can use.
    """
    if not settings.fleet.is_tls:
        return f"{UNIX_ADDRESS}{socket}"
    if settings.tcp is None:
        raise ConfigError("fleet: commands go to the daemon's TLS port; add the table [tcp]")
    host, port = settings.tcp.host_and_port
    address = settings.fleet.address or settings.tcp.listen
    if address == settings.tcp.listen and (host in _WILDCARDS or not port):
        raise ConfigError(
            f"fleet.address: expected the HOST:PORT of [tcp] as others reach it, got {address}"
        )
    return address


def session_configuration(
    listen: Sequence[str],
    connect: Sequence[str],
    *,
    is_router: bool = False,
    timeout: float | None = None,
) -> Tree:
    """Return the configuration that every session has.

    A session that listens is a peer: all peers connect to each other.  One that does not is a
    client: the router or peer that it is connected to carries everything for it.

    Args:
        listen: endpoints for others.
        connect: endpoints of others.
        is_router: whether it carries messages between others.
        timeout: how long to try to connect before that is an error, s; ``None`` for ever.

    Raises:
        DaemonError: the folder of a Unix socket is open to others.
    """
    for endpoint in (*listen, *connect):
        if endpoint.startswith(UNIX):
            check_folder(Path(endpoint.removeprefix(UNIX)).parent)
    return {
        "mode": "router" if is_router else "peer" if listen else "client",
        # Without a list Zenoh listens at a port of its own.
        "listen": {"endpoints": list(listen), "exit_on_failure": True},
        "connect": {
            "endpoints": list(connect),
            "exit_on_failure": timeout is not None,
            "timeout_ms": -1 if timeout is None else round(timeout * 1e3),
        },
        # Daemons that know one of them find the others by gossip.
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": True}},
        "transport": {
            "link": {
                "tx": {"lease": LINK_LEASE_MS},
                "rx": {"max_message_size": LARGEST_BYTES},
                "protocols": [TLS.rstrip("/"), UNIX.rstrip("/")],
            },
            # It would double the memory, and nothing here is shared.
            "shared_memory": {"enabled": False},
        },
    }


def tls_configuration(certificate: Path, key: Path, ca: Path) -> Tree:
    """Return the configuration of TLS with certificates on both sides."""
    return {
        "root_ca_certificate": str(ca),
        "listen_certificate": str(certificate),
        "listen_private_key": str(key),
        "connect_certificate": str(certificate),
        "connect_private_key": str(key),
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }


def _access_control(fleet: FleetSettings, callers: Collection[str]) -> Tree:
    def of_all(what: str, name: str = "") -> str:
        return key_of(fleet.cell, "*", what, name)

    rules: list[Tree] = []
    subjects, policies = [], []

    def allow(who: str, names: Collection[str], *given: tuple[str, list[str], list[str]]) -> None:
        """Let certificates send (``ingress``) or get (``egress``) messages with some keys."""
        if not names:
            return
        ids = [f"{who} {number}" for number in range(len(given))]
        rules.extend(
            {"id": id_, "permission": "allow", "flows": [flow], "messages": messages,
             "key_exprs": keys}
            for id_, (flow, messages, keys) in zip(ids, given, strict=True)
        )  # fmt: skip
        subjects.append({"id": who, "cert_common_names": list(names)})
        policies.append({"rules": ids, "subjects": [who]})

    everything = [f"{ROOT}/{fleet.cell}/**"]
    state, clock, alive = [of_all("state")], [of_all("clock")], [of_all("alive", "**")]
    # Another daemon answers and publishes, but asks nothing.
    allow("daemons", fleet.daemons, ("ingress", _ANSWERING, everything),
          ("egress", _ALL, everything))  # fmt: skip
    allow("routers", fleet.routers, ("ingress", _ALL, everything), ("egress", _ALL, everything))
    allow("callers", callers,
          ("ingress", ["query"], clock), ("egress", ["reply"], clock),
          ("ingress", ["declare_subscriber"], state), ("egress", ["put"], state),
          ("ingress", _WATCHING, alive), ("egress", ["liveliness_token"], alive),
          ("egress", ["declare_queryable"], [*clock, of_all("stop", "*")]))  # fmt: skip
    for name in callers:
        stop = [of_all("stop", name)]
        allow(f"caller {name}", [name], ("ingress", ["query"], stop), ("egress", ["reply"], stop))
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def common_name(certificate: Path, key: Path, ca: Path) -> str:
    """Return the common name of a client's certificate.

    A handshake in memory reads and verifies it, as a daemon does that trusts *ca*.

    Raises:
        DaemonError: a file cannot be read, the certificate is refused, or it has no such name.
    """
    daemon, client = map(ssl.SSLContext, (ssl.PROTOCOL_TLS_SERVER, ssl.PROTOCOL_TLS_CLIENT))
    to_daemon, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    try:
        daemon.verify_mode = ssl.CERT_REQUIRED
        daemon.load_verify_locations(ca)
        client.check_hostname, client.verify_mode = False, ssl.CERT_NONE
        for context in (daemon, client):
            context.load_cert_chain(certificate, key)
        ours = client.wrap_bio(to_client, to_daemon)
        theirs = daemon.wrap_bio(to_daemon, to_client, server_side=True)
        for end in (ours, theirs, ours, theirs):
            with contextlib.suppress(ssl.SSLWantReadError):
                end.do_handshake()
    except OSError as error:  # ssl's errors are OSErrors
        reason = getattr(error, "verify_message", "") or error.strerror or str(error)
        raise DaemonError(f"cannot use the certificate {certificate}: {reason}") from error
    subject: Any = (theirs.getpeercert() or {}).get("subject", ())
    names = [value for part in subject for kind, value in part if kind == "commonName"]
    if not names:
        raise DaemonError(f"the certificate {certificate} has no common name")
    return str(names[0])


def open_session(configuration: Tree) -> zenoh.Session:
    """Open a session of Zenoh.

    Raises:
        ConfigError: the extra ``fleet`` is not installed, or Zenoh refuses a value.
        DaemonError: an endpoint cannot be listened at or reached.
    """
    try:
        import zenoh
    except ImportError as error:
        raise ConfigError("a fleet needs Zenoh: pip install 'orientd-motion[fleet]'") from error
    try:
        parsed = zenoh.Config.from_json5(json.dumps(configuration))
    except zenoh.ZError as error:
        raise ConfigError(f"fleet: {_first_line(error)}") from error
    # A Unix socket that Zenoh makes is for its own user.
    before = os.umask(0o177)
    try:
        return zenoh.open(parsed)
    except zenoh.ZError as error:
        ends = [*configuration["connect"]["endpoints"], *configuration["listen"]["endpoints"]]
        raise DaemonError(
            f"no member of a fleet at {', '.join(ends)}, or not with this certificate: "
            f"{_first_line(error)}"
        ) from error
    finally:
        os.umask(before)


def _first_line(error: Exception) -> str:
    return str(error).partition(" at /")[0].splitlines()[0]
