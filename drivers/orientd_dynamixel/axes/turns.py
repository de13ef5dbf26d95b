"""The whole turns of every servo, kept in a file: a servo counts them only while it has power.

A record of the file holds a servo's position over all its turns and the share of it that the servo
itself has forgotten.  A servo that has kept its power is recognised by what is in its volatile
memory, and is believed.  One that has started again must stand within 45 degrees of where it was
last seen: nothing else tells one turn from another.
"""

from __future__ import annotations

import math
import mmap
import os
import struct
from collections.abc import Sequence
from pathlib import Path

from orientd.errors import DeviceFaultError
from orientd_dynamixel.axis import CENTRE, NEAR, TICKS, Axis
from orientd_dynamixel.options import GimbalOptions

_RECORD = struct.Struct("<qqq")
"""Id of the servo plus one, position over all turns and what it has forgotten of it, ticks."""


class Turns:
    """What is remembered of the servos.

    Attributes:
        path: of the file; ``None`` where nothing is kept beyond the process.
    """

    def __init__(self, options: GimbalOptions, axes: Sequence[Axis]) -> None:
        """Look at nothing yet."""
        self.path = _path(options)
        self._axes = axes
        self._records: bytearray | mmap.mmap = bytearray(_RECORD.size * len(axes))
        self._is_open = self.path is None

    def open(self) -> None:
        """Open the file, or make it.

        Raises:
            DeviceFaultError: it cannot be written.
        """
        if self._is_open or self.path is None:
            return
        try:
            self.path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                # With room on the disk: a page without it would end the process as it is noted.
                os.posix_fallocate(descriptor, 0, len(self._records))
                # Mapped, so that it outlives the process whatever ends that, and a note takes 1 us.
                self._records = mmap.mmap(descriptor, len(self._records))
            finally:
                os.close(descriptor)
        except OSError as error:
            raise DeviceFaultError(
                f"turns cannot be remembered in {self.path}: {error.strerror}; name another file "
                "as turns_file"
            ) from error
        self._is_open = True

    def close(self) -> None:
        """Write the file out and let go of it; never raises."""
        if isinstance(self._records, mmap.mmap):
            records, self._records = self._records, bytearray(len(self._records))
            self._is_open = False
            try:
                records.flush()
            except OSError:
                return  # a full disk: the pages are kept until the machine ends
            finally:
                records.close()

    def note(self, place: int, position: int) -> None:
        """Note what the servo of the axis at *place* reports, ticks."""
        axis = self._axes[place]
        forgotten = axis.turns * TICKS
        _RECORD.pack_into(
            self._records, place * _RECORD.size, axis.options.id + 1, position + forgotten,
            forgotten,
        )  # fmt: skip

    def last(self, place: int) -> int | None:
        """Return where the servo of the axis at *place* was last seen, in ticks as it counts them.

        ``None`` where it never was.
        """
        servo, seen, forgotten = _RECORD.unpack_from(self._records, place * _RECORD.size)
        return seen - forgotten if servo == self._axes[place].options.id + 1 else None

    def resolve(self, place: int, position: int, *, has_kept_power: bool) -> str:
        """Find the turns that the servo of an axis has forgotten, and note where it is.

        Args:
            place: of the axis; its turns are set.
            position: what the servo reports, ticks.
            has_kept_power: whether it still counts from where it was noted.

        Returns:
            Why they are not known, or nothing.
        """
        problem = self._find(place, position, has_kept_power=has_kept_power)
        if not problem:
            self.note(place, position)
        return problem

    def _find(self, place: int, position: int, *, has_kept_power: bool) -> str:
        axis = self._axes[place]
        servo, seen, forgotten = _RECORD.unpack_from(self._records, place * _RECORD.size)
        axis.turns = 0
        if servo != axis.options.id + 1:
            return ""  # never seen before: within half a turn of where it is zero
        if has_kept_power:
            axis.turns = forgotten // TICKS
            return ""
        nearest = round((seen - position) / TICKS)
        axis.turns = nearest
        if abs(position + nearest * TICKS - seen) <= NEAR:
            return ""
        options, here = axis.options, axis.angle(position)
        forget = "start the daemon again" if self.path is None else f"delete {self.path}"
        last = options.zero + axis.rate((seen - CENTRE) * 2 * math.pi / TICKS)
        return (
            f"servo {options.id} ({options.name}) was without power and stands at "
            f"{math.degrees(here):.1f} deg or whole turns from there, {math.degrees(last):.1f} deg "
            f"were seen last; turn it by hand to within 45 deg of that, or to within half a turn "
            f"of zero and {forget}, then reset"
        )


def _path(options: GimbalOptions) -> Path | None:
    if options.turns_file is not None:
        return Path(options.turns_file) if options.turns_file else None
    home = os.environ.get("XDG_STATE_HOME") or Path("~/.local/state").expanduser()
    ids = "-".join(str(axis.id) for axis in options.axes)
    return Path(home, "orientd", f"turns{options.port.replace('/', '-')}-{ids}")
