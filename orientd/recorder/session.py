"""Record a daemon as a client of its control socket."""

from __future__ import annotations

import threading
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path

from orientd.client.observer import Configuration
from orientd.client.robot import Robot
from orientd.errors import DaemonError, UnknownNameError
from orientd.recorder.columns import from_records
from orientd.recorder.writer import RecordingWriter

READ_HZ = 4.0
"""Batches of cycles a second; each is in the file before the next one comes."""

STATE_INTERVAL = 5.0
"""Seconds between two reports of the state."""

_POLL = 0.1


class LiveRecording:
    """A recording that grows while devices move, with its counts so far.

    Attributes:
        cycles: by device.
        lost: cycles that the daemon had forgotten before they were read, by device.
        events: of all devices.
        ending: is set to end it.
        seconds: of cycles to keep of each device, from its first one; ``None`` for all.
    """

    def __init__(self, path: Path) -> None:
        """Prepare the file at *path*."""
        self._path = path
        self.seconds: float | None = None
        self.ending = threading.Event()
        self.cycles: defaultdict[str, int] = defaultdict(int)
        self.lost: defaultdict[str, int] = defaultdict(int)
        self.events = 0

    def end(self) -> None:
        """End the recording, from any thread; a signal handler needs a thread of its own for it."""
        self.ending.set()


class DaemonRecorder:
    """Writes the devices of one daemon to a file, which may have other writers.

    Attributes:
        observer: of the daemon.
    """

    def __init__(
        self,
        robot: Robot,
        devices: Sequence[str] = (),
        *,
        daemon: str = "",
        shift_ns: Callable[[], int] = lambda: 0,
    ) -> None:
        """Prepare to record.

        Args:
            robot: whose devices.
            devices: their names, by default all.
            daemon: its name in the file of a cell, which precedes the names of its devices.
            shift_ns: returns how far the daemon's monotonic clock is ahead of the file's.

        Raises:
            UnknownNameError: there is no such device.
        """
        known = {device.name: device for device in robot.devices()}
        for name in devices:
            if name not in known:
                raise UnknownNameError(
                    "device", f"expected one of {', '.join(known)}, got {name!r}"
                )
        self.observer = robot.observe()
        self._prefix, self._shift_ns = f"{daemon}/" if daemon else "", shift_ns
        self._devices = [known[name] for name in devices or known]

    def run(
        self,
        writer: RecordingWriter,
        configuration: Configuration,
        recording: LiveRecording,
        *,
        on_state: Callable[[], None] = lambda: None,
    ) -> None:
        """Record until *recording* ends, or the daemon.

        Args:
            writer: of the file.
            configuration: of the daemon.
            recording: receives the counts, and says when to end.
            on_state: called before each report of the state, from this thread.

        Raises:
            RecordingError: the file cannot be written any further.
            DaemonError: the daemon is lost.
        """
        for device in self._devices:
            writer.add_device(self._prefix + device.name, device.rate_hz)
        writer.add_configuration(configuration.json, {}, prefix=self._prefix)
        writer.flush()
        with ThreadPoolExecutor(len(self._devices) + 1) as pool:
            work = [pool.submit(self._record_events, writer, recording)]
            work += [
                pool.submit(self._record_cycles, writer, recording, device.name)
                for device in self._devices
            ]
            due = 0.0
            try:
                while True:
                    if time.monotonic() >= due:
                        due = time.monotonic() + STATE_INTERVAL
                        on_state()
                        state, now_ns = self.observer.state(), time.monotonic_ns()
                        writer.add_state(state, now_ns, prefix=self._prefix)
                    if wait(work, _POLL, return_when="FIRST_COMPLETED").done:
                        break
                    if recording.ending.is_set():
                        time.sleep(2.0 / READ_HZ)  # for the cycles up to here
                        break
            finally:
                self.observer.close()
            for one in work:
                one.result()

    def _record_cycles(
        self, writer: RecordingWriter, recording: LiveRecording, device: str
    ) -> None:
        name = self._prefix + device
        until_ns: float | None = None
        for records, lost in self.observer.records(device, rate_hz=READ_HZ):
            recording.lost[name] += lost
            table, shift_ns = from_records(records), self._shift_ns()
            if recording.seconds is not None and len(table):
                # By the daemon's clock: more cycles arrive while the last of them are waited for.
                until_ns = until_ns or table["deadline_ns"][0] + 1e9 * recording.seconds
                table = table[table["deadline_ns"] < until_ns]
            if shift_ns:
                table = table.copy()
                for column in ("deadline_ns", "feedback_time_ns"):
                    table[column] -= shift_ns
            writer.add_cycles(name, table)
            writer.flush()
            recording.cycles[name] += len(table)

    def _record_events(self, writer: RecordingWriter, recording: LiveRecording) -> None:
        names = {device.name for device in self._devices}
        for event in self.observer.events():
            if event.device in names:
                event.device = self._prefix + event.device
                event.time_ns -= self._shift_ns()
                writer.add_event(event)
                writer.flush()
                recording.events += 1


class RecordingSession(LiveRecording):
    """The recording of some devices of a daemon, from :meth:`run` until :meth:`end`."""

    def __init__(self, robot: Robot, path: Path, devices: Sequence[str] = ()) -> None:
        """Prepare to record.

        Args:
            robot: whose devices.
            path: of the file.
            devices: their names, by default all.

        Raises:
            UnknownNameError: there is no such device.
        """
        super().__init__(path)
        self._recorder = DaemonRecorder(robot, devices)

    def run(self) -> None:
        """Record until :meth:`end`.

        Raises:
            RecordingError: the file cannot be written any further.
            DaemonError: the daemon is lost; the file is complete up to there.
        """
        configuration = self._recorder.observer.configuration()
        with RecordingWriter(self._path, offset_ns=configuration.offset_ns) as writer:
            try:
                self._recorder.run(writer, configuration, self)
            except DaemonError as error:
                raise DaemonError(f"{error}; {self._path} is whole up to there") from error
