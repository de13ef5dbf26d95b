"""One client: the protocol of its port, and its socket, which can delay bytes."""

from __future__ import annotations

import contextlib
import socket
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from emulated_ur.controller import Controller, Event
from emulated_ur.primary import EVERY_TICKS, event_message, state_message, version_message
from emulated_ur.urscript import Splitter

_LARGEST_BACKLOG = 1 << 20


class Talk:
    """One client's protocol; this one says nothing.

    Attributes:
        greeting: first message to the client.
    """

    greeting = b""

    def feed(self, chunk: bytes) -> bytes:  # noqa: ARG002
        """Receive bytes of the client; return the answer."""
        return b""

    def tick(self) -> bytes:
        """Return the message to the client in this tick."""
        return b""

    def tell(self, event: Event) -> bytes:  # noqa: ARG002
        """Return the message to the client about an event."""
        return b""

    def close(self) -> None:
        """Handle the client's disconnection."""


class LineTalk(Talk):
    """A line in, a line out: the dashboard server, interpreter mode, the control channel.

    Args:
        reply: answers a line, without the line's end.
        greeting: first line to the client; empty for none.
    """

    def __init__(self, reply: Callable[[str], str], greeting: str = "") -> None:
        self.greeting = f"{greeting}\n".encode() if greeting else b""
        self._reply = reply
        self._pending = b""

    def feed(self, chunk: bytes) -> bytes:
        """Receive bytes of the client; return the answers."""
        *lines, self._pending = (self._pending + chunk).split(b"\n")
        replies = [self._reply(line.decode("utf-8", "replace")) for line in lines]
        return "".join(f"{reply}\n" for reply in replies).encode()


class ScriptTalk(Talk):
    """URScript in; on the primary and secondary interfaces the robot's state out, at 10 Hz.

    Args:
        robot: the controller.
        kind: ``primary``, ``secondary`` or ``script``; the first two may be ``read-only``.
    """

    def __init__(self, robot: Controller, kind: str) -> None:
        self.greeting = version_message(robot) if kind != "script" else b""
        self._robot = robot
        self._kind = kind
        self._splitter = Splitter()
        self._is_first = True

    def feed(self, chunk: bytes) -> bytes:
        """Receive a part of a program, except on read-only ports."""
        if self._kind.endswith("read-only"):
            return b""
        for program in self._splitter.feed(chunk):
            self._robot.upload(program)
        return b""

    def tick(self) -> bytes:
        """Return the robot's state when it is due."""
        if self._kind == "script" or self._robot.ticks % EVERY_TICKS:
            return b""
        is_first, self._is_first = self._is_first, False
        return state_message(self._robot, is_first=is_first)

    def tell(self, event: Event) -> bytes:
        """Return the message about an event, which only the primary interface has."""
        return event_message(self._robot, event) if self._kind.startswith("primary") else b""

    def close(self) -> None:
        """Report a client that disconnects in the middle of a program."""
        if unfinished := self._splitter.unfinished:
            self._robot.say(f"program refused: it has no end: {unfinished[:80]!r}")


@dataclass(slots=True)
class Delays:
    """Delays of bytes: received ones, sent ones, and each sent one."""

    coming_ns: int = 0
    going_ns: int = 0
    byte_ns: int = 0


class ClientConnection:
    """A non-blocking socket with queues that can delay bytes.

    Attributes:
        kind: its port: ``rtde``, ``dashboard``, ``script`` and so on.
        talk: the protocol.
        is_closed: whether it should be removed.
    """

    def __init__(self, sock: socket.socket, kind: str, talk: Talk, delays: Delays) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.sock = sock
        self.kind = kind
        self.talk = talk
        self.is_closed = False
        self._delays = delays
        self._unsent = bytearray()
        self._outgoing: deque[tuple[int, bytes]] = deque()
        self._incoming: deque[tuple[int, bytes]] = deque()

    def receive(self) -> None:
        """Read from the socket."""
        try:
            chunk = self.sock.recv(65536)
        except BlockingIOError:
            return
        except OSError:
            chunk = b""
        if not chunk:
            self.is_closed = True
            return
        # Otherwise the kernel acknowledges late, and a client whose sender waits for
        # acknowledgements (Nagle) sends late too.
        with contextlib.suppress(OSError):
            self.sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_QUICKACK, 1)
        self._incoming.append((time.monotonic_ns() + self._delays.coming_ns, chunk))

    def take(self) -> bytes:
        """Return the received bytes that are due."""
        now_ns = time.monotonic_ns()
        parts: list[bytes] = []
        while self._incoming and self._incoming[0][0] <= now_ns:
            parts.append(self._incoming.popleft()[1])
        return b"".join(parts)

    def send(self, message: bytes) -> None:
        """Queue *message* to be sent after the delay."""
        if not message:
            return
        due_ns = time.monotonic_ns() + self._delays.going_ns
        if pace_ns := self._delays.byte_ns:
            steps = enumerate(message, start=1)
            self._outgoing += [(due_ns + n * pace_ns, bytes([byte])) for n, byte in steps]
        else:
            self._outgoing.append((due_ns, message))
        self.flush()

    def flush(self) -> None:
        """Send the bytes that are due, as far as the kernel accepts them."""
        now_ns = time.monotonic_ns()
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
        self.talk.close()
        self.sock.close()
