"""An independent reader of a Dynamixel bus, which shares no code with either end.

Protocol 2.0 from the vendor's e-Manual alone: neither the emulated bus nor the client library has
part in it.
"""

import contextlib
import os
import select
import termios
import threading
import time
import tty
from dataclasses import dataclass

HEADER = b"\xff\xff\xfd\x00"
TORQUE, GOAL = 64, 116
WRITE, SYNC_WRITE, BULK_WRITE = 0x03, 0x83, 0x93


def crc16(content):
    """Return the check sum: CRC-16, polynomial 0x8005, from 0, most significant bit first."""
    found = 0
    for octet in content:
        found ^= octet << 8
        for _ in range(8):
            found = ((found << 1) ^ (0x8005 if found & 0x8000 else 0)) & 0xFFFF
    return found


@dataclass(frozen=True)
class Written:
    """A register that was written: *at* in s of whoever read it, *value* with its sign."""

    at: float
    servo: int
    address: int
    value: int


class WireReader:
    """Takes the bytes that go to the servos, and keeps the goals and torques written.

    Attributes:
        written: in the order in which they went over the wire.
        damaged: packets whose check sum does not agree.
    """

    def __init__(self):
        self.written = []
        self.damaged = 0
        self._left = b""

    def take(self, content, at):
        """Read *content*, which passed at *at* s."""
        self._left += content
        while (start := self._left.find(HEADER)) >= 0:
            self._left = self._left[start:]
            if len(self._left) < 7:
                return
            size = 7 + int.from_bytes(self._left[5:7], "little")
            if len(self._left) < size:
                return
            packet, self._left = self._left[:size], self._left[size:]
            if crc16(packet[:-2]) != int.from_bytes(packet[-2:], "little"):
                self.damaged += 1
                continue
            # The header never occurs in what follows it: FD is said twice there.
            self._read(
                packet[4], packet[7], packet[8:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd"), at
            )

    def _read(self, servo, instruction, content, at):
        if instruction == WRITE:
            self._keep(servo, int.from_bytes(content[:2], "little"), content[2:], at)
        elif instruction == SYNC_WRITE:
            address, size = (
                int.from_bytes(content[:2], "little"),
                int.from_bytes(content[2:4], "little"),
            )
            rows = content[4:]
            for k in range(0, len(rows), size + 1):
                self._keep(rows[k], address, rows[k + 1 : k + 1 + size], at)
        elif instruction == BULK_WRITE:
            while content:
                address, size = (
                    int.from_bytes(content[1:3], "little"),
                    int.from_bytes(content[3:5], "little"),
                )
                self._keep(content[0], address, content[5 : 5 + size], at)
                content = content[5 + size :]

    def _keep(self, servo, address, content, at):
        for register, size in ((TORQUE, 1), (GOAL, 4)):
            if address <= register and register + size <= address + len(content):
                raw = content[register - address :][:size]
                self.written.append(
                    Written(at, servo, register, int.from_bytes(raw, "little", signed=size > 1))
                )

    def goals(self, servo, since=0):
        """Return the goals of *servo* from the *since*-th write on, ticks."""
        return [
            one.value for one in self.written[since:] if (one.servo, one.address) == (servo, GOAL)
        ]


class PtyTee:
    """A terminal between a client and the one at *behind*, read on its way to there.

    Attributes:
        link: where the client is to look.
        reader: what it wrote, read as it passes.
    """

    def __init__(self, link, behind):
        self.link, self.reader = link, WireReader()
        self._master, self._slave = os.openpty()
        self._behind = os.open(behind, os.O_RDWR | os.O_NOCTTY)
        for one in (self._master, self._slave, self._behind):
            tty.setraw(one)
        # Servos that are set to another speed than the one who talks to them are silent.
        speed = termios.tcgetattr(self._behind)
        speed[4] = speed[5] = termios.B1000000
        termios.tcsetattr(self._behind, termios.TCSANOW, speed)
        link.symlink_to(os.ttyname(self._slave))
        self._is_ending = False
        self._thread = threading.Thread(target=self._carry)
        self._thread.start()

    def _carry(self):
        ways = {self._master: self._behind, self._behind: self._master}
        while not self._is_ending:
            for one in select.select(list(ways), [], [], 0.1)[0]:
                with contextlib.suppress(OSError):
                    content = os.read(one, 4096)
                    if one == self._master:
                        self.reader.take(content, time.monotonic())
                    os.write(ways[one], content)

    def end(self):
        """End it and take the link away."""
        self._is_ending = True
        self._thread.join()
        self.link.unlink()
        for one in (self._master, self._slave, self._behind):
            os.close(one)
