"""Write recordings: MCAP files with compressed, indexed chunks.

Topics of a file, for a device called ``arm``:

================  =============================  ===================================================
topic             schema                         holds
================  =============================  ===================================================
/arm/cycles       orientd/msg/Cycle              every cycle: sent, measured, timing, state
/arm/events       orientd.v1.Event               events; plan, certificate, request, path
/state            orientd.v1.GetStateResponse    the daemon and its devices, every few seconds
/tf               foxglove.FrameTransform        frames arm/sent and arm/measured, for 3D views
/log              foxglove.Log                   events as text
================  =============================  ===================================================

A recording of a cell has the daemon's name before it: ``/arm-1/arm/cycles``, ``/arm-1/state``.  Its
metadata ``clock`` hold the clock offset of each daemon.

Log times are times of day: the monotonic clock plus the offset in the metadata ``orientd``.  The
configuration is the attachment ``configuration.json``, in a cell ``arm-1/configuration.json``.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, Self

from google.protobuf.message import Message
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema

from orientd import __version__
from orientd.errors import OrientdError
from orientd.files import sync, sync_name
from orientd.protocol import control_pb2 as pb
from orientd.recorder import foxglove
from orientd.recorder.columns import SCHEMA_NAME, Table, schema, to_messages

SHOWN_HZ = 25.0
"""Largest rate of the frames in ``/tf``."""

CONFIGURATION, CLOCK = "configuration.json", "clock"
"""Name of an attachment, and of metadata."""


class RecordingError(OrientdError):
    """Report a recording that can no longer be written, or cannot be read."""


class RecordingWriter:
    """One recording that is being written; a context manager that completes it.

    Several threads may add to it; all of them get a :class:`RecordingError` once it cannot be
    written any further.
    """

    def __init__(self, path: Path, *, offset_ns: int) -> None:
        """Begin a file.

        Args:
            path: is overwritten.
            offset_ns: from the monotonic clock to the time of day.

        Raises:
            RecordingError: it cannot be written.
        """
        self._path = path
        self._offset_ns = offset_ns
        self._rates: dict[str, float] = {}
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._ended = ""
        self._lock = threading.RLock()
        try:
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        except OSError as error:
            raise RecordingError(f"cannot write {path}: {error.strerror}") from error
        self._stream = os.fdopen(descriptor, "wb")
        with self._guarded():
            self._writer: Any = Writer(self._stream, compression=CompressionType.ZSTD)
            self._writer.start(library=f"orientd {__version__}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add_device(self, name: str, rate_hz: float) -> None:
        """Set the rate of a device's cycles, before the first of them."""
        with self._lock:
            self._rates[name] = rate_hz

    def add_cycles(self, device: str, cycles: Table) -> None:
        """Add cycles of a device, in their order."""
        with self._guarded():
            text = schema().encode()
            register = partial(self._writer.register_schema, SCHEMA_NAME, "ros2msg", text)
            channel = self._channel(f"/{device}/cycles", "cdr", SCHEMA_NAME, register)
            due = (cycles["deadline_ns"] + self._offset_ns).tolist()
            for time_ns, message in zip(due, to_messages(cycles), strict=True):
                self._writer.add_message(channel, time_ns, message, time_ns)
        step = max(1, round(self._rates[device] / SHOWN_HZ))
        shown = cycles[cycles["index"] % step == 0]
        for time_ns, frame in foxglove.frames(device, shown, self._offset_ns):
            self._add("/tf", time_ns, frame)

    def add_event(self, event: pb.Event) -> None:
        """Add an event."""
        time_ns = event.time_ns + self._offset_ns
        self._add(f"/{event.device}/events", time_ns, event)
        self._add("/log", time_ns, foxglove.log_line(event, time_ns))

    def add_state(self, state: pb.GetStateResponse, time_ns: int, *, prefix: str = "") -> None:
        """Add a report of the daemon and its devices at *time_ns*, monotonic clock.

        Args:
            state: as the daemon says it, on its own clock.
            time_ns: on the clock of the file.
            prefix: the daemon's name and a slash, in the file of a cell.
        """
        self._add(f"/{prefix}state", time_ns + self._offset_ns, state)

    def add_configuration(self, json: str, facts: dict[str, str], *, prefix: str = "") -> None:
        """Add the daemon's settings and other metadata of the recording.

        Args:
            json: the settings.
            facts: whatever else.
            prefix: the daemon's name and a slash, in the file of a cell.
        """
        with self._guarded():
            facts = {
                "clock_offset_ns": str(self._offset_ns),
                "rates_hz": " ".join(f"{name}={rate!r}" for name, rate in self._rates.items()),
                **facts,
            }
            self._writer.add_metadata("orientd", facts)
            name, content = f"{prefix}{CONFIGURATION}", json.encode()
            self._writer.add_attachment(0, 0, name, "application/json", content)

    def add_clock(self, daemon: str, *, time_ns: int, offset_ns: int, bound_ns: int) -> None:
        """Add the offset of a daemon's clock from the clock of the file.

        Args:
            daemon: its name.
            time_ns: when, monotonic clock.
            offset_ns: how far it was ahead, by which its times in the file are shifted.
            bound_ns: how far that may be wrong, either way.
        """
        times = {"time_ns": time_ns, "offset_ns": offset_ns, "bound_ns": bound_ns}
        with self._guarded():
            self._writer.add_metadata(
                CLOCK, {"daemon": daemon, **{name: str(ns) for name, ns in times.items()}}
            )

    def flush(self) -> None:
        """End the chunk and write it to the file, so that it outlives this process.

        Raises:
            RecordingError: it cannot be written.
        """
        with self._guarded():
            self._writer.flush()

    def close(self) -> None:
        """Complete the file, which outlives a power cut from then on.

        Raises:
            RecordingError: it cannot be completed.
        """
        with self._lock:
            if not self._ended:
                with self._guarded():
                    self._writer.finish()
                    self._stream.close()
                    if self._path.is_file():
                        sync(self._path)
                        sync_name(self._path)
                self._ended = f"the recording {self._path} has ended"

    def _add(self, topic: str, time_ns: int, message: Message) -> None:
        with self._guarded():
            register = partial(register_schema, self._writer, type(message))
            name = message.DESCRIPTOR.full_name
            channel = self._channel(topic, "protobuf", name, register)
            self._writer.add_message(channel, time_ns, message.SerializeToString(), time_ns)

    def _channel(self, topic: str, encoding: str, name: str, register: Callable[[], int]) -> int:
        """Return the channel of a topic; the first message of a schema registers it."""
        if topic not in self._channels:
            if name not in self._schemas:
                self._schemas[name] = register()
            register_channel = self._writer.register_channel
            self._channels[topic] = register_channel(topic, encoding, self._schemas[name])
        return self._channels[topic]

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        """Let one thread write; end the recording if a write fails, for example on a full disk."""
        with self._lock:
            if self._ended:
                raise RecordingError(self._ended)
            try:
                yield
            except OSError as error:
                with contextlib.suppress(OSError):
                    self._stream.close()
                size = self._path.stat().st_size
                self._ended = (
                    f"the recording {self._path} ends after {size} bytes: {error.strerror}"
                )
                raise RecordingError(self._ended) from error
