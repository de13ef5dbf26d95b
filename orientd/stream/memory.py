"""The shared memory between the daemon and one servo process: a sealed file with no name.

A file that never had a name cannot be left behind: whichever way the two processes end, the kernel
frees it.  The daemon creates it and hands the servo its descriptor.  Its length is sealed: a
program of the same user that opens it through ``/proc`` could else cut it short, and whoever
touches a page that is gone is killed.
"""

from __future__ import annotations

import errno
import json
import mmap
import os
import weakref
from collections.abc import Mapping, Sequence
from struct import Struct
from typing import Any

from orientd.driver import PartHealth
from orientd.stream.records import (
    COMMAND_RECORD,
    CYCLE_RECORD,
    HEALTH_RECORD,
    HEALTH_TEXT_BYTES,
    NOTE_RECORD,
    PATH_RECORD,
    STOP_RECORD,
    TARGET_RECORD,
    TUNING_RECORD,
    TUNING_TEXT_BYTES,
)
from orientd.stream.ring import RecordRing

PAGE = 4096
COMMANDS = 16
NOTES = 64
TARGETS = 4096
TUNINGS = 4
HEALTHS = 4
STOPS = 64
DIRECTORY = "/dev/shm"

LONGEST_READ_WORD, LONGEST_WRITE_WORD = 1, 2
"""Words of the pulse: how long the driver's longest read and write took so far, ns."""

GIVEN_UP_WORD = 1
"""Word of the ring of commands: one more than the index of the newest whose sender has given up
waiting for an answer.  Only stops are still carried out then."""


class SharedMemory:
    """The eight rings between daemon and servo, and the heartbeat.

    ========  ===============  ==========================================================
    ring      written by       holds
    ========  ===============  ==========================================================
    path      daemon           the motion, on a uniform grid of path time
    commands  daemon           enable, start, stop, ...
    cycles    servo            every cycle: setpoint, feedback, state, timing
    notes     servo            answers to commands, faults, in words
    targets   daemon           what to follow, as it arrives
    tunings   daemon           a driver's options for the motions to come, as JSON
    health    servo            how the device's parts are, as JSON, once a second
    stops     servo            the stops that it took from its own socket
    ========  ===============  ==========================================================

    Attributes:
        descriptor: the file; pass it to the servo process.
        pulse: its first word is when the daemon last said that it is alive, monotonic clock, ns;
            the next ones are about the driver's calls, see :data:`LONGEST_READ_WORD`.
    """

    def __init__(
        self,
        descriptor: int,
        path_capacity: int,
        cycle_capacity: int,
        *,
        is_populated: bool = True,
    ) -> None:
        """Map an existing file; use :meth:`create` to make one.

        Args:
            descriptor: the file.
            path_capacity: path records the ring can hold.
            cycle_capacity: cycles the daemon may fall behind.
            is_populated: whether every page is mapped at once.  The servo would else meet a page
                fault every few cycles; the daemon may, and needs less memory.
        """
        self.descriptor = descriptor
        # Memory that nobody refers to any more is unmapped and closed, too.
        self._close = weakref.finalize(self, os.close, descriptor)
        rings = _rings(path_capacity, cycle_capacity)
        flags = mmap.MAP_SHARED | (mmap.MAP_POPULATE if is_populated else 0)
        self._map = mmap.mmap(descriptor, PAGE + sum(size for *_, size in rings), flags)
        self._view = memoryview(self._map)
        self.pulse = self._view[:PAGE].cast("Q")
        self._rings: list[RecordRing] = []
        offset = PAGE
        for layout, count, size in rings:
            self._rings.append(RecordRing(self._view[offset : offset + size], layout, count))
            offset += size
        self.path, self.commands, self.cycles, self.notes, *others = self._rings
        self.targets, self.tunings, self.health, self.stops = others

    @classmethod
    def create(cls, path_capacity: int, cycle_capacity: int) -> SharedMemory:
        """Make the file and map it.

        Args:
            path_capacity: path records the ring can hold.
            cycle_capacity: cycles the daemon may fall behind.

        Raises:
            OSError: there is no room for it, or too many files are open.
        """
        import fcntl  # where there is none, curves and plans are to be had all the same

        seals = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
        size = PAGE + sum(size for *_, size in _rings(path_capacity, cycle_capacity))
        descriptor = os.memfd_create("orientd-servo", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        try:
            # This is not in there; but what the machine sets aside for shared memory bounds it too.
            room = os.statvfs(DIRECTORY)
            if size > room.f_blocks * room.f_frsize:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            # All of it now: a page that is not to be had later kills whoever touches it.
            os.posix_fallocate(descriptor, 0, size)
            fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, seals)
        except OSError as error:
            os.close(descriptor)
            raise OSError(
                error.errno, f"{error.strerror}, {size / 1e6:.1f} MB are needed", DIRECTORY
            ) from error
        return cls(descriptor, path_capacity, cycle_capacity, is_populated=False)

    def beat(self, now_ns: int) -> None:
        """Say that the daemon is alive."""
        self.pulse[0] = now_ns

    def close(self) -> None:
        """Unmap and close; the file is gone when both processes have done so."""
        for ring in self._rings:
            ring.release()
        self.pulse.release()
        self._view.release()
        self._map.close()
        self._close()


def _rings(path_capacity: int, cycle_capacity: int) -> list[tuple[Struct, int, int]]:
    """Return layout, records and bytes, in whole pages, of each ring."""
    layouts = (
        (PATH_RECORD, path_capacity),
        (COMMAND_RECORD, COMMANDS),
        (CYCLE_RECORD, cycle_capacity),
        (NOTE_RECORD, NOTES),
        (TARGET_RECORD, TARGETS),
        (TUNING_RECORD, TUNINGS),
        (HEALTH_RECORD, HEALTHS),
        (STOP_RECORD, STOPS),
    )
    needed = ((layout, count, RecordRing.bytes_needed(layout, count)) for layout, count in layouts)
    return [(layout, count, (size + PAGE - 1) // PAGE * PAGE) for layout, count, size in needed]


def tuning_text(options: Mapping[str, Any]) -> bytes:
    """Return *options* as they cross to the servo.

    Raises:
        ValueError: they are too long, or more than JSON can say.
    """
    try:
        text = json.dumps(dict(options), allow_nan=False).encode()
    except TypeError as error:
        raise ValueError(str(error)) from error
    if len(text) > TUNING_TEXT_BYTES:
        raise ValueError(f"at most {TUNING_TEXT_BYTES} bytes of JSON are allowed, got {len(text)}")
    return text


def publish_health(ring: RecordRing, parts: Sequence[PartHealth]) -> None:
    """Write how *parts* are, without those for which there is no room."""
    kept = list(parts)
    while len(text := json.dumps(kept).encode()) > HEALTH_TEXT_BYTES:
        kept.pop()
    ring.publish(len(text), text)


def newest_health(ring: RecordRing) -> tuple[PartHealth, ...]:
    """Return how the parts were last said to be; empty before that."""
    fields = ring.read(ring.head - 1) if ring.head else None
    if fields is None:
        return ()
    _, length, text = fields
    return tuple(PartHealth(*part) for part in json.loads(text[:length]))
