"""The servos' bus through the vendor's SDK, with workarounds for its defects.

This module handles all known defects of the SDK.  Its port stays busy after any exception.  It
waits busily, with timeouts of 34 ms on the wall clock.  Its byte stuffing is missing in sent
packets and removes too much in received ones.  It accepts answers of any length, and some versions
do not clear the input.  A pulled cable raises four kinds of exceptions.
"""

from __future__ import annotations

import errno
import os
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, NamedTuple

from orientd.errors import DeviceFaultError, LinkError
from orientd_dynamixel.tables import Register

ALERT = 0x80
ATTEMPTS = 4
"""Attempts to ask a servo, outside the cycle, before it counts as silent."""
PATIENT_ATTEMPTS = 12
"""The same while the torque comes on and nothing else waits.

The user need not retry because a machine was busy for a fifth of a second.
"""
READ_WAIT_S = 0.002
"""Longest single read of the port; the SDK repeats it until its timeout."""

_BROADCAST = 0xFE
_PING, _READ, _WRITE, _REBOOT = 0x01, 0x02, 0x03, 0x08
_HEADER = b"\xff\xff\xfd"
_GONE = (OSError, termios.error, IndexError, TypeError)
_NEXT_STEPS = {
    errno.ENOENT: "plug in the adapter, or correct `port`",
    errno.EACCES: "add your user to the group of the port",
    errno.EBUSY: "end the program that uses it",
    errno.EAGAIN: "end the program that uses it",
}
"""The next steps if a port cannot be opened."""
_ERRORS = {
    1: "it could not do it",
    2: "it does not know the instruction",
    3: "the instruction arrived damaged",
    4: "the value is out of range",
    5: "the length is not that of the register",
    6: "the value is beyond its limit",
    7: "the register cannot be written now",
}


class Block(NamedTuple):
    """One answer of a servo: its id, its error byte (alert bit and a number), the content."""

    id: int
    error: int
    content: bytes


class Row(NamedTuple):
    """One servo's part of a group read: its id, the first address, the number of bytes."""

    id: int
    address: int
    size: int


class _Sender:
    """A port for the SDK to send with, which does not clear the input first."""

    def __init__(self, port: Any) -> None:  # noqa: ANN401
        self.is_using = False
        self._port = port

    def clearPort(self) -> None:  # noqa: N802 - the SDK's name
        """Do nothing, instead of clearing the input."""

    def writePort(self, packet: Sequence[int]) -> int:  # noqa: N802 - the SDK's name
        """Send; return the number of bytes."""
        return int(self._port.writePort(packet))


class ServoBus:
    """The bus, owned by one thread.

    Args:
        port: an open PortHandler of the SDK, or an equivalent.
        handler: a Protocol2PacketHandler of the SDK.
        wait_ms: time for an answer in addition to its bytes; more than the adapter's latency.
    """

    def __init__(self, port: Any, handler: Any, *, wait_ms: float = 16.0) -> None:  # noqa: ANN401
        self._port = port
        self._handler = handler
        self._wait_ms = wait_ms
        self._sender = _Sender(port)
        self._lock = threading.Lock()

    @property
    def byte_ms(self) -> float:
        """Duration of a byte."""
        return float(self._port.tx_time_per_byte)

    @property
    def available(self) -> int:
        """Number of received bytes."""
        with self._owned("a look at the port"):
            return int(self._port.getBytesAvailable())

    def close(self) -> None:
        """Release the port; never raises."""
        with suppress(*_GONE, AttributeError):
            self._port.closePort()

    def ping(self, servo: int) -> tuple[int, int] | None:
        """Return model number and firmware of *servo*, ``None`` if it does not answer."""
        answer = self._transact(servo, _PING, b"", 3)
        if answer is None:
            return None
        return int.from_bytes(answer[:2], "little"), answer[2]

    def read(self, servo: int, register: Register, *, attempts: int = ATTEMPTS) -> int:
        """Return a register of *servo*.

        Args:
            servo: its id.
            register: the register.
            attempts: number of attempts.

        Raises:
            LinkError: no answer at any attempt.
            DeviceFaultError: the servo answered with an error.
        """
        address, count, is_signed = register
        request = address.to_bytes(2, "little") + count.to_bytes(2, "little")
        content = self._insist(servo, _READ, request, count, attempts)
        return int.from_bytes(content, "little", signed=is_signed)

    def write(self, servo: int, register: Register, value: int) -> None:
        """Write a register of *servo* and wait for its answer.

        Raises:
            LinkError: no answer at any attempt.
            DeviceFaultError: the servo answered with an error.
        """
        address, count, is_signed = register
        content = value.to_bytes(count, "little", signed=is_signed)
        self._insist(servo, _WRITE, address.to_bytes(2, "little") + content, 0, ATTEMPTS)

    def reboot(self, servo: int) -> None:
        """Restart *servo*; it is then silent for some 0.3 s."""
        self._transact(servo, _REBOOT, b"", 0)

    def sync_write(self, values: Sequence[tuple[int, Register, int]]) -> None:
        """Write a register of many servos; none of them answers or reports an error.

        Received bytes stay in the port: they may be an answer that is still to be read.

        Args:
            values: ``(id, register, value)`` of each servo; registers with the same address share
                one packet.
        """
        parameters: dict[Register, list[int]] = {}
        for servo, register, value in values:
            content = value.to_bytes(register.size, "little", signed=register.is_signed)
            parameters.setdefault(register, []).extend((servo, *content))
        for register, told in parameters.items():
            _check_stuffing(bytes(told))
            with self._owned("a write of goals"):
                result = self._handler.syncWriteTxOnly(
                    self._sender, register.address, register.size, told, len(told)
                )
            if result != 0:
                raise LinkError(f"a write of goals was not sent: {self._explain(result)}")

    def request(self, rows: Sequence[Row], *, is_fast: bool) -> None:
        """Request a block from each servo of a group, without waiting for the answers.

        Args:
            rows: in the order in which the servos must answer.
            is_fast: whether one packet holds all answers.
        """
        _, address, count = rows[0]
        with self._owned("a read request"):
            if all(row[1:] == (address, count) for row in rows):
                ids = [row.id for row in rows]
                result = self._handler.syncReadTx(
                    self._port, address, count, ids, len(ids), is_fast
                )
            else:
                parameters: list[int] = []
                for row in rows:
                    parameters.append(row.id)
                    parameters += row.address.to_bytes(2, "little") + row.size.to_bytes(2, "little")
                result = self._handler.bulkReadTx(self._port, parameters, len(parameters), is_fast)
        if result != 0:
            raise LinkError(f"a read request was not sent: {self._explain(result)}")

    def collect(
        self, rows: Sequence[Row], wait_ms: float, *, is_fast: bool
    ) -> tuple[list[Block], int | None]:
        """Read the answers to :meth:`request`.

        Args:
            rows: as requested.
            wait_ms: remaining time for all of them.
            is_fast: as requested.

        Returns:
            The answers received, in the order of the request, and the id of the first missing
            servo, if it is known.
        """
        with self._owned("the answers of a group"):
            self._port.setPacketTimeoutMillis(wait_ms)
            if is_fast:
                packet, result = self._receive()
                if result != 0:
                    return [], _first_missing(packet, rows)
                blocks = self._fast_blocks(packet, rows)
                return blocks, None if len(blocks) in {0, len(rows)} else rows[len(blocks)].id
            blocks = []
            start = self._port.getCurrentTime()
            for servo, _, count in rows:
                packet, result = self._receive()
                if result != 0 or packet[4] != servo or len(packet) < 11:
                    break
                body = _unstuffed(packet)
                if len(body) != count:
                    break
                blocks.append(Block(servo, packet[8], body))
                spent = self._port.getCurrentTime() - start
                self._port.setPacketTimeoutMillis(max(0.0, wait_ms - spent))
            return blocks, None if len(blocks) == len(rows) else rows[len(blocks)].id

    def _fast_blocks(self, packet: Sequence[int], rows: Sequence[Row]) -> list[Block]:
        """Split the one answer to a fast read, up to the first servo whose CRC is wrong.

        The CRC of each servo is over everything before it.  A later servo may have heard the same
        damage, so that its own CRC agrees.
        """
        blocks: list[Block] = []
        at, crc = 8, self._handler.updateCRC(0, packet, 8)
        if packet[4] != _BROADCAST or len(packet) != 8 + sum(row.size + 4 for row in rows):
            return blocks
        for servo, _, count in rows:
            if packet[at + 1] != servo:
                return []
            part, tail = packet[at : at + 2 + count], packet[at + 2 + count : at + 4 + count]
            crc = self._handler.updateCRC(crc, part, len(part))
            if list(tail) != [crc & 0xFF, crc >> 8]:
                break
            blocks.append(Block(servo, part[0], bytes(part[2:])))
            at, crc = at + 4 + count, self._handler.updateCRC(crc, tail, 2)
        return blocks

    def clear(self) -> None:
        """Discard the received bytes."""
        with self._owned("clearing the port"):
            self._port.clearPort()

    def _insist(
        self, servo: int, instruction: int, parameters: bytes, count: int, attempts: int
    ) -> bytes:
        for _ in range(attempts):
            answer = self._transact(servo, instruction, parameters, count)
            if answer is not None:
                return answer
        what = "read" if instruction == _READ else "write"
        address = int.from_bytes(parameters[:2], "little")
        raise LinkError(f"servo {servo} does not answer a {what} of address {address}")

    def _transact(
        self, servo: int, instruction: int, parameters: bytes, count: int
    ) -> bytes | None:
        """Ask one servo and return the content of its answer, ``None`` without a complete one."""
        _check_stuffing(parameters)
        length = len(parameters) + 3
        packet = [0] * (length + 7)
        packet[4:8] = [servo, length & 0xFF, length >> 8, instruction]
        packet[8 : 8 + len(parameters)] = parameters
        with self._owned(f"a transaction with servo {servo}"):
            result = self._handler.txPacket(self._port, packet)
            if result != 0:
                raise LinkError(f"servo {servo} was not asked: {self._explain(result)}")
            self._port.setPacketTimeoutMillis(
                self.byte_ms * (len(packet) + count + 11) + self._wait_ms + 2.0
            )
            while True:
                answer, result = self._receive()
                if result != 0:
                    return None
                # A late answer belongs to an earlier request, usually one of another size.
                content, number = _unstuffed(answer), answer[8] & ~ALERT
                if answer[4] == servo and (number or len(content) == count):
                    break
        if number:
            raise DeviceFaultError(
                f"servo {servo} refused instruction {instruction:#04x}: "
                f"{_ERRORS.get(number, f'error {number}')}"
            )
        return content

    def _receive(self) -> tuple[list[int], int]:
        # Receive it like a fast packet: with any id and without unstuffing, which the SDK gets
        # wrong if two headers follow each other.
        packet, result = self._handler.rxPacket(self._port, True)
        return packet, result

    @contextmanager
    def _owned(self, what: str) -> Iterator[None]:
        if not self._lock.acquire(blocking=False):
            raise LinkError(f"{what}: another thread is using the bus")
        try:
            yield
        except _GONE as error:
            raise LinkError(f"{what} failed: {error or type(error).__name__}") from error
        finally:
            # After any exception, the SDK leaves its port marked busy for ever.
            self._port.is_using = self._sender.is_using = False
            self._lock.release()

    def _explain(self, result: int) -> str:
        return str(self._handler.getTxRxResult(result)).removeprefix("[TxRxResult] ")


OpenBus = Callable[..., ServoBus]


def open_bus(
    port_name: str, baud: int, *, wait_ms: float = 16.0, glance_s: float = READ_WAIT_S
) -> ServoBus:
    """Open a serial port and return the bus on it.

    Args:
        port_name: path of the port.
        baud: line speed.
        wait_ms: time for an answer in addition to its bytes.
        glance_s: duration of one read of the port.

    Raises:
        LinkError: the port or the SDK is missing, or another process uses the port.
    """
    try:
        import dynamixel_sdk as sdk
    except ImportError as error:
        raise LinkError(
            "the Dynamixel SDK is not installed; try: "
            f"{sys.executable} -m pip install dynamixel-sdk pyserial"
        ) from error
    own = {"getCurrentTime": _steady_ms, "writePort": _write_at_once, "clearPort": _clear_input}
    port = type("SteadyPort", (sdk.PortHandler,), own)(port_name)
    port.baudrate = baud
    try:
        opened = port.openPort()
        port.ser.exclusive = True
    except _GONE as error:
        raise LinkError(f"cannot open {port_name}: {_reason(error)}") from error
    if not opened:
        raise LinkError(f"cannot open {port_name} at {baud} baud")
    # Opening creates a new serial object whose reads return at once: the SDK would spin.
    port.ser.timeout = glance_s
    with suppress(ValueError, OSError, AttributeError):
        # An FTDI adapter then passes answers on after 1 ms; others ignore this.
        port.ser.set_low_latency_mode(True)
    return ServoBus(port, sdk.Protocol2PacketHandler(), wait_ms=wait_ms)


def _reason(error: Exception) -> str:
    """Return why a port cannot be opened, and the next step; pyserial repeats the errno."""
    number = getattr(error, "errno", None)
    if number is None:
        return str(error) or type(error).__name__
    step = _NEXT_STEPS.get(number)
    return os.strerror(number) + (f"; {step}" if step else "")


def _steady_ms(_port: object) -> float:
    # The SDK uses the wall clock: setting the time would make every answer late.
    return time.monotonic_ns() / 1e6


def _write_at_once(port: Any, packet: Sequence[int]) -> int:  # noqa: ANN401 - of the SDK
    # After a write, pyserial asks the terminal whether it accepts more.  That waits until the
    # kernel has passed on the received bytes, which takes a second on a busy processor.
    try:
        return os.write(port.ser.fileno(), bytes(packet))
    except BlockingIOError:
        return 0  # the device takes nothing


def _clear_input(port: Any) -> None:  # noqa: ANN401 - of the SDK
    # Before version 4.1 the SDK waits here until everything is sent, and clears nothing.
    port.ser.reset_input_buffer()


def sendable(goal: int) -> int:
    """Return the first goal from *goal* on whose bytes contain no packet header."""
    while _HEADER in goal.to_bytes(4, "little", signed=True):
        goal += 1
    return goal


def _check_stuffing(parameters: bytes) -> None:
    # The SDK does not stuff sent packets; a servo would misread the rest of the packet.
    if _HEADER in parameters:
        raise ValueError(f"cannot be sent: {parameters.hex()} holds a packet header")


def _unstuffed(packet: Sequence[int]) -> bytes:
    """Return the content of a status packet, after its error byte."""
    return bytes(packet[7:-2]).replace(_HEADER + b"\xfd", _HEADER)[2:]


def _first_missing(packet: Sequence[int], rows: Sequence[Row]) -> int | None:
    """Return the servo at which the answer to a fast read broke off."""
    end = 8
    for servo, _, count in rows:
        end += count + 4
        if len(packet) < end:
            return servo
    return None
