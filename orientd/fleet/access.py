"""Zenoh's configuration of a member of a cell: endpoints, TLS on both sides, access control.

Access control is by the name in a certificate, which Zenoh checks at the link a message comes by:
whoever is in no list reads nothing and commands nothing, and a caller's calls go to keys with their
own name in them.  What a role may do there is decided by the daemon, as on its control socket.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from orientd import config
from orientd.config import TLS, UNIX, FleetSettings, TcpSettings
from orientd.errors import ConfigError, DaemonError
from orientd.fleet.keys import ROOT, as_caller, of_daemon, presence
from orientd.rpc import check_folder, verified

LINK_LEASE_MS = 3000
"""After how long without a sign of life a link is given up."""

LARGEST_BYTES = 16 * 1024 * 1024
"""Of a message; what the daemon takes is less."""

_WATCHING = ("declare_liveliness_subscriber", "liveliness_query")
_ANSWERING = ("put", "delete", "reply", "declare_queryable", "declare_subscriber",
              "liveliness_token", *_WATCHING)  # fmt: skip
_ALL = ("query", *_ANSWERING)

_NO_DEVICE = {"devices": {"none": {"driver": "loopback"}}}

Rule = dict[str, Any]


def zenoh_configuration(
    settings: FleetSettings,
    tcp: TcpSettings | None = None,
    *,
    callers: Collection[str] = (),
    is_router: bool = False,
) -> dict[str, Any]:
    """Return what Zenoh is to be configured with, by its own paths.

    Args:
        settings: of the member.
        tcp: whose certificate is used where *settings* name none.
        callers: names in the certificates of clients, whatever their roles.
        is_router: whether it is a router rather than a daemon.

    Raises:
        ConfigError: TLS is asked for without a certificate, or the folder of a Unix socket is
            open to others.
    """
    configuration = basic_configuration(settings.listen, settings.connect, is_router=is_router)
    if not settings.is_tls:
        return configuration
    files: list[Path] = []
    for name in ("certificate", "key", "ca"):
        path = getattr(settings, name) or getattr(tcp, name, None)
        if path is None:
            raise ConfigError(f"fleet.{name}: missing, and there is none of [tcp] either")
        files.append(path)
    configuration |= tls_configuration(*files)
    configuration["access_control"] = _access_control(settings, callers)
    return configuration


def router_configuration(path: Path) -> dict[str, Any]:
    """Return Zenoh's configuration of the router that the file at *path* describes.

    It has the tables ``[fleet]`` and ``[access.certificates]`` as a daemon's, and needs no devices.

    Raises:
        ConfigError: the file cannot be read or is not well formed.
    """
    settings = config.parse(_NO_DEVICE | config.read_table(path), source=str(path))
    if settings.fleet is None:
        raise ConfigError(f"{path}: fleet: missing")
    callers = list(settings.access.certificates)
    return zenoh_configuration(settings.fleet, settings.tcp, callers=callers, is_router=True)


def nested(configuration: Mapping[str, Any]) -> dict[str, Any]:
    """Return values by Zenoh's paths as the tree that its own files hold.

    >>> nested({"mode": "router", "listen/endpoints": []})
    {'mode': 'router', 'listen': {'endpoints': []}}
    """
    tree: dict[str, Any] = {}
    for path, value in configuration.items():
        *folders, last = path.split("/")
        place = tree
        for folder in folders:
            place = place.setdefault(folder, {})
        place[last] = value
    return tree


def basic_configuration(
    listen: Sequence[str],
    connect: Sequence[str],
    *,
    is_router: bool = False,
    timeout: float | None = None,
) -> dict[str, Any]:
    """Return what every session is configured with.

    Whoever listens is a peer, one of those that all connect to each other; whoever does not is a
    client, for whom the router or peer that it is connected to carries everything.

    Args:
        listen: where others may connect.
        connect: where to connect.
        is_router: whether it carries between others.
        timeout: how long to try to connect before that is an error, s; ``None`` for ever.

    Raises:
        DaemonError: the folder of a Unix socket is open to others.
    """
    for endpoint in (*listen, *connect):
        if endpoint.startswith(UNIX):
            check_folder(Path(endpoint.removeprefix(UNIX)).parent)
    return {
        "mode": "router" if is_router else "peer" if listen else "client",
        # Without it Zenoh listens at a port of its own.
        "listen/endpoints": list(listen),
        "listen/exit_on_failure": True,
        "connect/endpoints": list(connect),
        "connect/exit_on_failure": timeout is not None,
        "connect/timeout_ms": -1 if timeout is None else round(timeout * 1e3),
        "scouting/multicast/enabled": False,
        # By these, daemons that know one of them find the others.
        "scouting/gossip/enabled": True,
        "transport/link/tx/lease": LINK_LEASE_MS,
        "transport/link/rx/max_message_size": LARGEST_BYTES,
        "transport/link/protocols": [TLS.rstrip("/"), UNIX.rstrip("/")],
        # Twice as many bytes more, for nothing that is shared here.
        "transport/shared_memory/enabled": False,
    }


def tls_configuration(certificate: Path, key: Path, ca: Path) -> dict[str, Any]:
    """Return the configuration of TLS with certificates on both sides."""
    return {
        "transport/link/tls": {
            "root_ca_certificate": str(ca),
            "listen_certificate": str(certificate),
            "listen_private_key": str(key),
            "connect_certificate": str(certificate),
            "connect_private_key": str(key),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }
    }


def _access_control(settings: FleetSettings, callers: Iterable[str]) -> Mapping[str, Any]:
    cell = settings.cell
    everything = [f"{ROOT}/{cell}/**"]
    telemetry = [of_daemon(cell, "*", what) for what in ("state", "events")]
    rules: list[Rule] = [
        _rule("carry", _ALL, everything, "ingress", "egress"),
        # Another daemon answers and tells, but asks for nothing.
        _rule("tell", _ANSWERING, everything, "ingress"),
        _rule("be told", _ALL, everything, "egress"),
        _rule("watch", ("declare_subscriber",), telemetry, "ingress"),
        _rule("see telemetry", ("put", "delete"), telemetry, "egress"),
        _rule("look around", _WATCHING, [of_daemon(cell, "*", "alive")], "ingress"),
        _rule("see daemons", ("liveliness_token",), [of_daemon(cell, "*", "alive")], "egress"),
        _rule("see calls", ("declare_queryable",), [of_daemon(cell, "*", "as/**")], "egress"),
    ]
    looks = ["watch", "see telemetry", "look around", "see daemons", "see calls"]
    subjects, policies = [], []
    for number, name in enumerate(callers):
        calls = [as_caller(cell, "*", name, "**")]
        rules += [
            _rule(f"ask {number}", ("query",), calls, "ingress"),
            _rule(f"hear {number}", ("reply",), calls, "egress"),
            _rule(f"be {number}", ("liveliness_token",), [presence(cell, name, "*")], "ingress"),
        ]
        own = [f"{what} {number}" for what in ("ask", "hear", "be")]
        subjects.append({"id": f"caller {number}", "cert_common_names": [name]})
        policies.append({"rules": [*looks, *own], "subjects": [f"caller {number}"]})
    for kind, names, allowed in (
        ("daemons", settings.daemons, ["tell", "be told"]),
        ("routers", settings.routers, ["carry"]),
    ):
        if names:
            subjects.append({"id": kind, "cert_common_names": list(names)})
            policies.append({"rules": allowed, "subjects": [kind]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(name: str, messages: Iterable[str], keys: Sequence[str], *flows: str) -> Rule:
    return {
        "id": name,
        "permission": "allow",
        "flows": list(flows),
        "messages": list(messages),
        "key_exprs": list(keys),
    }


def common_name(certificate: Path, key: Path, ca: Path) -> str:
    """Return the common name of a client's certificate.

    Raises:
        DaemonError: a file cannot be read, the certificate does not count, or it has no such name.
    """
    try:
        subject = verified(certificate, key, ca).get("subject", ())
    except OSError as error:  # ssl's errors are OSErrors
        reason = getattr(error, "verify_message", "") or error.strerror or str(error)
        raise DaemonError(f"cannot use the certificate {certificate}: {reason}") from error
    names = [value for part in subject for kind, value in part if kind == "commonName"]
    if not names:
        raise DaemonError(f"the certificate {certificate} has no common name")
    return str(names[0])
