"""Sockets that a command serves at, bound with one clear line if that is not possible."""

from __future__ import annotations

import errno
import socket

from orientd.errors import DaemonError


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
