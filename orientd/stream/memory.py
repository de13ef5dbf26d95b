"""The shared memory between the daemon and one servo process: a sealed file with no name.

A file without a name leaves nothing behind: however the two processes end, the kernel frees it. The
daemon creates it and hands the servo its descriptor.  The length is sealed.  Otherwise a program of
the same user could open it through ``/proc`` and cut it short, and the kernel kills a process that
touches a missing page.
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
    CHUNK_RECORD,
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
CHUNKS = 16
TUNINGS = 4
HEALTHS = 4
STOPS = 64
DIRECTORY = "/dev/shm"

LONGEST_READ_WORD, LONGEST_WRITE_WORD = 1, 2
"""Words of the pulse: the longest read and write of the driver so far, ns."""

GIVEN_UP_WORD = 1
"""Word of the command ring: one more than the index of the newest command whose sender timed out,
other than a stop.  Of the commands below it, the servo still carries out only stops.
"""


class SharedMemory:
    """The nine rings between daemon and servo, and the heartbeat.

    ========  ===============  ==========================================================
    ring      written by       holds
    ========  ===============  ==========================================================
    path      daemon           the motion, on a uniform grid of path time
    commands  daemon           enable, start, stop, ...
    cycles    servo            each cycle: setpoint, feedback, state, timing
    notes     servo            answers to commands, faults, messages
    targets   daemon           targets of tracking, as they arrive
    tunings   daemon           a driver's options for the motions to come, as JSON
    health    servo            condition of the device's parts, as JSON, once a second
    stops     servo            stops from the servo's own socket
    ========  ===============  ==========================================================

    Attributes:
        descriptor: the file; pass it to the servo process.
        pulse: its first word is the time of the daemon's last heartbeat, monotonic clock, ns.  The
            next ones are about the driver's calls, see :data:`LONGEST_READ_WORD`.
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
            is_populated: whether to map every page at once.  The servo does, to avoid a page fault
                every few cycles.  The daemon does not, to save memory.
        """
        self.descriptor = descriptor
        # Python also unmaps and closes memory without references.
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
        self.targets, self.chunks, self.tunings, self.health, self.stops = others

    @classmethod
    def create(cls, path_capacity: int, cycle_capacity: int) -> SharedMemory:
        """Make the file and map it.

        Args:
            path_capacity: path records the ring can hold.
            cycle_capacity: cycles the daemon may fall behind.

        Raises:
            OSError: memory is short, or too many files are open.
        """
        import fcntl  # curves and plans work on systems without it

        seals = fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_SEAL
        size = PAGE + sum(size for *_, size in _rings(path_capacity, cycle_capacity))
        descriptor = os.memfd_create("orientd-servo", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        try:
            # The file is not in /dev/shm, but the size of that bounds shared memory as well.
            room = os.statvfs(DIRECTORY)
            if size > room.f_blocks * room.f_frsize:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            # Allocate all pages now: if one is missing later, the kernel kills the process that
            # touches it.
            os.posix_fallocate(descriptor, 0, size)
            fcntl.fcntl(descriptor, fcntl.F_ADD_SEALS, seals)
        except OSError as error:
            os.close(descriptor)
            raise OSError(
                error.errno, f"{error.strerror}, {size / 1e6:.1f} MB are needed", DIRECTORY
            ) from error
        return cls(descriptor, path_capacity, cycle_capacity, is_populated=False)

    def beat(self, now_ns: int) -> None:
        """Record that the daemon is alive."""
        self.pulse[0] = now_ns

    def close(self) -> None:
        """Unmap and close; the kernel frees the file once both processes have done so."""
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
        (CHUNK_RECORD, CHUNKS),
        (TUNING_RECORD, TUNINGS),
        (HEALTH_RECORD, HEALTHS),
        (STOP_RECORD, STOPS),
    )
    needed = ((layout, count, RecordRing.bytes_needed(layout, count)) for layout, count in layouts)
    return [(layout, count, (size + PAGE - 1) // PAGE * PAGE) for layout, count, size in needed]


def tuning_text(options: Mapping[str, Any]) -> bytes:
    """Return *options* as the JSON that the servo receives.

    Raises:
        ValueError: the text is too long, or JSON cannot hold a value.
    """
    try:
        text = json.dumps(dict(options), allow_nan=False).encode()
    except TypeError as error:
        raise ValueError(str(error)) from error
    if len(text) > TUNING_TEXT_BYTES:
        raise ValueError(f"at most {TUNING_TEXT_BYTES} bytes of JSON are allowed, got {len(text)}")
    return text


def publish_health(ring: RecordRing, parts: Sequence[PartHealth]) -> None:
    """Write the condition of *parts*, leaving out those that do not fit."""
    kept = list(parts)
    while len(text := json.dumps(kept).encode()) > HEALTH_TEXT_BYTES:
        kept.pop()
    ring.publish(len(text), text)


def newest_health(ring: RecordRing) -> tuple[PartHealth, ...]:
    """Return the last reported condition of the parts; empty before the first report."""
    fields = ring.read(ring.head - 1) if ring.head else None
    if fields is None:
        return ()
    _, length, text = fields
    return tuple(PartHealth(*part) for part in json.loads(text[:length]))
