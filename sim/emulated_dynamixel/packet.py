"""Bytes to packets and back: Dynamixel Protocol 2.0 without any input or output.

A packet is ``FF FF FD 00 | id | length | instruction | parameters | crc``, little endian.  The
length counts what follows it, stuffing included; the CRC covers everything before it, stuffing
included.  Source: ROBOTIS e-Manual, "DYNAMIXEL Protocol 2.0".
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

HEADER = b"\xff\xff\xfd\x00"
BROADCAST = 0xFE
MAX_LENGTH = 1024
SHORTEST = 10


class Instruction(IntEnum):
    """The instruction of a packet; ``STATUS`` marks an answer."""

    PING = 0x01
    READ = 0x02
    WRITE = 0x03
    REG_WRITE = 0x04
    ACTION = 0x05
    FACTORY_RESET = 0x06
    REBOOT = 0x08
    CLEAR = 0x10
    BACKUP = 0x20
    STATUS = 0x55
    SYNC_READ = 0x82
    SYNC_WRITE = 0x83
    FAST_SYNC_READ = 0x8A
    BULK_READ = 0x92
    BULK_WRITE = 0x93
    FAST_BULK_READ = 0x9A


SYNC = frozenset({Instruction.SYNC_READ, Instruction.FAST_SYNC_READ, Instruction.SYNC_WRITE})
FAST = frozenset({Instruction.FAST_SYNC_READ, Instruction.FAST_BULK_READ})
READS = FAST | {Instruction.SYNC_READ, Instruction.BULK_READ}
WRITES = frozenset({Instruction.SYNC_WRITE, Instruction.BULK_WRITE})


class ErrorNumber(IntEnum):
    """The low seven bits of a status packet's error byte: a number, not flags."""

    NONE = 0
    RESULT_FAIL = 1
    INSTRUCTION = 2
    CRC = 3
    DATA_RANGE = 4
    DATA_LENGTH = 5
    DATA_LIMIT = 6
    ACCESS = 7


ALERT = 0x80


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet with a correct CRC, without its stuffing.

    Attributes:
        id: of the addressed or answering servo, or :data:`BROADCAST`.
        instruction: a number; :class:`Instruction` names the valid ones.
        parameters: the rest; in a status packet the error byte comes first.
    """

    id: int
    instruction: int
    parameters: bytes = b""


@dataclass(frozen=True, slots=True)
class Damaged:
    """A packet whose CRC did not agree.  The id is what it claims."""

    id: int
    instruction: int


def _crc_table() -> tuple[int, ...]:
    table = []
    for i in range(256):
        value = i << 8
        for _ in range(8):
            value = (value << 1) ^ 0x8005 if value & 0x8000 else value << 1
        table.append(value & 0xFFFF)
    return tuple(table)


_TABLE = _crc_table()


def crc16(octets: bytes, crc: int = 0) -> int:
    """Return the CRC-16 with polynomial 0x8005, not reflected, starting from *crc*."""
    for octet in octets:
        crc = ((crc << 8) ^ _TABLE[((crc >> 8) ^ octet) & 0xFF]) & 0xFFFF
    return crc


def stuff(body: bytes) -> bytes:
    """Insert ``FD`` after each ``FF FF FD``, so that *body* holds no header."""
    return body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")


def unstuff(body: bytes) -> bytes:
    """Undo :func:`stuff`."""
    return body.replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")


def encode(packet: Packet) -> bytes:
    """Return the bytes of *packet*, stuffed and with its CRC."""
    body = stuff(bytes([packet.instruction]) + packet.parameters)
    head = HEADER + bytes([packet.id]) + (len(body) + 2).to_bytes(2, "little") + body
    return head + crc16(head).to_bytes(2, "little")


def status(servo: int, error: int, content: bytes = b"") -> bytes:
    """Return the bytes of a status packet."""
    return encode(Packet(servo, Instruction.STATUS, bytes([error]) + content))


def fast_part(blocks: Sequence[tuple[int, int, bytes]], place: int, heard: bytes) -> bytes:
    """Return the part that a servo sends of the one packet that answers a fast read.

    It ends with a CRC over all bytes of the packet before it, earlier CRCs included, and nothing is
    stuffed.

    Args:
        blocks: ``(error, id, content)`` of each servo, in the order asked.
        place: that of the servo in this order.
        heard: the parts of the servos before it, as they were on the line.
    """
    error, servo, content = blocks[place]
    part = bytes([error, servo]) + content
    if place == 0:
        length = 1 + sum(len(content) + 4 for _, _, content in blocks)
        body = length.to_bytes(2, "little") + bytes([Instruction.STATUS])
        part = HEADER + bytes([BROADCAST]) + body + part
    return part + crc16(heard + part).to_bytes(2, "little")


def group_blocks(packet: Packet) -> list[tuple[int, int, bytes]]:
    """Return ``(id, address, content)`` of each servo that a sync or bulk instruction is for.

    The content of a read has as many bytes as are asked for.  A bulk read that names a servo twice
    is void.
    """
    is_sync, is_read = packet.instruction in SYNC, packet.instruction in READS
    blocks: list[tuple[int, int, bytes]] = []
    head, rest = b"", packet.parameters
    if is_sync:
        head, rest = rest[:4], rest[4:]
    while rest:
        servo, rest = rest[0], rest[1:]
        if not is_sync:
            head, rest = rest[:4], rest[4:]
        if len(head) < 4:
            break
        address, count = struct.unpack("<HH", head)
        if is_read:
            content = bytes(count)
        else:
            content, rest = rest[:count], rest[count:]
        if len(content) == count:
            blocks.append((servo, address, content))
    is_void = is_read and not is_sync and len({block[0] for block in blocks}) < len(blocks)
    return [] if is_void else blocks


class Parser:
    """Find packets in a stream of bytes.

    A pause between two bytes of one packet longer than *gap_ns* drops what came before it, as a
    servo does.
    """

    def __init__(self, gap_ns: int = 1_500_000) -> None:
        self._gap_ns = gap_ns
        self._last_ns = 0
        self._buffer = bytearray()

    def feed(self, octets: bytes, now_ns: int) -> list[tuple[Packet | Damaged, int]]:
        """Receive *octets* at *now_ns* and return the packets that they complete.

        Returns:
            Each packet, and how many of *octets* had arrived when it was complete.
        """
        if self._buffer and now_ns - self._last_ns > self._gap_ns:
            self._buffer.clear()
        self._last_ns = now_ns
        self._buffer += octets
        found: list[tuple[Packet | Damaged, int]] = []
        while (packet := self._next()) is not None:
            found.append((packet, max(0, len(octets) - len(self._buffer))))
        return found

    def _next(self) -> Packet | Damaged | None:
        buffer = self._buffer
        while True:
            start = buffer.find(HEADER)
            if start < 0:
                # A header may be arriving: keep all bytes that may be its beginning.
                del buffer[: max(0, len(buffer) - len(HEADER) + 1)]
                return None
            del buffer[:start]
            if len(buffer) < SHORTEST:
                return None
            length = int.from_bytes(buffer[5:7], "little")
            if 3 <= length <= MAX_LENGTH:
                break
            del buffer[: len(HEADER)]
        total = length + 7
        if len(buffer) < total:
            return None
        raw = bytes(buffer[:total])
        if crc16(raw[:-2]) != int.from_bytes(raw[-2:], "little"):
            # Only past the header: the length itself may be damaged.
            del buffer[: len(HEADER)]
            return Damaged(raw[4], raw[7])
        del buffer[:total]
        body = unstuff(raw[7:-2])
        return Packet(raw[4], body[0], body[1:])
