"""Records what all daemons of a cell do, in one file and on one clock.

Every time in the file is one of the recorder's monotonic clock: those of a daemon are shifted by
its offset, which is measured again and again and written into the file with its bound.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Self

from orientd.errors import DaemonError, OrientdError
from orientd.fleet.clocks import Offset
from orientd.recorder import DaemonRecorder, LiveRecording, RecordingError

if TYPE_CHECKING:
    from orientd.fleet.client import Fleet
    from orientd.recorder import RecordingWriter

MOST_DAEMONS = 256
"""Daemons in one file."""

_POLL = 0.1
_AGAIN = 1.0
"""Time after which a daemon that was lost is recorded again, s."""


class HeldOffset:
    """A clock's offset that changes no more than what is measured asks for.

    The times of a daemon are not to jump with every estimate, so it stays what it was for as long
    as that is within the bound, and is the end of the interval next to it from then on.
    """

    def __init__(self) -> None:
        """Hold nothing yet."""
        self._held: Offset | None = None

    @property
    def ns(self) -> int:
        """What is held; 0 before anything was measured."""
        return 0 if self._held is None else self._held.ns

    def take(self, offset: Offset) -> Offset:
        """Return what is held from now on, and how far that may be wrong."""
        low, high = offset.ns - offset.bound_ns, offset.ns + offset.bound_ns
        ns = offset.ns if self._held is None else min(max(self._held.ns, low), high)
        self._held = Offset(ns, max(ns - low, high - ns))
        return self._held


class FleetRecording(LiveRecording):
    """The recording of a cell: from :meth:`run` to :meth:`end`, or for as long as a ``with`` block.

    Daemons that come are recorded from then on, those that leave until then.

    Attributes:
        problems: why a daemon is not recorded, or no longer, by its name.
    """

    def __init__(
        self, fleet: Fleet, path: Path, daemons: Sequence[str] = (), *, has_scalars: bool = False
    ) -> None:
        """Prepare to record daemons of *fleet*; see :meth:`orientd.fleet.Fleet.record`."""
        super().__init__(path, has_scalars=has_scalars)
        self._fleet, self._daemons = fleet, daemons
        self._background: Future[None] | None = None
        self._pool = ThreadPoolExecutor(MOST_DAEMONS, thread_name_prefix="orientd fleet record")
        self.problems: dict[str, str] = {}

    def run(self) -> None:
        """Record until :meth:`end`.

        Raises:
            RecordingError: the file cannot be written any further.
            DaemonError: one of the daemons that were named is not there at the beginning.
        """
        if self._daemons:
            self._fleet.find(self._daemons, timeout=0.0)
        work: dict[str, Future[None]] = {}
        due: dict[str, float] = {}
        with self._begin_file(time.time_ns() - time.monotonic_ns()) as writer:
            try:
                self._begin_all(writer, work, due)
                while not self.ending.wait(_POLL):
                    self._begin_all(writer, work, due)
            finally:
                self.ending.set()
                wait(work.values())
                for daemon in list(work):
                    self._take_end(daemon, work)

    def _begin_all(
        self, writer: RecordingWriter, work: dict[str, Future[None]], due: dict[str, float]
    ) -> None:
        """Record whoever is there and is not recorded yet."""
        for daemon, one in list(work.items()):
            if one.done():
                due[daemon] = time.monotonic() + _AGAIN
                self._take_end(daemon, work)
        for daemon in self._daemons or self._fleet.daemons:
            is_there = daemon in self._fleet.daemons
            if is_there and daemon not in work and time.monotonic() >= due.get(daemon, 0.0):
                work[daemon] = self._pool.submit(self._record, writer, daemon)

    def _take_end(self, daemon: str, work: dict[str, Future[None]]) -> None:
        """Note how the recording of a daemon has ended.

        Raises:
            RecordingError: because of the file.
        """
        try:
            work.pop(daemon).result()
        except RecordingError:
            self.ending.set()
            raise
        except OrientdError as error:
            self.problems[daemon] = str(error)
        else:
            if not self.ending.is_set():
                self.problems[daemon] = "has left"

    def _record(self, writer: RecordingWriter, daemon: str) -> None:
        clock, held = self._fleet.clock(daemon), HeldOffset()

        def measure() -> None:
            offset = clock.measure()
            if offset is None:
                raise DaemonError(f"{daemon} does not tell its time")
            kept = held.take(offset)
            writer.add_clock(
                daemon, time_ns=time.monotonic_ns(), offset_ns=kept.ns, bound_ns=kept.bound_ns
            )

        with self._fleet.robot(daemon, holder="orientd fleet record") as robot:
            recorder = DaemonRecorder(robot, daemon=daemon, shift_ns=lambda: held.ns)
            measure()
            configuration = recorder.observer.configuration()
            recorder.run(writer, configuration, self, on_state=measure)

    # For as long as a block

    def __enter__(self) -> Self:
        """Begin, and return once cycles of every daemon that is there are recorded.

        Raises:
            OrientdError: as of :meth:`run`.
        """
        self._background = self._pool.submit(self.run)
        expected = set(self._daemons or self._fleet.daemons)
        while not expected <= {*self.problems, *(name.partition("/")[0] for name in self.cycles)}:
            if self._background.done():
                self._background.result()
            time.sleep(_POLL)
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        """Have the recording completed.

        Raises:
            OrientdError: as of :meth:`run`, unless the block itself has failed.
        """
        self.end()
        try:
            if self._background is not None:
                self._background.result()
        except OrientdError:
            if error is None:
                raise
        finally:
            self._pool.shutdown()
