"""One client's socket: what is to be sent, what came, and when each may pass."""

from __future__ import annotations

import contextlib
import socket
from collections import deque

_LARGEST_BACKLOG = 1 << 20


class ClientConnection:
    """A non-blocking socket with queues that can hold bytes back.

    Attributes:
        kind: which port it came in on: ``rtde``, ``dashboard``, ``script`` or ``faults``.
        is_closed: whether it is to be forgotten.
    """

    def __init__(self, sock: socket.socket, kind: str) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.sock = sock
        self.kind = kind
        self.is_closed = False
        self._unsent = bytearray()
        self._outgoing: deque[tuple[int, bytes]] = deque()
        self._incoming: deque[tuple[int, bytes]] = deque()

    def receive(self, now_ns: int, delay_ns: int) -> None:
        """Take what has come; it may be read *delay_ns* from now."""
        try:
            chunk = self.sock.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            self.is_closed = True
            return
        if not chunk:
            self.is_closed = True
            return
        # Without this the kernel acknowledges late, and a client whose sender waits for
        # acknowledgements (Nagle) sends late in turn.
        with contextlib.suppress(OSError):
            self.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
        self._incoming.append((now_ns + delay_ns, chunk))

    def take(self, now_ns: int) -> bytes:
        """Return what has come and may be read now."""
        parts: list[bytes] = []
        while self._incoming and self._incoming[0][0] <= now_ns:
            parts.append(self._incoming.popleft()[1])
        return b"".join(parts)

    def send(self, message: bytes, now_ns: int, delay_ns: int = 0) -> None:
        """Queue *message*, to leave *delay_ns* from now."""
        if message:
            self._outgoing.append((now_ns + delay_ns, message))
            self.flush(now_ns)

    def flush(self, now_ns: int) -> None:
        """Send what is due, as far as the kernel takes it."""
        while self._outgoing and self._outgoing[0][0] <= now_ns:
            self._unsent += self._outgoing.popleft()[1]
        if not self._unsent or self.is_closed:
            return
        try:
            sent = self.sock.send(self._unsent)
        except BlockingIOError:
            # A client that does not read for seconds is cut off, as a controller does.
            self.is_closed = len(self._unsent) > _LARGEST_BACKLOG
            return
        except OSError:
            self.is_closed = True
            return
        del self._unsent[:sent]

    def close(self) -> None:
        """Close the socket."""
        self.is_closed = True
        self.sock.close()
