"""TCP in virtual time: sockets of this world, and a ``select`` that waits for them.

Bytes arrive at once and in order.  A process that ends closes its connections, as the kernel does.
"""

from __future__ import annotations

import errno
import itertools
import struct
import time
from types import SimpleNamespace

SO_TIMESTAMPNS = 35
CONNECTING = 0.0005
"""Time that a connection takes, s."""

_TIME = struct.Struct("qq")
_LARGEST_BUFFER = 1 << 20
_PORTS = itertools.count(40_000)


class Socket:
    """One end of a connection, or a listener, as ``socket.socket``.

    Attributes:
        address: of this end.
        group: of the process that has it.
        input: received pieces, with the wall clock at their arrival.
    """

    def __init__(self, network, address, peer=None):
        self.network, self.address, self.peer = network, address, peer
        self.group = network.scheduler.current().group
        self.input, self.waiting, self.is_closed, self.timeout = [], [], False, None

    def setblocking(self, is_blocking):
        self.timeout = None if is_blocking else 0.0

    def settimeout(self, seconds):
        self.timeout = seconds

    def setsockopt(self, *_):
        pass

    def getpeername(self):
        return self.peer.address

    @property
    def is_readable(self):
        """Whether a read returns at once."""
        return bool(self.input) or self.is_at_end

    @property
    def is_at_end(self):
        """Whether the other end is closed, or its process has ended."""
        peer = self.peer
        if peer is not None and not peer.is_closed and not self.network.scheduler.lives(peer.group):
            peer.close()
        return peer is not None and peer.is_closed

    def _await(self):
        """Wait until a read returns at once."""
        scheduler = self.network.scheduler
        until_ns = None
        if self.timeout is not None:
            until_ns = scheduler.now_ns + round(self.timeout * 1e9)
        while not self.is_readable:
            if self.is_closed:
                raise OSError(errno.EBADF, "Bad file descriptor")
            if self.timeout == 0.0:
                raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
            if until_ns is not None and scheduler.now_ns >= until_ns:
                raise TimeoutError("timed out")
            self.network.wait([self], until_ns)

    def accept(self):
        self._await()
        connection = self.input.pop(0)[0]
        connection.group = self.group
        return connection, connection.peer.address

    def recv(self, most):
        return self.recvmsg(most)[0]

    def recvmsg(self, most, _space=0):
        self._await()
        if not self.input:
            return b"", [], 0, None
        octets, at_ns = self.input.pop(0)
        if len(octets) > most:
            self.input.insert(0, (octets[most:], at_ns))
        note = _TIME.pack(*divmod(at_ns, 10**9))
        return octets[:most], [(1, SO_TIMESTAMPNS, note)], 0, None

    def makefile(self):
        return SimpleNamespace(readline=self._line)

    def _line(self):
        line = b""
        while not line.endswith(b"\n") and (octets := self.recv(65536)):
            line += octets
        return line.decode()

    def send(self, octets):
        if self.is_closed or self.is_at_end:
            raise BrokenPipeError(errno.EPIPE, "Broken pipe")
        if sum(len(piece) for piece, _ in self.peer.input) > _LARGEST_BUFFER:
            raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
        self.peer.put(bytes(octets))
        return len(octets)

    def sendall(self, octets):
        self.send(octets)

    def put(self, piece):
        """Have *piece* arrive."""
        self.input.append((piece, time.time_ns()))
        self.wake()

    def wake(self):
        for task in self.waiting:
            self.network.scheduler.wake(task)

    def close(self):
        self.is_closed = True
        self.network.forget(self)
        self.wake()
        if self.peer is not None:
            self.peer.wake()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


class Network:
    """What ``socket`` and ``select`` are in a world.

    Attributes:
        scheduler: of the tasks that use it.
    """

    AF_INET, SOL_SOCKET, IPPROTO_TCP, TCP_NODELAY, TCP_QUICKACK = 2, 1, 6, 1, 12
    error, socket = OSError, Socket

    def __init__(self, scheduler):
        self.scheduler, self._listeners = scheduler, {}

    def create_server(self, address, **_):
        if address in self._listeners:
            raise OSError(errno.EADDRINUSE, f"Address already in use: {address}")
        listener = self._listeners[address] = Socket(self, address)
        return listener

    def create_connection(self, address, timeout=None):
        listener = self._listeners.get(address)
        if listener is None or not self.scheduler.lives(listener.group):
            raise ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused")
        ours = Socket(self, ("127.0.0.1", next(_PORTS)))
        ours.timeout = timeout
        ours.peer = Socket(self, address, ours)
        ours.peer.group = listener.group
        listener.put(ours.peer)
        self.scheduler.sleep(CONNECTING)
        return ours

    def getaddrinfo(self, host, *_):
        return [(self.AF_INET, 1, 6, "", (host, 0))]

    def forget(self, listener):
        if self._listeners.get(listener.address) is listener:
            del self._listeners[listener.address]

    def select(self, readable, _writable, _exceptional, timeout=None):
        """Return the sockets that can be read, as soon as there is one."""
        until_ns = None if timeout is None else self.scheduler.now_ns + round(timeout * 1e9)
        while not (found := [one for one in readable if one.is_readable]):
            if until_ns is not None and self.scheduler.now_ns >= until_ns:
                break
            self.wait(readable, until_ns)
        return found, [], []

    def wait(self, sockets, until_ns):
        """Wait until something arrives at one of *sockets*, or until an instant."""
        task = self.scheduler.current()
        for one in sockets:
            one.waiting.append(task)
        try:
            self.scheduler.wait(until_ns)
        finally:
            for one in sockets:
                one.waiting.remove(task)
