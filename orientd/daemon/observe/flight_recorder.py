"""The flight recorder: after a fault, the minute before it is written to a file.

Every device keeps its newest cycles in memory (:mod:`orientd.daemon.device.cycle_memory`), the
journal its newest events.  After a fault, a thread waits for the cycles that follow it.  It passes
all of them to a separate process as one unlinked file in memory, and waits for the result.  Neither
the servo nor a command waits for any of this.
"""

from __future__ import annotations

import json
import logging
import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING, BinaryIO

from orientd.config import Settings
from orientd.daemon.device import CycleMemory, DeviceEvent, EventKind
from orientd.daemon.observe.journal import Journal
from orientd.daemon.report_directory import report_directory
from orientd.stream.records import CYCLE_RECORD

if TYPE_CHECKING:
    from orientd.daemon.device import Device

_log = logging.getLogger(__name__)

AFTERWARDS = 1.0
"""Time recorded after a fault, in which the device comes to rest, s."""

_NOTICE = 0.2  # s from the cycle of a fault until the daemon reports it
_COPYING = 0.3  # s in which cycles have been copied from shared memory
_MARGIN = 1.0  # s of spare capacity, for cycles that come while a file is passed on
_LONGEST = 60.0  # s that writing a file may take
_LOOK = 0.1  # s between looks at the process that writes it

FINISHING = 2.0
"""Longest wait for files when the daemon ends, s; their processes then continue without it."""

_FAULTS = (EventKind.FAULT, EventKind.SERVO_DIED)


def _is_installed() -> bool:
    return all(find_spec(name) is not None for name in ("mcap", "foxglove_schemas_protobuf"))


class FlightRecorder:
    """Writes a recording of each device that falls into a fault.

    Attributes:
        unfinished: processes that still write a file when the daemon has ended.
    """

    def __init__(self, settings: Settings, journal: Journal, devices: Mapping[str, Device]) -> None:
        """Record as *settings* say.

        Args:
            settings: of the daemon.
            journal: has the events.
            devices: by name; may be filled in until the first event.
        """
        self._settings = settings.recorder
        self._configuration = settings.model_dump_json(exclude_none=True)
        self._journal = journal
        self._faults: SimpleQueue[DeviceEvent | None] = SimpleQueue()
        self._closing = threading.Event()
        self._give_up_at = math.inf
        self.unfinished: list[subprocess.Popen[str]] = []
        self._devices = devices
        self._memories: dict[str, CycleMemory] = {}
        self._thread: threading.Thread | None = None

    def memory(self, name: str, rate_hz: float) -> CycleMemory | None:
        """Return what keeps the newest cycles of a device; ``None`` if nothing is recorded."""
        if not self._settings.seconds or not _is_installed():
            return None
        kept = self._settings.seconds + AFTERWARDS + _COPYING + _MARGIN
        self._memories[name] = CycleMemory(round(kept * rate_hz))
        return self._memories[name]

    def start(self) -> None:
        """Wait for faults from now on."""
        if self._settings.seconds and not _is_installed():
            _log.info("flight recorder: it is off, it needs the extra `record`")
        if not self._memories:
            return
        self._thread = threading.Thread(target=self._work, name="flight recorder", daemon=True)
        self._thread.start()

    def on_event(self, event: DeviceEvent) -> None:
        """Queue a recording if *event* is a fault; do not wait."""
        memory = self._memories.get(event.device)
        # A device that never ran has no cycles to record, however often the daemon restarts it.
        if event.kind in _FAULTS and memory is not None and memory.end:
            self._faults.put(event)

    def close(self) -> None:
        """End once the files are written, or soon; the devices have ended."""
        self._give_up_at = time.monotonic() + FINISHING
        self._closing.set()
        self._faults.put(None)
        if self._thread is not None:
            self._thread.join()

    def _work(self) -> None:
        until: dict[str, int] = {}
        while (event := self._faults.get()) is not None:
            if event.time_ns <= until.get(event.device, 0):
                continue  # it is in the file already
            until[event.device] = event.time_ns + round(AFTERWARDS * 1e9)
            wait = (until[event.device] - time.monotonic_ns()) * 1e-9 + _COPYING
            self._closing.wait(max(0.0, wait))
            kind, text = self._write(event)
            is_bad = kind is EventKind.RECORDING_FAILED
            _log.log(
                logging.ERROR if is_bad else logging.INFO, "%s: %s: %s",
                event.device, kind.value, text,
            )  # fmt: skip
            self._journal.on_event(DeviceEvent(event.device, kind, text, time.monotonic_ns()))

    def _write(self, event: DeviceEvent) -> tuple[EventKind, str]:
        """Write a file and return how that went: its path, or why not."""
        try:
            return self._written(event)
        except OSError as error:
            return EventKind.RECORDING_FAILED, str(error)
        except Exception as error:  # noqa: BLE001 - or there would be no recording of any later fault
            _log.exception("%s: the recording failed", event.device)
            return EventKind.RECORDING_FAILED, f"{type(error).__name__}: {error}"

    def _written(self, event: DeviceEvent) -> tuple[EventKind, str]:
        """Gather what a recording holds, and have it written."""
        device = self._devices[event.device]
        since_ns = event.time_ns - round((self._settings.seconds + _NOTICE) * 1e9)
        events = self._journal.kept(event.device, since_ns)
        directory = self._settings.directory or Path(report_directory()) / "recordings"
        header = {
            "device": device.name,
            "rate_hz": device.rate_hz,
            "reason": event.text,
            "fault_ns": event.time_ns,
            "since_ns": since_ns,
            "offset_ns": time.time_ns() - time.monotonic_ns(),
            "layout": CYCLE_RECORD.format,
            "configuration": self._configuration,
            "directory": str(directory),
            "keep_files": self._settings.keep_files,
            "keep_bytes": round(self._settings.keep_megabytes * 1e6),
            "events": [len(one) for one in events],
            "health": [part._asdict() for part in device.snapshot().health],
        }
        with os.fdopen(os.memfd_create("orientd-flight", os.MFD_CLOEXEC), "wb") as file:
            # A line of JSON, the events, the slots.
            file.writelines([json.dumps(header).encode() + b"\n", *events])
            file.flush()
            self._memories[event.device].copy_to(file.fileno())
            file.seek(0)
            return self._made(file)

    def _made(self, recorded: BinaryIO) -> tuple[EventKind, str]:
        """Make the file in a process of its own, and return the result."""
        process = subprocess.Popen(
            [sys.executable, "-m", "orientd.recorder.flight"],
            stdin=recorded,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            cwd="/",
            process_group=0,
        )
        longest = time.monotonic() + _LONGEST
        while True:
            try:
                path, problem = process.communicate(timeout=_LOOK)
                break
            except subprocess.TimeoutExpired:
                if time.monotonic() > longest:
                    process.kill()
                    process.communicate()
                    return EventKind.RECORDING_FAILED, f"not written within {_LONGEST:g} s"
                if time.monotonic() > self._give_up_at:
                    self.unfinished.append(process)
                    for pipe in (process.stdout, process.stderr):
                        if pipe is not None:
                            pipe.close()
                    return EventKind.RECORDING_FAILED, "not written yet when the daemon ended"
        if process.returncode == 0:
            return EventKind.RECORDED, path.strip()
        said = (problem.strip() or f"it ended with status {process.returncode}").splitlines()
        return EventKind.RECORDING_FAILED, said[-1]
