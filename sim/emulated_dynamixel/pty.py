"""The bus behind a pseudo-terminal, as a real serial client opens it.

The link is a symbolic link to the terminal.  A pseudo-terminal has no line speed, but the client's
setting can be read from it.  Servos set to another speed stay silent, as on a wire.

Real servos keep running while the computer is busy.  So if the system did not run this process for
a while, the bus receives what has arrived meanwhile at even intervals of that time, not at once.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import select
import struct
import time
import tty
from collections.abc import Callable
from pathlib import Path

from emulated_dynamixel.bus import Bus

NAP_S = 0.01
"""Longest wait for work."""

_OVERSLEPT_NS = 20_000_000
"""If so much time passes between two looks at the terminal, the system did not run the process."""
_CHUNK = 4096
_PACKETS = re.compile(rb"(?=\xff\xff\xfd\x00)")
# struct termios2 of Linux: unlike termios it has any speed as a number, which clients in other
# languages set.
_TCGETS2 = 0x802C542A
_TERMIOS2 = struct.Struct("4I20B2I")


def line_speed(descriptor: int) -> int:
    """Return the speed in baud that a client has set on a terminal."""
    raw = fcntl.ioctl(descriptor, _TCGETS2, bytes(_TERMIOS2.size))
    return int(_TERMIOS2.unpack(raw)[-1])


class PtyServer:
    """Serve a bus on a pseudo-terminal, in the thread that calls :meth:`step`.

    Attributes:
        bus: the bus.
        link: link to the terminal for clients.
    """

    def __init__(
        self, bus: Bus, link: Path, *, now_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        """Serve *bus* at *link*, on the clock *now_ns*."""
        self.bus = bus
        self.link = link
        self._master = self._slave = -1
        self._now_ns = now_ns
        self._looked_ns = now_ns()

    @property
    def is_plugged(self) -> bool:
        """Whether the terminal exists."""
        return self._master >= 0

    def plug(self) -> None:
        """Create the terminal and the link to it.

        Raises:
            FileExistsError: the link's path exists and is not a symbolic link.
        """
        if self.link.exists() and not self.link.is_symlink():
            raise FileExistsError(f"{self.link} exists and is not a symbolic link")
        self._master, self._slave = os.openpty()
        # Both ends raw before a client connects: a new terminal echoes and edits lines.  The slave
        # stays open here, or the master would report an error whenever there is no client.
        tty.setraw(self._master)
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        target = os.ttyname(self._slave)
        beside = self.link.with_name(f".{self.link.name}.{os.getpid()}")
        beside.unlink(missing_ok=True)
        beside.symlink_to(target)
        beside.replace(self.link)

    def unplug(self) -> None:
        """Close the terminal and remove the link."""
        if not self.is_plugged:
            return
        target = os.ttyname(self._slave)
        os.close(self._slave)
        os.close(self._master)
        self._master = self._slave = -1
        self.bus.wire.discard()
        if self.link.is_symlink() and str(self.link.readlink()) == target:
            self.link.unlink()

    def step(self, *others: int) -> list[int]:
        """Wait for work, at most :data:`NAP_S`, and do it.

        Args:
            others: descriptors of the caller to wait for as well.

        Returns:
            The readable ones of *others*.
        """
        due_ns = self.bus.wire.due_ns()
        wait_s = NAP_S
        if due_ns is not None:
            wait_s = min(wait_s, max(0.0, (due_ns - self._now_ns()) * 1e-9))
        watched = [*others, self._master] if self.is_plugged else list(others)
        ready, _, _ = select.select(watched, [], [], wait_s)
        octets = b""
        if self._master in ready:
            with contextlib.suppress(BlockingIOError):
                octets = os.read(self._master, _CHUNK)
        self._receive(octets, self._now_ns())
        if self.is_plugged and (octets := self.bus.wire.take(self._now_ns())):
            # A client that never reads fills the terminal; a real adapter would drop bytes too.
            with contextlib.suppress(BlockingIOError):
                os.write(self._master, octets)
        if not ready:
            self.bus.advance(self._now_ns())
        return [descriptor for descriptor in others if descriptor in ready]

    def _receive(self, octets: bytes, now_ns: int) -> None:
        """Pass on what the host has written since the last call."""
        slept_ns, self._looked_ns = now_ns - self._looked_ns, now_ns
        if slept_ns < _OVERSLEPT_NS:
            slept_ns = 0
        packets = [packet for packet in _PACKETS.split(octets) if packet]
        for place, packet in enumerate(packets, 1):
            written_ns = now_ns - slept_ns * (len(packets) - place) // len(packets)
            self.bus.receive(packet, written_ns, baud=line_speed(self._slave))
