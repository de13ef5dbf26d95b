"""The bus behind a port object with virtual time, in place of ``dynamixel_sdk``'s PortHandler.

Nothing here waits.  A read that would wait moves the clock to the next answer instead, or to the
end of the timeout.  So a test runs faster than real time, and always in the same way.
"""

# ruff: noqa: D102, N802 - the names are the SDK's, and so is what they mean

from __future__ import annotations

from typing import Protocol

from emulated_dynamixel.bus import Bus

_GLANCE_NS = 10_000


class Clock(Protocol):
    """Largest step of the clock in a read, ns."""

    def now_ns(self) -> int: ...

    def advance(self, step_ns: int) -> None: ...


class ManualClock:
    """A clock that stands still until it is moved."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Return the present time."""
        return self._now_ns

    def advance(self, step_ns: int) -> None:
        """Move forward."""
        self._now_ns += step_ns


class _Serial:
    """The part of ``serial.Serial`` that users of a PortHandler use."""

    def __init__(self) -> None:
        self.timeout: float | None = 0.0


class VirtualPort:
    """A PortHandler without a port.

    Attributes:
        bus: the bus.
        clock: moved by reads that wait.
        latency_ms: in place of the SDK's constant ``LATENCY_TIMER``.
        is_plugged: whether the adapter is there; without it reads and writes raise.
    """

    def __init__(self, bus: Bus, clock: Clock, *, latency_ms: float = 16.0) -> None:
        self.bus = bus
        self.clock = clock
        self.latency_ms = latency_ms
        self.is_plugged = True
        self.is_open = False
        self.is_using = False
        self.baudrate = 1_000_000
        self.tx_time_per_byte = 0.01
        self.packet_start_time = 0.0
        self.packet_timeout = 0.0
        self.port_name = "virtual"
        self.ser = _Serial()
        self._input = b""

    def openPort(self) -> bool:
        return self.setBaudRate(self.baudrate)

    def closePort(self) -> None:
        self.is_open = False

    def clearPort(self) -> None:
        self._check()
        self._input = b""

    def setBaudRate(self, baudrate: int) -> bool:
        self._check()
        self.baudrate = baudrate
        self.tx_time_per_byte = 1e4 / baudrate
        self.ser = _Serial()
        self._input = b""
        self.is_open = True
        return True

    def getBaudRate(self) -> int:
        return self.baudrate

    def getBytesAvailable(self) -> int:
        self._check()
        return len(self._input)

    def readPort(self, length: int) -> bytes:
        self._check()
        if len(self._input) < length:
            self._wait(length)
        octets, self._input = self._input[:length], self._input[length:]
        return octets

    def writePort(self, packet: list[int]) -> int:
        self._check()
        self.bus.receive(bytes(packet), self.clock.now_ns(), baud=self.baudrate)
        return len(packet)

    def setPacketTimeout(self, packet_length: int) -> None:
        self.packet_start_time = self.getCurrentTime()
        self.packet_timeout = self.tx_time_per_byte * packet_length + 2 * self.latency_ms + 2.0

    def setPacketTimeoutMillis(self, msec: float) -> None:
        self.packet_start_time = self.getCurrentTime()
        self.packet_timeout = msec

    def isPacketTimeout(self) -> bool:
        if self.getTimeSinceStart() > self.packet_timeout:
            self.packet_timeout = 0.0
            return True
        return False

    def getCurrentTime(self) -> float:
        return self.clock.now_ns() / 1e6

    def getTimeSinceStart(self) -> float:
        return self.getCurrentTime() - self.packet_start_time

    def _check(self) -> None:
        if not self.is_plugged:
            raise OSError("the adapter is gone")
        self._input += self.bus.wire.take(self.clock.now_ns())

    def _wait(self, length: int) -> None:
        """Move the clock until *length* bytes are there, but no further than a real read waits."""
        timeout_s = self.ser.timeout
        limit_ns = self.clock.now_ns() + (_GLANCE_NS if not timeout_s else round(timeout_s * 1e9))
        while len(self._input) < length:
            due_ns = self.bus.wire.due_ns()
            if due_ns is None or due_ns > limit_ns:
                self.clock.advance(max(0, limit_ns - self.clock.now_ns()))
                break
            self.clock.advance(max(0, due_ns - self.clock.now_ns()))
            self._input += self.bus.wire.take(self.clock.now_ns())
