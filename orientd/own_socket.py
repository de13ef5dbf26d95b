"""Share the parts of every server: its socket, its clients, and the check of who sent a request.

A socket that cannot be bound is one clear line.
"""

from __future__ import annotations

import contextlib
import errno
import os
import socket
import time
from ipaddress import ip_address
from typing import Any
from urllib.parse import urlsplit

from orientd.errors import DaemonError

MOST_CLIENTS = 32
"""Most clients of a server at a time."""

_EXHAUSTED = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)
_PAUSE = 0.1
"""Seconds until the next look if no descriptor is left to hang up with."""


def own_socket(host: str, port: int, kind: socket.SocketKind = socket.SOCK_STREAM) -> socket.socket:
    """Return a socket bound to *host* and *port*; one for TCP listens.

    Args:
        host: an address or a name of this machine.
        port: 0 for any.
        kind: ``SOCK_STREAM`` for TCP, ``SOCK_DGRAM`` for UDP.

    Raises:
        DaemonError: the port is in use, or the address is not one of this machine.
    """
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=kind)[0]
        if kind == socket.SOCK_STREAM:
            return socket.create_server(address[:2], family=family)
        opened = socket.socket(family, kind)
        try:
            opened.bind(address)
        except OSError:
            opened.close()
            raise
        return opened
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            problem = f"port {port} is in use; choose another with --port"
        else:
            reason = error.strerror or str(error)
            problem = f"{reason.partition(' (')[0]}; check --host and --port"
        raise DaemonError(f"cannot serve at {host}: {problem}") from error


class ClientListener:
    """Accept the clients of a TCP server, at most :data:`MOST_CLIENTS` at a time.

    The server hangs up on a client that comes when there are as many, or when the process or the
    machine has no descriptor left.
    """

    def __init__(self, listener: socket.socket) -> None:
        """Accept clients at a socket that listens."""
        self._listener = listener
        self._open: list[socket.socket] = []
        self._spare = _spare_descriptor()

    def accept(self) -> tuple[socket.socket, Any]:
        """Wait for the next client; return its socket and its address.

        Raises:
            ConnectionError: the client has gone, or the server has hung up on it.
            OSError: the listener is closed.
        """
        try:
            client, address = self._listener.accept()
        except OSError as error:
            if error.errno not in _EXHAUSTED:
                raise
            self._hang_up()
            raise ConnectionRefusedError("no descriptor is left") from error
        self._open = [one for one in self._open if one.fileno() >= 0]
        if len(self._open) >= MOST_CLIENTS:
            client.close()
            raise ConnectionRefusedError(f"there are {MOST_CLIENTS} clients already")
        self._open.append(client)
        return client, address

    def close(self) -> None:
        """Close the listener; the clients stay."""
        self._listener.close()
        self._release()

    def _hang_up(self) -> None:
        """Hang up on the next client, with the descriptor that is kept for that."""
        if self._spare is None:
            time.sleep(_PAUSE)
        else:
            self._release()
            with contextlib.suppress(OSError):
                self._listener.accept()[0].close()
        self._spare = _spare_descriptor()

    def _release(self) -> None:
        if self._spare is not None:
            os.close(self._spare)
            self._spare = None


def _spare_descriptor() -> int | None:
    try:
        return os.open(os.devnull, os.O_RDONLY)
    except OSError:
        return None


def is_own_page(origin: str | None, host: str, *, is_local: bool) -> bool:
    """Return whether a request comes from a page that was served here, or from no browser.

    Any web page can make a browser send requests to this machine.

    Args:
        origin: of the page, by the request; ``None`` for no browser.
        host: that the request was sent to.
        is_local: whether the server serves this machine only.  Then the host must be a name of this
            machine, because an attacker can make another name resolve to it.
    """
    try:
        if is_local and not is_loopback(urlsplit(f"//{host}").hostname or ""):
            return False
        return origin is None or (bool(host) and urlsplit(origin).netloc == host)
    except ValueError:
        return False


def is_loopback(host: str) -> bool:
    """Return whether *host* is a name or an address of this machine for itself.

    >>> is_loopback("localhost"), is_loopback("127.0.0.1"), is_loopback("192.0.2.1")
    (True, True, False)
    """
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False
