"""Records what all daemons of a cell do, in one file and on one clock.

Every time in the file is one of the recorder's monotonic clock.  The times of a daemon are shifted
by its clock's offset, which is measured every few seconds and written into the file with its bound.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import TYPE_CHECKING, Self

from orientd.client.daemon_clock import Offset
from orientd.errors import OrientdError
from orientd.recorder.session import DaemonRecorder, LiveRecording
from orientd.recorder.writer import RecordingError, RecordingWriter

if TYPE_CHECKING:
    from orientd_fleet.client import Fleet

_MOST_DAEMONS = 1000
"""Daemons that are recorded at a time; each takes a thread."""

_POLL = 0.1
_AGAIN = 1.0
"""Time after which a daemon that was lost is recorded again, s."""


def kept_offset(held: Offset | None, newest: Offset) -> Offset:
    """Return the offset from a measurement on, and how far it may be wrong.

    It stays as it was while that is within the newest bound.  Otherwise it moves to the nearest end
    of that bound, so that times do not jump with every estimate.
    """
    low, high = newest.ns - newest.bound_ns, newest.ns + newest.bound_ns
    ns = newest.ns if held is None else min(max(held.ns, low), high)
    return Offset(ns, max(ns - low, high - ns))


class FleetRecording(LiveRecording):
    """The recording of a cell: from :meth:`run` to :meth:`end`, or for as long as a ``with`` block.

    A daemon that comes is recorded from then on, one that leaves until then.

    Attributes:
        problems: why a daemon is not recorded, or no longer, by its name.
    """

    def __init__(self, fleet: Fleet, path: Path, daemons: Sequence[str] = ()) -> None:
        """Prepare to record daemons of *fleet*; see :meth:`orientd_fleet.client.Fleet.record`."""
        super().__init__(path)
        self._fleet, self._daemons = fleet, daemons
        self._pool = ThreadPoolExecutor(_MOST_DAEMONS, "orientd fleet record")
        self._running: Future[None] = Future()
        self.problems: dict[str, str] = {}

    def run(self) -> None:
        """Record until :meth:`end`.

        Raises:
            RecordingError: the file cannot be written any further.
            DaemonError: a daemon that was named is not there at the beginning.
        """
        if self._daemons:
            self._fleet.find(self._daemons, timeout=0.0)
        kept: dict[str, Future[None]] = {}
        offset_ns = time.time_ns() - time.monotonic_ns()
        with RecordingWriter(self._path, offset_ns=offset_ns) as writer:
            while not self.ending.wait(_POLL if kept else 0.0):
                for daemon in self._daemons or self._fleet.daemons:
                    if daemon not in kept:
                        kept[daemon] = self._pool.submit(self._keep_recording, writer, daemon)
            wait(kept.values())
        for one in kept.values():
            one.result()

    def _keep_recording(self, writer: RecordingWriter, daemon: str) -> None:
        """Record one daemon whenever it is there, until :meth:`end`.

        Raises:
            RecordingError: the file cannot be written; then the whole recording ends.
        """
        while not self.ending.is_set():
            if daemon in self._fleet.daemons:
                try:
                    self._record(writer, daemon)
                    if not self.ending.is_set():
                        self.problems[daemon] = "has left"
                except RecordingError:
                    self.ending.set()
                    raise
                except OrientdError as error:
                    self.problems[daemon] = str(error)
            self.ending.wait(_AGAIN)

    def _record(self, writer: RecordingWriter, daemon: str) -> None:
        """Record one daemon until it leaves, or :meth:`end`."""
        held: Offset | None = None

        def measure() -> None:
            nonlocal held
            held = kept_offset(held, self._fleet.offset(daemon))
            writer.add_clock(
                daemon, time_ns=time.monotonic_ns(), offset_ns=held.ns, bound_ns=held.bound_ns
            )

        with self._fleet.robot(daemon, holder="orientd fleet record") as robot:
            measure()
            recorder = DaemonRecorder(
                robot, daemon=daemon, shift_ns=lambda: 0 if held is None else held.ns
            )
            configuration = recorder.observer.configuration()
            recorder.run(writer, configuration, self, on_state=measure)

    # For as long as a block

    def __enter__(self) -> Self:
        """Begin, and return once cycles of every daemon that is there are recorded.

        Raises:
            OrientdError: as of :meth:`run`.
        """
        self._running = self._pool.submit(self.run)
        expected = set(self._daemons or self._fleet.daemons)
        while not expected <= {*self.problems, *(name.partition("/")[0] for name in self.cycles)}:
            if self._running.done():
                self._running.result()
                raise RecordingError("the recording has ended")
            time.sleep(_POLL)
        return self

    def __exit__(self, kind: object, error: object, traceback: object) -> None:
        """Complete the recording.

        Raises:
            OrientdError: as of :meth:`run`, unless the block itself has failed.
        """
        self.end()
        wait([self._running])
        if error is None:
            self._running.result()
