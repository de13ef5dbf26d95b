"""Serial lines in virtual time: emulated servos at paths, and what a driver opens there.

The driver, the vendor's SDK and the emulated servos run unchanged.  This replaces the terminal
between them: no kernel delays its bytes.
"""

from __future__ import annotations

import errno
import itertools
import os
import random
import sys
import time
from types import SimpleNamespace
from unittest import mock

import gimbal_bench
from reference.wire import WireReader

from emulated_dynamixel import Bus, servos
from emulated_dynamixel import __main__ as program
from emulated_dynamixel.console import carry_out
from orientd_dynamixel import bus as driver_bus

GLANCE_NS = 10_000
"""Time that a read takes that does not wait."""


class Line:
    """A bus of servos with an adapter, of the protocol that ``console.carry_out`` wants.

    Attributes:
        bus: the servos.
        is_plugged: whether the adapter is there.
        readers: take the bytes that go to the servos.
    """

    def __init__(self, scheduler, bus):
        self.bus, self.is_plugged, self.readers = bus, True, []
        self._scheduler, self._owner = scheduler, None

    def plug(self):
        self.is_plugged = True

    def unplug(self):
        self.is_plugged, self._owner = False, None
        self.bus.wire.discard()

    def lock(self, port):
        """Give the line to one port, as long as its process lives."""
        owner = self._owner
        if owner is not None and owner[0] is not port and self._scheduler.lives(owner[1]):
            raise OSError(errno.EAGAIN, "Could not exclusively lock port")
        self._owner = port, self._scheduler.current().group

    def release(self, port):
        if self._owner is not None and self._owner[0] is port:
            self._owner = None


class Port:
    """A port, as ``serial.Serial``."""

    def __init__(self, lines, path, baud):
        self._lines, self._line, self._baud = lines, lines.at(path), baud
        self.timeout, self._input = 0.0, b""
        self._number = lines.add(self)

    def fileno(self):
        return self._number

    def _check(self):
        if self._line is None or not self._line.is_plugged:
            raise OSError(errno.EIO, "the adapter is gone")
        self._input += self._line.bus.wire.take(time.monotonic_ns())

    exclusive = property(None, lambda self, _: self._line.lock(self))

    @property
    def in_waiting(self):
        self._check()
        return len(self._input)

    def reset_input_buffer(self):
        self._check()
        self._input = b""

    def read(self, length):
        """Return *length* bytes, or those that come before the timeout."""
        self._check()
        scheduler = self._lines.scheduler
        ends_ns = scheduler.now_ns + (round(self.timeout * 1e9) or GLANCE_NS)
        while len(self._input) < length and scheduler.now_ns < ends_ns:
            due_ns = self._line.bus.wire.due_ns()
            scheduler.wait(ends_ns if due_ns is None else min(ends_ns, due_ns))
            self._check()
        octets, self._input = self._input[:length], self._input[length:]
        return octets

    def write(self, octets):
        self._check()
        octets = bytes(octets)
        for reader in self._line.readers:
            reader.take(octets, time.monotonic())
        self._line.bus.receive(octets, time.monotonic_ns(), baud=self._baud)
        return len(octets)

    def close(self):
        if self._line is not None:
            self._line.release(self)
        self._line = None


class SerialLines:
    """The lines of a world, by the paths of their terminals.

    Attributes:
        scheduler: of the tasks that use them.
    """

    def __init__(self, scheduler):
        self.scheduler, self._lines, self._ports = scheduler, {}, {}
        self._numbers = itertools.count(1_000_000)

    def line(self, path):
        """Return the line at a path, whether or not its adapter is there."""
        return self._lines.get(str(path))

    def at(self, path):
        line = self.line(path)
        if line is None or not line.is_plugged:
            raise FileNotFoundError(errno.ENOENT, f"could not open port {path}")
        return line

    def add(self, port):
        number = next(self._numbers)
        self._ports[number] = port
        return number

    def write(self, number, octets):
        """Write to a port or, like ``os.write``, to a descriptor."""
        port = self._ports.get(number)
        return os.write(number, octets) if port is None else port.write(octets)

    def start_bus(self, path, *arguments):
        """Let the servos of ``orientd sim dynamixel`` answer at a path."""

        def run(_link, *, names, baud, line, seed, console):
            found = servos(names, baud=baud, now_ns=time.monotonic_ns())
            bus = Bus(found, line=line, rng=random.Random(seed))
            self._lines[str(path)] = Line(self.scheduler, bus)

        words = ["emulated-dynamixel", "--link", str(path), *map(str, arguments)]
        with mock.patch.object(program, "run", run), mock.patch.object(sys, "argv", words):
            program.main()
        return BusProcess(self, str(path))

    def tap(self, path, behind):
        """Return a reader of what is written at *path*, which leads to the line *behind*."""
        line = self._lines[str(path)] = self._lines[str(behind)]
        reader = WireReader()
        line.readers.append(reader)
        return SimpleNamespace(link=path, reader=reader, end=lambda: line.readers.remove(reader))

    def remove(self, path):
        self._lines.pop(path).unplug()


class BusProcess:
    """The servos at a path, in place of their process."""

    def __init__(self, lines, path):
        self._lines, self._path = lines, path

    def ask(self, command):
        return carry_out(command, self._lines.line(self._path), time.monotonic_ns())

    def end(self, _number):
        self._lines.remove(self._path)
        return 0


def of_serial_lines(lines):
    """Return what drivers and tests find in a world: owners, names and values to replace."""
    replaced = [
        (gimbal_bench, "TERMINALS", lines),
        (driver_bus, "os", SimpleNamespace(write=lines.write, strerror=os.strerror)),
    ]
    try:
        from dynamixel_sdk import port_handler
    except ImportError:
        return replaced

    def open_port(port, baudrate, **_):
        return Port(lines, port, baudrate)

    return [*replaced, (port_handler, "serial", SimpleNamespace(Serial=open_port, EIGHTBITS=8))]
