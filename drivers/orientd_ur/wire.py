"""Connections to a controller with timeouts: to its RTDE server and to its dashboard server.

The client library waits for ever for a controller that accepts a connection and sends nothing.  All
other requests to a controller use these connections.

RTDE is version 2 of the protocol, big endian: ``u16 size, u8 kind, payload``.
"""

from __future__ import annotations

import math
import socket
import struct
import time
from collections.abc import Callable, Sequence
from typing import Self, TypeVar

from orientd.errors import LinkError

PRIMARY_PORT = 30001
SCRIPT_PORT = 30003
RTDE_PORT = 30004
DASHBOARD_PORT = 29999

Sample = dict[str, tuple[float, ...]]
"""Values of one data package by the names of the variables."""

_T = TypeVar("_T")
_HEADER = struct.Struct(">HB")
_LARGEST = 0xFFFF
_VERSION, _CONTROLLER_VERSION, _OUTPUTS, _INPUTS, _START, _DATA = map(ord, "VvOISU")
_TYPES = {
    "DOUBLE": struct.Struct(">d"),
    "VECTOR6D": struct.Struct(">6d"),
    "INT32": struct.Struct(">i"),
    "UINT32": struct.Struct(">I"),
}


def numeric_address(host: str) -> str:
    """Return the IPv4 address of *host*.

    Raises:
        LinkError: the name is unknown.
    """
    try:
        return str(socket.getaddrinfo(host, None, socket.AF_INET)[0][4][0])
    except (OSError, UnicodeError) as error:
        # UnicodeError is for invalid names, with an empty or too long part.
        raise LinkError(f"{host}: the name cannot be resolved: {_words(error)}") from error


def _words(error: Exception) -> str:
    """Return the text of an error, without the number of the system."""
    return getattr(error, "strerror", None) or str(error)


class Connection:
    """A connection to one port of a controller; a context manager.

    Args:
        host: the controller's address.
        port: of the controller.
        server: name of the server, for messages.
        timeout: s for connecting and for each whole answer, in however many pieces.
        total: s in total.

    Raises:
        LinkError: no server answers.

    Attributes:
        sock: the socket.
    """

    def __init__(
        self, host: str, port: int, server: str, timeout: float, *, total: float = math.inf
    ) -> None:
        self._server = f"the {server} at {host}:{port}"
        self._timeout = timeout
        self._ends = time.monotonic() + total
        self._pending = b""
        try:
            self.sock = socket.create_connection((host, port), timeout)
        except OSError as error:
            step = "check the address, and switch the robot on"
            raise LinkError(f"no {server} at {host}:{port}: {_words(error)}; {step}") from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.sock.close()

    def send(self, contents: bytes) -> None:
        """Send *contents*.

        Raises:
            LinkError: the connection is gone.
        """
        try:
            self.sock.sendall(contents)
        except OSError as error:
            raise LinkError(f"{self._server} is gone: {_words(error)}") from error

    def receive(self, find: Callable[[bytes], tuple[_T, bytes] | None], awaited: str) -> _T:
        """Return the result of *find* in the received bytes.

        Args:
            find: returns the result and the remaining bytes, or ``None`` so far; raises
                ``ValueError``.
            awaited: name of the result, for messages.

        Raises:
            LinkError: it did not arrive in time, or the bytes are something else.
        """
        ends = min(time.monotonic() + self._timeout, self._ends)
        try:
            while (found := find(self._pending)) is None:
                left = ends - time.monotonic()
                if left <= 0.0:
                    raise TimeoutError("timed out")
                self.sock.settimeout(left)
                chunk = self.sock.recv(65536)
                if not chunk:
                    raise ConnectionResetError("it closed the connection")
                self._pending += chunk
        except (OSError, ValueError) as error:
            raise LinkError(f"{self._server} did not send {awaited}: {_words(error)}") from error
        contents, self._pending = found
        return contents


def take(stream: bytes, header: struct.Struct, largest: int) -> tuple[int, bytes, bytes] | None:
    """Return kind and payload of the first message and the remaining bytes, or ``None`` so far.

    Args:
        stream: the bytes.
        header: of size and kind; the size includes it.
        largest: size of a message.

    Raises:
        ValueError: the bytes are no message.
    """
    if len(stream) < header.size:
        return None
    size, kind = header.unpack_from(stream)
    if not header.size <= size <= largest:
        raise ValueError(f"a message of {size} bytes")
    return (kind, stream[header.size : size], stream[size:]) if len(stream) >= size else None


class RtdeClient(Connection):
    """A connection to a controller's RTDE server.

    Args:
        host: the controller's address.
        timeout: s for connecting and for each answer.
        total: s in total.

    Raises:
        LinkError: no server answers, or it does not speak the protocol.
    """

    def __init__(self, host: str, timeout: float, *, total: float = math.inf) -> None:
        super().__init__(host, RTDE_PORT, "RTDE server", timeout, total=total)
        self._variables: dict[str, struct.Struct] = {}
        try:
            if self._ask(_VERSION, struct.pack(">H", 2)) != b"\x01":
                raise LinkError(f"{self._server} does not speak version 2 of RTDE")
        except LinkError:
            self.sock.close()
            raise

    def controller_version(self) -> tuple[int, ...]:
        """Return the four numbers of the controller's version.

        Raises:
            LinkError: the controller does not report them.
        """
        answer = self._ask(_CONTROLLER_VERSION)
        if len(answer) != 16:
            raise LinkError(f"{self._server} says its version in {len(answer)} bytes, not 16")
        return struct.unpack(">4I", answer)

    def claim(self, *registers: str) -> bool:
        """Return whether this connection has the exclusive right to write *registers* from now on.

        Raises:
            LinkError: the controller does not answer.
        """
        return b"IN_USE" not in self._ask(_INPUTS, ",".join(registers).encode())

    def subscribe(self, frequency: float, names: Sequence[str], *, optional: str = "") -> None:
        """Request the variables *names*, *frequency* times a second, in place of earlier ones.

        Args:
            frequency: Hz.
            names: of the variables.
            optional: a variable that older software does not know.

        Raises:
            LinkError: the controller does not know a variable.
        """
        answer = self._ask(_OUTPUTS, struct.pack(">d", frequency) + ",".join(names).encode())
        types = dict(zip(names, answer[1:].decode("ascii", "replace").split(","), strict=False))
        unknown = [name for name in names if types.get(name, "").strip() not in _TYPES]
        if unknown == [optional]:
            self.subscribe(frequency, [name for name in names if name != optional])
            return
        if unknown:
            raise LinkError(f"{self._server} does not know the RTDE variable {', '.join(unknown)}")
        self._variables = {name: _TYPES[types[name].strip()] for name in names}
        self._ask(_START)

    def sample(self) -> Sample:
        """Return the next data package.

        Raises:
            LinkError: none arrives, or a different one.
        """
        payload = self.receive(_finder(_DATA), "data packages")
        try:
            return self._decoded(payload)
        except ValueError as error:
            raise LinkError(f"{self._server} does not answer what was asked: {error}") from error

    def samples_in(self, chunk: bytes) -> list[Sample]:
        """Return the data packages that are complete with *chunk*, just read from the socket.

        Raises:
            ValueError: the bytes do not match the request.
        """
        self._pending += chunk
        found = []
        while (taken := take(self._pending, _HEADER, _LARGEST)) is not None:
            kind, payload, self._pending = taken
            if kind == _DATA:
                found.append(self._decoded(payload))
        return found

    def _decoded(self, payload: bytes) -> Sample:
        # A recipe's number comes first.
        size, at = 1 + sum(one.size for one in self._variables.values()), 1
        if len(payload) != size:
            raise ValueError(f"a data package is {size} bytes, got {len(payload)}")
        sample = {}
        for name, one in self._variables.items():
            sample[name] = one.unpack_from(payload, at)
            at += one.size
        return sample

    def _ask(self, kind: int, payload: bytes = b"") -> bytes:
        self.send(_HEADER.pack(_HEADER.size + len(payload), kind) + payload)
        return self.receive(_finder(kind), f"an answer to {chr(kind)!r}")


class Dashboard(Connection):
    """A connection to the dashboard server of one robot; a context manager.

    Args:
        host: the robot's address.
        timeout: s for connecting and for each whole answer.

    Raises:
        LinkError: no server answers.
    """

    def __init__(self, host: str, *, timeout: float = 0.4) -> None:
        super().__init__(host, DASHBOARD_PORT, "dashboard server", timeout)
        try:
            self.receive(_line, "its greeting")
        except LinkError:
            self.sock.close()
            raise

    def ask(self, command: str) -> str:
        """Send *command* and return the answer.

        Raises:
            LinkError: no answer came.
        """
        self.send(command.encode() + b"\n")
        return self.receive(_line, f"an answer to {command!r}")

    @property
    def is_remote(self) -> bool | None:
        """Whether the robot is in remote control; ``None`` if it does not know the command."""
        answer = self.ask("is in remote control").lower()
        return True if "true" in answer else False if "false" in answer else None


def _line(stream: bytes) -> tuple[str, bytes] | None:
    line, end, rest = stream.partition(b"\n")
    return (line.decode("utf-8", "replace").strip(), rest) if end else None


def _finder(wanted: int) -> Callable[[bytes], tuple[bytes, bytes] | None]:
    """Return a function that finds the next RTDE package of a kind and skips others."""

    def find(stream: bytes) -> tuple[bytes, bytes] | None:
        while (taken := take(stream, _HEADER, _LARGEST)) is not None:
            kind, payload, stream = taken
            if kind == wanted:
                return payload, stream
        return None

    return find
