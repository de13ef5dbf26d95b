"""Connections to emulated robots in the world, in place of TCP.

They are local sockets of the kernel: what one task sends is there before another runs, which the
kernel's TCP does not promise.  Addresses belong to this process alone.
"""

from __future__ import annotations

import os
import socket
import struct
import time
from collections import deque
from types import SimpleNamespace

from sockets import VirtualSocket

SO_TIMESTAMPNS = 35
CONNECTING = 0.0005
"""Time that a connection takes, s."""

_TIME = struct.Struct("qq")
_LARGEST_BUFFER = 1 << 22
_PID = os.getpid()


class RobotSocket(VirtualSocket):
    """One end of a connection, or a listener.  Its bytes arrive at once.

    Attributes:
        peer: the other end.
        arrivals: lengths of unread pieces, with the wall clock at their arrival; ``None`` if nobody
            wants to know.
    """

    def __init__(self, fileno=None):
        super().__init__(socket.AF_UNIX, socket.SOCK_STREAM, 0, fileno)
        super().setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _LARGEST_BUFFER)
        self.peer = self.arrivals = None

    def setsockopt(self, level, option, value):
        """Set the stamps of arrivals; options of TCP have no effect here."""
        if (level, option) == (socket.SOL_SOCKET, SO_TIMESTAMPNS):
            self.arrivals = deque() if value else None

    def accept(self):
        descriptor, name = self._await(self._accept)
        connection = RobotSocket(descriptor)
        connection.peer = self.world.sockets.connecting.pop(name)
        connection.peer.peer = connection
        return connection, ("127.0.0.1", 0)

    def _spend(self):
        pass

    def send(self, octets):
        count = super().send(octets)
        if self.peer is not None and self.peer.arrivals is not None:
            self.peer.arrivals.append((count, time.time_ns()))
        return count

    def recv(self, most):
        return self.recvmsg(most)[0]

    def recvmsg(self, most, _space=0):
        octets, notes = super().recv(most), []
        left = len(octets)
        while left > 0 and self.arrivals:
            count, at_ns = self.arrivals.popleft()
            if count > left:
                self.arrivals.appendleft((count - left, at_ns))
            left -= count
            stamp = _TIME.pack(*divmod(at_ns, 10**9))
            notes = [(socket.SOL_SOCKET, SO_TIMESTAMPNS, stamp)]
        return octets, notes, 0, None


def _name(address):
    host, port = address
    return f"\0world {_PID} {host}:{port}"


def create_server(address, **_):
    """Listen as :func:`socket.create_server` does."""
    listener = RobotSocket()
    try:
        listener.bind(_name(address))
        listener.listen(1000)
    except OSError:
        listener.close()
        raise
    return listener


def create_connection(address, timeout=None):
    """Connect as :func:`socket.create_connection` does."""
    connection = RobotSocket()
    world = connection.world
    connection.settimeout(timeout)
    connection.bind("")  # the kernel chooses a name
    name = connection.getsockname()
    world.sockets.connecting[name] = connection
    try:
        connection.connect(_name(address))
    except OSError:
        del world.sockets.connecting[name]
        connection.close()
        raise
    world.scheduler.sleep(CONNECTING)
    return connection


MODULE = SimpleNamespace(
    **{
        **vars(socket),
        "create_server": create_server,
        "create_connection": create_connection,
    }
)
"""In place of the module :mod:`socket`, for robots and their clients."""
