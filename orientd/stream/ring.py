"""A ring of checked records in shared memory: one writer, any number of readers, no locks.

A slot holds a record, whose first field is its index, and the CRC-32 of its bytes.  The writer
fills the slot, then advances ``head``.  A reader accepts a record only if the slot still holds the
requested index and the checksum agrees.  A torn or overwritten slot reads as ``None``.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any
from zlib import crc32

HEADER_BYTES = 128
HEAD = 0
"""Word of every ring: the index of the next record."""

_CHECK = struct.Struct("@I")
_check_of = _CHECK.unpack_from
_index_of = struct.Struct("@Q").unpack_from


class RecordRing:
    """Records of one layout in a block of shared memory.

    Args:
        view: writable block of at least :meth:`bytes_needed` bytes, aligned to 8.
        layout: native struct layout whose first field is the index, ``Q``.
        capacity: number of slots.

    Attributes:
        words: the head, and fifteen more that the two sides may use; each is written atomically.
        next: the writer's own copy of the head, in case the shared one is damaged.
    """

    def __init__(self, view: memoryview, layout: struct.Struct, capacity: int) -> None:
        self.layout = layout
        self.capacity = capacity
        self._stride = self.stride(layout)
        self.words = view[:HEADER_BYTES].cast("Q")
        self._slots = view[HEADER_BYTES : HEADER_BYTES + capacity * self._stride]
        self._size = layout.size
        self._end = layout.size + _CHECK.size
        self.next = self.words[HEAD]

    @staticmethod
    def stride(layout: struct.Struct) -> int:
        """Return the size of a slot: record and checksum, a multiple of 8 bytes."""
        return (layout.size + _CHECK.size + 7) // 8 * 8

    @classmethod
    def bytes_needed(cls, layout: struct.Struct, capacity: int) -> int:
        """Return the bytes that the ring needs."""
        return HEADER_BYTES + cls.stride(layout) * capacity

    @property
    def head(self) -> int:
        """Index of the next record, which is the number of records published so far."""
        return self.words[HEAD]

    def put(self, records: Sequence[bytes], index: int) -> None:
        """Fill the slots from *index* on, at most all of them, without publishing them."""
        rest = bytes(self._stride - self._end)
        slots = b"".join([record + _CHECK.pack(crc32(record)) + rest for record in records])
        begin = index % self.capacity * self._stride
        whole = slots[: len(self._slots) - begin]
        self._slots[begin : begin + len(whole)] = whole
        self._slots[: len(slots) - len(whole)] = slots[len(whole) :]

    def publish(self, *fields: Any) -> None:  # noqa: ANN401 - any types of the layout
        """Write the next record; *fields* are those of the layout after the index."""
        self.append(self.layout.pack(self.next, *fields))

    def append(self, record: bytes) -> None:
        """Write the next record, which already holds its index, the head."""
        index = self.next
        offset = index % self.capacity * self._stride
        self._slots[offset : offset + self._end] = record + _CHECK.pack(crc32(record))
        self.words[HEAD] = self.next = index + 1

    def advance(self, head: int) -> None:
        """Publish all records below *head*."""
        self.words[HEAD] = self.next = head

    def read_bytes(self, index: int) -> bytes | None:
        """Return the bytes of record *index*, or ``None`` if it is not (or no longer) there."""
        offset = index % self.capacity * self._stride
        slot = self._slots[offset : offset + self._end].tobytes()
        record = slot[: self._size]
        if _check_of(slot, self._size)[0] != crc32(record) or _index_of(record)[0] != index:
            return None
        return record

    def records(self, first: int, end: int) -> list[bytes]:
        """Return the records from *first* to before *end* that are there, in order."""
        indices = range(self.oldest(first), min(end, self.words[HEAD]))
        return [record for record in map(self.read_bytes, indices) if record is not None]

    def oldest(self, index: int) -> int:
        """Return *index*, or the index of the first later record that is not overwritten."""
        return max(index, self.words[HEAD] - self.capacity)

    def slots(self, index: int, count: int) -> list[memoryview]:
        """Return the slots of *count* records from *index* on, unchecked, in one or two pieces.

        Pass each slot to :meth:`checked` before you use its record.
        """
        begin = index % self.capacity
        whole = min(count, self.capacity - begin)
        pieces = ((begin, whole), (0, count - whole))
        return [self._slots[a * self._stride : (a + n) * self._stride] for a, n in pieces if n]

    @staticmethod
    def checked(slot: bytes | memoryview, layout: struct.Struct) -> bytes | None:
        """Return the record in a copied slot; ``None`` if it is not whole."""
        record = bytes(slot[: layout.size])
        is_whole = _CHECK.unpack_from(slot, layout.size)[0] == crc32(record)
        return record if is_whole else None

    def read(self, index: int) -> tuple[Any, ...] | None:
        """Return the fields of record *index*, or ``None`` if it is not (or no longer) there."""
        record = self.read_bytes(index)
        return None if record is None else self.layout.unpack(record)

    def release(self) -> None:
        """Release the shared memory, so that it can be unmapped."""
        self.words.release()
        self._slots.release()
