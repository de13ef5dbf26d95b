"""Records of a motion in a file in memory: a planner writes them, the daemon reads what it needs.

None of it counts as memory of the daemon, however many motions wait for their turn.
"""

from __future__ import annotations

import os
import weakref
from dataclasses import dataclass

import numpy as np

from orientd.rotation import Floats

_DOUBLE = 8


class RecordFile:
    """A file that lives as long as this object and whoever else has its descriptor.

    Attributes:
        descriptor: of the file.
    """

    def __init__(self) -> None:
        self.descriptor = os.memfd_create("orientd-records", os.MFD_CLOEXEC)
        weakref.finalize(self, os.close, self.descriptor)


@dataclass(frozen=True, slots=True, eq=False)
class Chunk:
    """Successive records of a motion.

    Attributes:
        first: which record the first of them is.
        count: how many there are.
        columns: of each.
        file: that holds them.
    """

    first: int
    count: int
    columns: int
    file: RecordFile

    @property
    def end(self) -> int:
        """The record behind the last of them."""
        return self.first + self.count

    def read(self, first: int, count: int) -> Floats:
        """Return some of them, shape ``(count, columns)``."""
        rows = np.empty((count, self.columns))
        offset = _DOUBLE * self.columns * (first - self.first)
        if os.preadv(self.file.descriptor, [rows.data], offset) != rows.nbytes:
            raise ValueError(f"records {first} to {first + count} are not in the file")
        return rows


def write(descriptor: int, place: int, rows: Floats) -> None:
    """Put *rows* into a file, the first of them as row number *place* of it.

    Raises:
        MemoryError: there is no room for them.
    """
    offset = _DOUBLE * rows.shape[1] * place
    if os.pwrite(descriptor, np.ascontiguousarray(rows).data, offset) != rows.nbytes:
        raise MemoryError
