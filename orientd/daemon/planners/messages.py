"""Define the messages between the daemon and a planner process: request, answer, and rest.

A message is its length and a pickle; both ends are of one installation and one user.  The motion
follows its request as it is, because copies of a large one would keep the event loop busy.  Each
request carries the descriptor of a file in memory.  The planner writes the records of the motion to
it, and its current stage in words.  The daemon only copies records, so they stay bytes there.  A
planner answers a request twice.  The first answer is a :class:`Planned` or an error.  The second is
the :class:`Rest`, and no caller waits for it.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import os
import pickle
import struct
import time
import weakref
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import NamedTuple

from orientd.driver import ZERO, Joints, Quaternion, Vector3
from orientd.model.request import Frame
from orientd.planner.facts import HISTORY, MOTION_RECORD, MotionFacts
from orientd.stream.records import JOINTS

CHUNK = 65_536
"""Records that a planner works out at a time: two minutes at 500 Hz."""

FIRST = 1024
"""Records that are there with the answer; the others of a chunk come with the rest."""

SMALL_BYTES = 32_768
"""Of a request that counts as small: 300 keyframes as a text, 800 as columns."""

HEADER = struct.Struct("!Q")

_STAGE_BYTES = 256
_PUNCH_HOLE = 0x02 | 0x01  # FALLOC_FL_PUNCH_HOLE, FALLOC_FL_KEEP_SIZE


class Rank(IntEnum):
    """Rank requests: those of a higher rank wait for those of a lower one."""

    URGENT = 0
    SMALL = 1
    LARGE = 2


@dataclass(frozen=True, slots=True, eq=False)
class PlanRequest:
    """A motion that a caller asks for, with everything that its plan depends on.

    Attributes:
        motion: the text of a motion file, which only the planner reads.
        source: name of the file, for errors; empty if the text is from no file.
        columns: keyframes as a serialised ``KeyframeColumns``, in place of those of the text.
        keyframes: the most that it may have.
        caller: who asks; how much of one caller may wait is bounded.
        timeout: longest planning time, s, including waits for a planner and repeated plans.
        rate_hz: samples a second to report with the plan; 0 for none.
        began: when that time began, monotonic s.
        unix_ns: Unix time of the request, ns, for keep-out cones that move.
        waits: s, each that the device was waited for; see :meth:`waiting`.
        device: the device to plan for.
        motion_id: names the motion, and no other.
        records: where the motion begins.  From rest: one record.  From a running motion: the record
            at which to leave it and the three before.  After a motion: the end of that motion.
        after: the motion to follow; ``None`` if it begins at the last of *records*.
        tolerance: how far from the corner between the two the device may pass, rad.
        earliest: the record of *after* before which that cannot be left any more.
        first: first record to write; with record 0 come the three before it.
        count: how many records to write; fewer if the motion ends.
    """

    motion: bytes
    source: str = ""
    columns: bytes = b""
    keyframes: int = 200_000
    caller: str = ""
    timeout: float = 10.0
    rate_hz: float = 0.0
    # Looked up at the call: the clocks may be others in tests.
    began: float = field(default_factory=lambda: time.monotonic())
    unix_ns: int = field(default_factory=lambda: time.time_ns())
    waits: list[float] = field(default_factory=list)
    device: str = ""
    motion_id: str = ""
    records: bytes = b""
    after: MotionFacts | None = None
    tolerance: float = 0.0
    earliest: int = 0
    first: int = 0
    count: int = CHUNK

    def beginning(
        self,
        device: str,
        records: bytes,
        *,
        after: MotionFacts | None = None,
        tolerance: float = 0.0,
        earliest: int = 0,
    ) -> PlanRequest:
        """Return the request for a motion of *device* that begins at *records*, with a new name."""
        return replace(
            self,
            device=device,
            records=records,
            after=after,
            tolerance=tolerance,
            earliest=earliest,
            motion_id=os.urandom(6).hex(),
        )

    def again(
        self, timeout: float, *, caller: str = "", rate_hz: float = 0.0, first: int = 0, count: int
    ) -> PlanRequest:
        """Return a request for records or samples of the same motion, which begins now."""
        return replace(
            self,
            timeout=timeout,
            caller=caller,
            rate_hz=rate_hz,
            first=first,
            count=count,
            began=time.monotonic(),
            waits=[],
        )

    @contextlib.contextmanager
    def waiting(self) -> Iterator[None]:
        """Count what the context takes as time in which the device is waited for."""
        begun = time.monotonic()
        try:
            yield
        finally:
            self.waits.append(time.monotonic() - begun)

    @property
    def time_left(self) -> float:
        """How much of the time is left, s."""
        return max(0.0, self.began + self.timeout - time.monotonic())

    @property
    def rank(self) -> Rank:
        """The rank of the request on a device at rest."""
        return Rank.SMALL if self.size <= SMALL_BYTES else Rank.LARGE

    @property
    def size(self) -> int:
        """Bytes of the motion."""
        return len(self.motion) + len(self.columns)


class Planned(NamedTuple):
    """Answer a request, once the first records are in the file.

    Attributes:
        facts: summary of the motion.
        leave: record of the motion before at which it begins, of one that follows another.
        plan: a serialised ``orientd.v1.Plan``, which callers and events get as it is.
        samples: a serialised ``Plan`` with samples alone, if the request asks for some.
        frame: in which the motion was asked for; ``None`` for the device's own coordinates.
        end: the record behind the last one in the file.
    """

    facts: MotionFacts
    leave: int
    plan: bytes
    samples: bytes
    frame: Frame | None
    end: int


class Rest(NamedTuple):
    """Complete an answer; no caller waits for this.

    Attributes:
        end: the record behind the last one in the file by now.
        samples: a serialised ``Event`` with samples alone, for the event of the start.
        resident: bytes of memory that the process uses now.
    """

    end: int
    samples: bytes
    resident: int


class RecordFile:
    """A file in memory with the records of one motion, each at its own place, from -3 on.

    The planner writes them and the daemon reads what it feeds.  None of it counts as memory of the
    daemon, however many motions wait.

    Attributes:
        descriptor: of the file.
    """

    def __init__(self, descriptor: int = -1) -> None:
        """Take the file with that descriptor over, or make a new one."""
        if descriptor < 0:
            descriptor = os.memfd_create("orientd-records", os.MFD_CLOEXEC)
        self.descriptor = descriptor
        weakref.finalize(self, os.close, descriptor)

    @property
    def stage(self) -> str:
        """The planner's current stage, in words."""
        found = os.pread(self.descriptor, _STAGE_BYTES, 0)
        return found.partition(b"\0")[0].decode(errors="replace") or "reading the request"

    def say(self, stage: str) -> None:
        """Write down what the planner is doing."""
        # A text of the request may have characters that have no bytes.
        text = stage.encode(errors="backslashreplace")[: _STAGE_BYTES - 1]
        os.pwrite(self.descriptor, text.ljust(_STAGE_BYTES, b"\0"), 0)

    def read(self, first: int, count: int) -> bytes:
        """Return records, each a :data:`MOTION_RECORD`.

        Raises:
            ValueError: they are not in the file.
        """
        size = count * MOTION_RECORD.size
        records = os.pread(self.descriptor, size, _place(first))
        if len(records) != size:
            raise ValueError(f"records {first} to {first + count} are not in the file")
        return records

    def write(self, first: int, records: bytes) -> None:
        """Put records into the file.

        Raises:
            MemoryError: there is no room for them.
        """
        if os.pwrite(self.descriptor, records, _place(first)) != len(records):
            raise MemoryError

    def forget(self, first: int, end: int) -> None:
        """Give back the memory of records *first* to *end*."""
        begin, behind = _place(first), _place(end)
        if behind > begin:
            place, length = ctypes.c_int64(begin), ctypes.c_int64(behind - begin)
            ctypes.CDLL(None).fallocate(self.descriptor, _PUNCH_HOLE, place, length)


def _place(record: int) -> int:
    return _STAGE_BYTES + (HISTORY + record) * MOTION_RECORD.size


def record_at_rest(q: Quaternion, position: Vector3, joints: Joints) -> bytes:
    """Return the record of a device that holds at an orientation, a position and axis angles."""
    absent = (math.nan,) * (JOINTS - len(joints))
    rates = (0.0,) * len(joints)
    at = (*q, *ZERO, *ZERO, *position, *ZERO, *joints, *absent, *rates, *absent, *ZERO)
    return MOTION_RECORD.pack(*at)


def packed_request(request: PlanRequest) -> list[bytes]:
    """Return the message of a request in parts: the request without its motion, then the motion."""
    parts = request.motion, request.columns
    headers = [HEADER.pack(len(part)) for part in parts]
    bare = packed(replace(request, motion=b"", columns=b""))
    return [bare, headers[0], parts[0], headers[1], parts[1]]


def unpacked_request(body: bytearray, motion: bytearray, columns: bytearray) -> PlanRequest:
    """Return the request of a message."""
    request: PlanRequest = pickle.loads(body)
    return replace(request, motion=bytes(motion), columns=bytes(columns))


def packed(content: object) -> bytes:
    """Return a message: *content* with its length in front."""
    body = pickle.dumps(content, protocol=pickle.HIGHEST_PROTOCOL)
    return HEADER.pack(len(body)) + body
