"""Functions of URScript for sockets; they wait without blocking the controller."""

from __future__ import annotations

import math
import re
import select
import socket
import struct
from collections.abc import Callable
from typing import TYPE_CHECKING

from emulated_ur.arm import TICK
from emulated_ur.urscript import Array, Datum, written

if TYPE_CHECKING:
    from emulated_ur.controller import Controller
    from emulated_ur.urscript import Ticks

_CONNECTING = 2.0


class Sockets:
    """The open sockets of a program, by their names."""

    robot: Controller

    def __init__(self) -> None:
        self._sockets: dict[str, tuple[socket.socket, bytearray]] = {}

    def socket_open(self, address: str, port: int, socket_name: str = "socket_0") -> Ticks:
        self.socket_close(socket_name)
        link = socket.socket()
        link.setblocking(False)
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            link.connect_ex((address, int(port)))
        except OSError:  # no such host
            link.close()
            return False
        for _ in range(round(_CONNECTING / TICK)):
            if select.select([], [link], [], 0.0)[1]:
                break
            yield
        if link.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) or not _is_connected(link):
            link.close()
            return False
        self._sockets[socket_name] = (link, bytearray())
        return True

    def socket_close(self, socket_name: str = "socket_0") -> None:
        link, _ = self._sockets.pop(socket_name, (None, None))
        if link is not None:
            link.close()

    def socket_send_string(self, str: Datum, socket_name: str = "socket_0") -> bool:
        return self._send(written(str).encode(), socket_name)

    def socket_send_line(self, str: Datum, socket_name: str = "socket_0") -> bool:
        return self._send(written(str).encode() + b"\n", socket_name)

    def socket_send_int(self, value: int, socket_name: str = "socket_0") -> bool:
        return self._send(struct.pack(">i", int(value)), socket_name)

    def socket_send_byte(self, value: Datum, socket_name: str = "socket_0") -> bool:
        byte = value.encode()[:1] if isinstance(value, str) else bytes([int(value) & 0xFF])
        return self._send(byte, socket_name)

    def socket_set_var(self, name: str, value: int, socket_name: str = "socket_0") -> None:
        self._send(f"SET {name} {int(value)}\n".encode(), socket_name)

    def socket_get_var(self, name: str, socket_name: str = "socket_0") -> Ticks:
        self._send(f"GET {name}\n".encode(), socket_name)
        line = yield from self._read(socket_name, _line, 2.0)
        return int((line or b"0").split()[-1])

    def socket_read_binary_integer(
        self, number: int, socket_name: str = "socket_0", timeout: float = 2.0
    ) -> Ticks:
        packed = yield from self._read(socket_name, _exactly(4 * int(number)), timeout)
        if packed is None:
            return Array((0, *(-1,) * int(number)))
        return Array((int(number), *struct.unpack(f">{int(number)}i", packed)))

    def socket_read_byte_list(
        self, number: int, socket_name: str = "socket_0", timeout: float = 2.0
    ) -> Ticks:
        packed = yield from self._read(socket_name, _exactly(int(number)), timeout)
        return Array((0, *(-1,) * int(number)) if packed is None else (int(number), *packed))

    def socket_read_ascii_float(
        self, number: int, socket_name: str = "socket_0", timeout: float = 2.0
    ) -> Ticks:
        found = yield from self._read(socket_name, _bracketed, timeout)
        numbers = [float(one) for one in (found or b"").split(b",") if one.strip()]
        if len(numbers) != int(number):
            return Array((0, *(math.nan,) * int(number)))
        return Array((len(numbers), *numbers))

    def socket_read_line(self, socket_name: str = "socket_0", timeout: float = 2.0) -> Ticks:
        line = yield from self._read(socket_name, _line, timeout)
        return (line or b"").decode("utf-8", "replace")

    def socket_read_string(
        self, socket_name: str = "socket_0", prefix: str = "", suffix: str = "",
        interpret_escape: bool = False, timeout: float = 2.0,
    ) -> Ticks:  # fmt: skip
        if interpret_escape:
            prefix, suffix = (
                one.replace("\\n", "\n").replace("\\r", "\r") for one in (prefix, suffix)
            )
        find = _between(prefix.encode(), suffix.encode())
        found = yield from self._read(socket_name, find, timeout)
        return (found or b"").decode("utf-8", "replace")

    def end(self) -> None:
        """Close every socket."""
        for name in list(self._sockets):
            self.socket_close(name)

    def _send(self, message: bytes, name: str) -> bool:
        if name not in self._sockets:
            return False
        try:
            return self._sockets[name][0].send(message) == len(message)
        except OSError:
            return False

    def _read(self, name: str, find: Callable[[bytearray], bytes | None], timeout: float) -> Ticks:
        """Return what *find* extracts from the received bytes, or ``None``; 0 waits for ever."""
        left = timeout if timeout > 0.0 else math.inf
        while name in self._sockets:
            link, pending = self._sockets[name]
            is_open = True
            try:
                chunk = link.recv(65536)
                pending += chunk
                is_open = bool(chunk)
            except BlockingIOError:
                pass
            except OSError:
                is_open = False
            found = find(pending)
            if found is not None or not is_open or left <= 0.5 * TICK:
                return found
            left -= TICK
            yield
        return None


def _is_connected(link: socket.socket) -> bool:
    try:
        link.getpeername()
    except OSError:
        return False
    return True


def _exactly(count: int) -> Callable[[bytearray], bytes | None]:
    def find(pending: bytearray) -> bytes | None:
        if len(pending) < count:
            return None
        found = bytes(pending[:count])
        del pending[:count]
        return found

    return find


def _between(prefix: bytes, suffix: bytes) -> Callable[[bytearray], bytes | None]:
    pattern = re.compile(re.escape(prefix) + b"(.*?)" + (re.escape(suffix) or b"$"), re.DOTALL)

    def find(pending: bytearray) -> bytes | None:
        found = pattern.search(pending)
        if found is None or not found.group():
            return None
        inside = found.group(1)
        del pending[: found.end()]
        return bytes(inside)

    return find


_line = _between(b"", b"\n")
_bracketed = _between(b"(", b")")
