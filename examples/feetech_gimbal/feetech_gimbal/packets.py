"""Packets of Feetech's STS servos, as bytes; no port is opened here.

A packet is ``FF FF``, the servo's id, the number of bytes that follow, an instruction (in answers
error bits), parameters, and the inverted sum of all after ``FF FF``; numbers are little endian.
"""

from typing import NamedTuple

PING, READ, WRITE, SYNC_READ, SYNC_WRITE = 0x01, 0x02, 0x03, 0x82, 0x83
ALL = 0xFE
TORQUE, GOAL, PRESENT = 40, 42, 56
"""Registers; from PRESENT on: position, speed and load (2 bytes each), voltage, temperature."""
PRESENT_BYTES = 8
ERRORS = ("voltage", "angle sensor", "overheating", "overcurrent", "angle", "overload")

_HEADER = b"\xff\xff"


class Status(NamedTuple):
    """What a servo answers."""

    id: int
    error: int
    content: bytes

    def problem(self) -> str:
        """Return the names of its error bits."""
        return ", ".join(name for bit, name in enumerate(ERRORS) if self.error >> bit & 1)


def packet(servo: int, instruction: int, *parameters: int) -> bytes:
    """Return the bytes of an instruction."""
    body = bytes([servo, len(parameters) + 2, instruction, *parameters])
    return _HEADER + body + bytes([~sum(body) & 0xFF])


def goals(ticks: dict[int, int]) -> bytes:
    """Return the instruction that sends every servo to its position; none answers."""
    each = (bytes([servo, goal & 0xFF, goal >> 8]) for servo, goal in ticks.items())
    return packet(ALL, SYNC_WRITE, GOAL, 2, *b"".join(each))


def value(register: bytes) -> int:
    """Return what a register of two bytes holds; its highest bit is a sign."""
    number = int.from_bytes(register, "little")
    return -(number & 0x7FFF) if number & 0x8000 else number


class Answers:
    """Finds whole answers in what has arrived, and leaves out what is damaged."""

    _arrived = b""

    def take(self, arrived: bytes) -> list[Status]:
        """Return the answers that are complete with these bytes."""
        found = []
        self._arrived += arrived
        while (begin := self._arrived.find(_HEADER)) >= 0 and len(self._arrived) > begin + 3:
            end = begin + 4 + self._arrived[begin + 3]
            body = self._arrived[begin + 2 : end]
            if len(self._arrived) < end:
                break
            is_sound = len(body) >= 4 and sum(body) & 0xFF == 0xFF
            if is_sound:
                found.append(Status(body[0], body[2], body[3:-1]))
            self._arrived = self._arrived[end if is_sound else begin + 1 :]
        return found
