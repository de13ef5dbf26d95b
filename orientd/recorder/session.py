"""Records what a daemon does, as a client of its control socket."""

from __future__ import annotations

import threading
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path

import numpy as np

from orientd.errors import UnknownNameError
from orientd.recorder.cycle_table import from_records
from orientd.recorder.writer import BLOCK, LIVE_CHUNK_BYTES, RecordingWriter
from orientd.rpc import Robot
from orientd.stream import CYCLE_RECORD

READ_HZ = 10.0
"""Batches of cycles a second."""

LONGEST_HELD = 0.4
"""Seconds after which cycles are written, though they are few."""

STATE_INTERVAL = 5.0
"""Seconds between two reports of the state."""

_POLL = 0.1


class RecordingSession:
    """The recording of some devices, from :meth:`run` until it is told to end.

    Attributes:
        cycles: recorded so far, by device.
        lost: cycles that the daemon had forgotten before they were read, by device.
        events: recorded so far.
    """

    def __init__(
        self, robot: Robot, path: Path, devices: Sequence[str] = (), *, has_scalars: bool = False
    ) -> None:
        """Prepare to record.

        Args:
            robot: whose devices.
            path: of the file.
            devices: their names; all, where none is named.
            has_scalars: whether every cycle is written as plain numbers too, for tools that plot.

        Raises:
            UnknownNameError: there is no such device.
        """
        known = {device.name: device for device in robot.devices()}
        for name in devices:
            if name not in known:
                raise UnknownNameError(
                    "device", f"expected one of {', '.join(known)}, got {name!r}"
                )
        self._observer = robot.observe()
        self._path, self._has_scalars = path, has_scalars
        self._devices = [known[name] for name in devices or known]
        self._ending = threading.Event()
        self._writing = threading.Lock()
        self.cycles: defaultdict[str, int] = defaultdict(int)
        self.lost: defaultdict[str, int] = defaultdict(int)
        self.events = 0

    def end(self) -> None:
        """Have the recording completed; may be called from any thread, or a signal's handler."""
        self._ending.set()

    def run(self, *, on_progress: Callable[[], None] = lambda: None) -> None:
        """Record until :meth:`end`.

        Args:
            on_progress: called now and then, from this thread.

        Raises:
            RecordingError: the file cannot be written any further.
            DaemonError: the daemon is lost; the file is complete up to there.
        """
        observer = self._observer
        configuration = observer.configuration()
        with RecordingWriter(
            self._path,
            offset_ns=configuration.offset_ns,
            has_scalars=self._has_scalars,
            chunk_bytes=LIVE_CHUNK_BYTES,
        ) as writer:
            for device in self._devices:
                writer.add_device(device.name, device.rate_hz)
            writer.add_configuration(configuration.json, {})
            with ThreadPoolExecutor(len(self._devices) + 1) as pool:
                work = [pool.submit(self._record_events, writer)]
                work += [pool.submit(self._record_cycles, writer, d.name) for d in self._devices]
                due = 0.0
                try:
                    while not wait(work, _POLL, return_when="FIRST_COMPLETED").done:
                        on_progress()
                        if self._ending.is_set():
                            time.sleep(2.0 / READ_HZ)  # for the cycles up to here
                            break
                        if time.monotonic() >= due:
                            due = time.monotonic() + STATE_INTERVAL
                            state = observer.state()
                            with self._writing:
                                writer.add_state(state, time.monotonic_ns())
                finally:
                    self._ending.set()
                    observer.close()
                for one in work:
                    one.result()

    def _record_cycles(self, writer: RecordingWriter, device: str) -> None:
        pending: list[bytes] = []
        count, due = 0, time.monotonic() + LONGEST_HELD
        try:
            for records, lost in self._observer.records(device, rate_hz=READ_HZ):
                self.lost[device] += lost
                pending.append(records)
                count += len(records) // CYCLE_RECORD.size
                if count >= BLOCK or time.monotonic() >= due:
                    self._add(writer, device, pending)
                    pending, count, due = [], 0, time.monotonic() + LONGEST_HELD
        finally:
            self._add(writer, device, pending)

    def _add(self, writer: RecordingWriter, device: str, pending: list[bytes]) -> None:
        if not pending:
            return
        table = from_records(pending)
        # A new servo process counts from the beginning.
        for part in np.split(table, np.flatnonzero(np.diff(table["index"]) < 0) + 1):
            with self._writing:
                writer.add_cycles(device, part)
        self.cycles[device] += len(table)

    def _record_events(self, writer: RecordingWriter) -> None:
        names = {device.name for device in self._devices}
        for event in self._observer.events():
            if event.device in names:
                with self._writing:
                    writer.add_event(event)
                self.events += 1
