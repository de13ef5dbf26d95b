"""Connections to the daemon: over its Unix socket, or over TCP with certificates on both sides."""

from __future__ import annotations

import logging
import os
import socket as sockets
import stat
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from orientd import first_stop
from orientd.client.trust import check_socket
from orientd.errors import DaemonError
from orientd.files import MEBIBYTE, read_bounded

if TYPE_CHECKING:
    import grpc

# A motion of 200,000 keyframes with times and positions takes 13 MB.
MAX_MESSAGE_BYTES = 64 * MEBIBYTE

# struct sockaddr_un has 108 bytes for the path and its terminating zero.
MAX_PATH_BYTES = 107

ADDRESSES = "orientd.addresses"
"""Group of entry points: what resolves addresses ``SCHEME:NAME``, called as its scheme."""

_CLIENT_OPTIONS = (
    ("grpc.max_send_message_length", MAX_MESSAGE_BYTES),
    ("grpc.max_receive_message_length", MAX_MESSAGE_BYTES),
    ("grpc.keepalive_time_ms", 10_000),
    ("grpc.keepalive_timeout_ms", 5_000),
    # Find a restarted daemon quickly, even in a process with older clients that still retry.  gRPC
    # would wait for up to two minutes.
    ("grpc.use_local_subchannel_pool", 1),
    ("grpc.initial_reconnect_backoff_ms", 100),
    ("grpc.max_reconnect_backoff_ms", 500),
)


def found_socket() -> Path:
    """Return the socket of a daemon: the user's own, or else that of the system."""
    return Path(first_stop.found_socket())


def default_socket() -> Path:
    """Return the default socket of the daemon."""
    return Path(first_stop.default_socket())


def target(socket: Path) -> str:
    """Return gRPC's name of the Unix domain socket at *socket*.

    Raises:
        DaemonError: the path is too long for a socket.
    """
    path = socket.absolute()
    if not path.as_posix().isprintable():
        raise DaemonError(f"the path of a socket must be text that is shown, got {str(path)!r}")
    size = len(os.fsencode(path))
    if size > MAX_PATH_BYTES:
        raise DaemonError(
            f"the path of a socket has at most {MAX_PATH_BYTES} bytes, {path} has {size}; "
            "choose a shorter one"
        )
    return f"unix:{path}"


def certificate_files(
    address: str,
    certificate: str | Path | None,
    key: str | Path | None,
    ca: str | Path | None,
) -> list[Path]:
    """Return certificate, key and CA of a client; ``None`` means the environment's.

    Raises:
        DaemonError: one that *address* needs is missing, cannot be read, or is not what it should
            be.
    """
    files = {
        "ORIENTD_CERT": certificate or os.environ.get("ORIENTD_CERT"),
        "ORIENTD_KEY": key or os.environ.get("ORIENTD_KEY"),
        "ORIENTD_CA": ca or os.environ.get("ORIENTD_CA"),
    }
    missing = [name for name, path in files.items() if not path]
    if missing:
        raise DaemonError(
            f"{address} needs a certificate, its key and that of the CA: "
            f"--cert, --key and --ca, or the environment's {', '.join(missing)}"
        )
    paths = [Path(path).expanduser() for path in files.values() if path]
    _check_certificates(*paths)
    return paths


def _check_certificates(certificate: Path, key: Path, ca: Path) -> None:
    """Check the files of a client, since gRPC does not say what is wrong with them.

    Raises:
        DaemonError: one cannot be read, or is not what it should be.
    """
    # Connections to a Unix socket do without TLS.
    from orientd.config import TlsFileError, check_tls_files

    try:
        check_tls_files(certificate, key, ca)
    except TlsFileError as error:
        raise DaemonError(str(error)) from error
    mode = stat.S_IMODE(key.stat().st_mode)
    if os.name == "posix" and mode & stat.S_IROTH:
        problem = "every user can read the private key %s (mode %o): chmod 600 it"
        logging.getLogger(__name__).warning(problem, key, mode)


def _read(path: Path) -> bytes:
    try:
        return read_bounded(path, MEBIBYTE)
    except OSError as error:
        raise DaemonError(f"cannot read {path}: {error.strerror}") from error


def _resolved(
    address: str,
    certificate: str | Path | None,
    key: str | Path | None,
    ca: str | Path | None,
) -> str:
    """Return where an address ``SCHEME:NAME`` of an installed package leads.

    The package's entry point is a function of the name and of the three files of the client.  It
    returns ``HOST:PORT``, or ``unix:`` and a socket.  Any other address is returned as it is.

    Raises:
        DaemonError: the package cannot be loaded, or finds no daemon.
    """
    scheme, _, name = address.partition(":")
    if scheme == "unix" or name.isdigit():
        return address
    from importlib.metadata import entry_points  # slow to load, and few addresses need it

    for entry in entry_points(group=ADDRESSES):
        if entry.name == scheme:
            try:
                resolve = entry.load()
            except ImportError as error:
                raise DaemonError(f"{address}: cannot load {entry.value}: {error}") from error
            return str(resolve(name, certificate, key, ca))
    return address


@dataclass(frozen=True)
class Way:
    """The endpoint of a daemon.

    Attributes:
        socket: its Unix socket; for an address, the place of its files.
        address: ``HOST:PORT``; empty for the Unix socket.
        certificate: of this client, PEM.
        key: of that certificate, PEM.
        ca: signs the daemon's certificate, PEM.
    """

    socket: Path
    address: str = ""
    certificate: Path | None = None
    key: Path | None = None
    ca: Path | None = None

    @classmethod
    def find(
        cls,
        socket: str | Path | None = None,
        address: str | None = None,
        certificate: str | Path | None = None,
        key: str | Path | None = None,
        ca: str | Path | None = None,
    ) -> Way:
        """Return the requested endpoint; the environment supplies what is ``None``.

        ``ORIENTD_SOCKET``, or ``ORIENTD_ADDRESS`` with ``ORIENTD_CERT``, ``ORIENTD_KEY`` and
        ``ORIENTD_CA``; a given socket takes precedence over an address in the environment.

        Raises:
            DaemonError: a certificate is missing for an address, or this system has no Unix socket.
        """
        if address is None and socket is None:
            address = os.environ.get("ORIENTD_ADDRESS", "")
        if address:
            address = _resolved(address, certificate, key, ca)
        if address and address.startswith("unix:"):
            return cls(Path(address.removeprefix("unix:")))
        if not address:
            if not hasattr(sockets, "AF_UNIX"):
                raise DaemonError(
                    "this system has no Unix sockets: give the daemon's address (--address)"
                )
            return cls(Path(socket).expanduser() if socket is not None else found_socket())
        found = certificate_files(address, certificate, key, ca)
        name = "".join(letter if letter.isalnum() else "_" for letter in address)
        return cls(Path(first_stop.runtime_directory(), f"{name}.tcp"), address, *found)

    def __str__(self) -> str:
        return self.address or str(self.socket)

    def open(self) -> grpc.Channel:
        """Return a channel to the daemon, which connects on first use.

        Raises:
            DaemonError: a certificate cannot be read, or the path is not suitable for a socket or
                not owned by a trusted user.
            AccessError: the daemon admits only its own user.
        """
        import grpc  # the daemon asks for paths alone

        if not self.address:
            name = target(self.socket)
            check_socket(self.socket)
            return grpc.insecure_channel(name, options=_CLIENT_OPTIONS)
        contents = (
            _read(path) if path is not None else None
            for path in (self.ca, self.key, self.certificate)
        )
        credentials = grpc.ssl_channel_credentials(*contents)
        return grpc.secure_channel(self.address, credentials, options=_CLIENT_OPTIONS)
