"""The whole turns of every servo, kept in a file: a servo counts them only while it has power.

A record of the file holds a servo's position over all its turns and the part of it that the servo
itself has forgotten.  The count of a servo that has kept its power is accepted.  A restarted servo
must stand within 45 degrees of its last known position, because nothing else distinguishes the
turns.  Until it does, its record says that the count is lost: the servo keeps its power meanwhile.

The computer may lose its power together with the servos.  So a thread has the disk keep the file
whenever a servo has moved by half of that since it last did, and when the file is closed.  A servo
that stands still costs the disk nothing.
"""

from __future__ import annotations

import math
import os
import struct
import threading
import weakref
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from orientd.errors import DeviceFaultError
from orientd.files import sync_name
from orientd_dynamixel.options import GimbalOptions
from orientd_dynamixel.servo import Servo

_RECORD = struct.Struct("<qqq")
"""Id of the servo plus one, position over all turns and its forgotten part, ticks."""
_LOST = -(1 << 63)
"""Forgotten part of a servo that has restarted, until its turns are known again."""


class Turns:
    """The remembered positions of the servos.

    Attributes:
        path: of the file; ``None`` if nothing is kept beyond the process.
    """

    def __init__(self, options: GimbalOptions, servos: Sequence[Servo]) -> None:
        """Create it without reading the file."""
        self.path = _path(options)
        self._servos = servos
        self._records = [bytes(_RECORD.size)] * len(servos)
        self._kept = [math.inf] * len(servos)  # positions at the last sync, ticks
        self._file: _File | None = None

    def open(self) -> None:
        """Open the file, or create it.

        Raises:
            DeviceFaultError: it cannot be written.
        """
        if self.path is None:
            return
        try:
            self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            self._file = _File(descriptor)
            # A driver that is not closed leaves no thread behind.
            weakref.finalize(self, self._file.end).atexit = False
            size = _RECORD.size * len(self._records)
            kept = os.pread(descriptor, size, 0).ljust(size, b"\0")
            os.pwrite(descriptor, kept, 0)  # reserves its space on the disk
            os.fsync(descriptor)
            sync_name(self.path)
        except OSError as error:
            raise self._unwritten(error) from error
        self._records = [kept[at : at + _RECORD.size] for at in range(0, size, _RECORD.size)]
        self._kept = [math.inf] * len(self._records)

    def close(self) -> None:
        """Have the disk keep the file, and close it; never raises."""
        if self._file is not None:
            self._file.end()
            self._file.thread.join()
            self._file = None

    def note(self, place: int, position: int) -> None:
        """Record the reported position of the servo of the axis at *place*, ticks."""
        servo = self._servos[place]
        forgotten = servo.turns * servo.per_turn
        seen = position + forgotten
        record = _RECORD.pack(servo.options.id + 1, seen, forgotten)
        if record != self._records[place]:
            self._records[place] = record
            if self._file is not None:
                # Written to the kernel's memory in a few us, which survives any end of the process.
                with suppress(OSError):
                    os.pwrite(self._file.descriptor, record, place * _RECORD.size)
                if 2 * abs(seen - self._kept[place]) > servo.near:
                    self._kept[place] = seen
                    self._file.is_due.set()

    def is_lost(self, place: int) -> bool:
        """Return whether the servo of an axis has restarted and its turns are still unknown."""
        owner, _, forgotten = _RECORD.unpack(self._records[place])
        return bool(owner == self._servos[place].options.id + 1 and forgotten == _LOST)

    def lose(self, place: int) -> None:
        """Record that the servo of an axis has restarted, for every process to come.

        Raises:
            DeviceFaultError: that cannot be written.
        """
        owner, seen, _ = _RECORD.unpack(self._records[place])
        if owner != self._servos[place].options.id + 1:
            return
        self._records[place] = record = _RECORD.pack(owner, seen, _LOST)
        if self._file is not None:
            try:
                os.pwrite(self._file.descriptor, record, place * _RECORD.size)
                os.fsync(self._file.descriptor)
            except OSError as error:
                raise self._unwritten(error) from error

    def _unwritten(self, error: OSError) -> DeviceFaultError:
        return DeviceFaultError(
            f"turns cannot be remembered in {self.path}: {error.strerror}; name another file as "
            "turns_file"
        )

    def last(self, place: int) -> int | None:
        """Return the last known position of the servo of the axis at *place*, in its ticks.

        ``None`` if it was never read.
        """
        owner, seen, forgotten = _RECORD.unpack(self._records[place])
        return seen - forgotten if owner == self._servos[place].options.id + 1 else None

    def resolve(self, place: int, position: int, *, has_kept_power: bool) -> str:
        """Find the turns that the servo of an axis has forgotten, and record its position.

        Args:
            place: of the axis; sets its turns.
            position: reported position, ticks.
            has_kept_power: whether it still counts from the recorded position.

        Returns:
            Why the turns are unknown, or an empty string.
        """
        servo = self._servos[place]
        owner, seen, forgotten = _RECORD.unpack(self._records[place])
        servo.turns = 0  # never seen before: within half a turn of zero
        if owner == servo.options.id + 1:
            ahead = forgotten if has_kept_power else seen - position
            servo.turns = round(ahead / servo.per_turn)
            moved = position + servo.turns * servo.per_turn - seen
            if abs(moved) > servo.near and not has_kept_power:
                here, last = (math.degrees(servo.angle(p)) for p in (position, position - moved))
                forget = "start the daemon again" if self.path is None else f"delete {self.path}"
                return (
                    f"{servo} was without power and stands at {here:.1f} deg or whole turns from "
                    f"there, {last:.1f} deg were seen last; turn it by hand to within 45 deg of "
                    f"that, or to within half a turn of zero and {forget}, then reset"
                )
        self.note(place, position)
        return ""


class _File:
    """An open file, and a thread that has the disk keep it.

    Attributes:
        descriptor: of the file; the thread closes it.
        is_due: whether the disk is to keep what is written.
        thread: ends once the file is closed.
    """

    def __init__(self, descriptor: int) -> None:
        """Start the thread."""
        self.descriptor, self.is_due, self._is_ending = descriptor, threading.Event(), False
        self.thread = threading.Thread(target=self._sync, name="turns", daemon=True)
        self.thread.start()

    def end(self) -> None:
        """Have the thread sync once more, close the file and end."""
        self._is_ending = True
        self.is_due.set()

    def _sync(self) -> None:
        is_ending = False
        while not is_ending:
            self.is_due.wait()
            self.is_due.clear()
            is_ending = self._is_ending
            with suppress(OSError):
                os.fsync(self.descriptor)
        with suppress(OSError):
            os.close(self.descriptor)


def _path(options: GimbalOptions) -> Path | None:
    if options.turns_file is not None:
        return Path(options.turns_file) if options.turns_file else None
    home = os.environ.get("XDG_STATE_HOME") or Path("~/.local/state").expanduser()
    ids = "-".join(str(axis.id) for axis in options.axes)
    return Path(home, "orientd", f"turns{options.port.replace('/', '-')}-{ids}")
