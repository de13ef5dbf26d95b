"""Feetech STS servos that are not there: python emulated_servos.py LINK.

They answer on a pseudo-terminal, and LINK leads to it.  They are written from the vendor's manual
and share no code with the driver, so that each finds the other's mistakes.
"""

import os
import select
import signal
import sys
import threading
import time
import tty
from pathlib import Path

MODEL_LIMIT, FASTEST = 4095, 3073  # steps, steps/s: 45 revolutions a minute
LAG = 0.01  # s
NO_DATA = b""


class Servo:
    """The registers of one servo, and the shaft behind them."""

    def __init__(self, number, position=2048):
        self.memory = bytearray(128)
        self.memory[5] = number
        self.memory[62], self.memory[63] = 121, 31
        self.position, self.speed, self.goal = float(position), 0.0, position
        self.when = time.monotonic()
        self.error = 0

    def advance(self):
        """Move until now: a first-order lag, no faster than the motor."""
        now = time.monotonic()
        while self.when < now:
            step = min(0.001, now - self.when)
            self.when += step
            wanted = (self.goal - self.position) / LAG if self.memory[40] else 0.0
            self.speed = max(-FASTEST, min(FASTEST, wanted))
            self.position += self.speed * step
        place, speed = round(self.position), round(abs(self.speed))
        self.memory[56:58] = place.to_bytes(2, "little")
        self.memory[58:60] = (speed | (0x8000 if self.speed < 0 else 0)).to_bytes(2, "little")

    def write(self, address, content):
        """Write registers; a goal beyond the range is the nearest within."""
        self.advance()
        self.memory[address : address + len(content)] = content
        goal = int.from_bytes(self.memory[42:44], "little")
        if address <= 42 < address + len(content):
            self.goal = min(goal, MODEL_LIMIT)
        if address == 40 and not content[0]:
            self.goal = round(self.position)

    def read(self, address, count):
        """Return registers as they are now."""
        self.advance()
        return bytes(self.memory[address : address + count])


class EmulatedServos:
    """A bus with servos 1, 2 and 3, plugged in."""

    def __init__(self, link):
        self.link, self.servos = Path(link), {number: Servo(number) for number in (1, 2, 3)}
        self.plug()

    def plug(self):
        """Make the pseudo-terminal, lead the link to it, and answer until it is unplugged."""
        self.line, other = os.openpty()
        tty.setraw(other)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(other))
        self.is_plugged = True
        self.thread = threading.Thread(target=self.answer_all, args=(other,), daemon=True)
        self.thread.start()

    def unplug(self):
        """Pull the adapter out."""
        self.is_plugged = False
        self.thread.join()
        self.link.unlink()

    def answer_all(self, other):
        """Answer whatever arrives; *other* is the far end, which is kept open for clients."""
        pending = NO_DATA
        while self.is_plugged:
            readable, _, _ = select.select([self.line], [], [], 0.02)
            pending = self.take(pending + os.read(self.line, 4096)) if readable else pending
        os.close(self.line)
        os.close(other)

    def take(self, arrived):
        """Carry out every whole packet; return what is left."""
        while len(arrived) >= 6:
            if arrived[:2] != b"\xff\xff":
                arrived = arrived[1:]
                continue
            number, length = arrived[2], arrived[3]
            if len(arrived) < 4 + length:
                break
            body, arrived = arrived[2 : 4 + length], arrived[4 + length :]
            total = sum(body[:-1])
            if body[-1] == 255 - total % 256:
                self.obey(number, body[2], body[3:-1])
        return arrived

    def obey(self, number, instruction, content):
        """Carry out one instruction; what is for all is not answered, but for a sync read."""
        if instruction == 0x83:
            address, count, *rest = content
            for at in range(0, len(rest), count + 1):
                if rest[at] in self.servos:
                    self.servos[rest[at]].write(address, bytes(rest[at + 1 : at + 1 + count]))
        elif instruction == 0x82:
            for one in filter(self.servos.get, content[2:]):
                self.answer(one, self.servos[one].read(content[0], content[1]))
        elif number in self.servos and instruction == 0x01:
            self.answer(number)
        elif number in self.servos and instruction == 0x02:
            self.answer(number, self.servos[number].read(content[0], content[1]))
        elif number in self.servos and instruction == 0x03:
            self.servos[number].write(content[0], content[1:])
            self.answer(number)

    def answer(self, number, content=NO_DATA):
        """Send a status packet."""
        packet = [number, 2 + len(content), self.servos[number].error, *content]
        os.write(self.line, bytes([255, 255, *packet, 255 - sum(packet) % 256]))


if __name__ == "__main__":
    servos = EmulatedServos(sys.argv[1])
    print("ready", flush=True)
    signal.sigwait([signal.SIGTERM, signal.SIGINT])
    servos.unplug()
