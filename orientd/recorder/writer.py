"""Writes recordings: MCAP files with compressed, indexed chunks.

Topics of a file, for a device called ``arm``:

=======================  =============================  ===========================================
topic                    schema                         holds
=======================  =============================  ===========================================
/arm/cycles              orientd.v1.CycleBlock          every cycle: sent, measured, timing
/arm/events              orientd.v1.Event               events; plan, certificate, request, path
/state                   orientd.v1.GetStateResponse    the daemon and its devices, now and then
/arm/sent/tf             foxglove.FrameTransform        world to arm/sent
/arm/sent/pose           foxglove.PoseInFrame           the same as a pose
/arm/sent/odometry       foxglove.Odometry              with angular velocity
/arm/measured/...        as sent                        with the time at which it was measured
/arm/measured/joints     foxglove.JointStates           axis angles
/arm/planned/path        foxglove.PosesInFrame          a motion's path, when it starts
/arm/scalars             orientd.v1.Scalars             numbers of every cycle, where asked for
/log                     foxglove.Log                   events in words
=======================  =============================  ===========================================

In the file of a cell there is the daemon's name before it: ``/arm-1/arm/cycles``, ``/arm-1/state``,
and the metadata ``clock`` of a daemon say where its clock stood.

Times are times of day: the monotonic clock and an offset, which is in the metadata ``orientd``.
The configuration is the attachment ``configuration.json``, of a cell ``arm-1/configuration.json``.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

import numpy as np
from google.protobuf.message import Message
from mcap.writer import CompressionType, Writer
from mcap_protobuf.schema import register_schema

from orientd import __version__
from orientd.errors import OrientdError
from orientd.protocol import control_pb2 as pb
from orientd.recorder import foxglove
from orientd.recorder.cycle_table import Table, to_block
from orientd.recorder.scalars import scalars_of

SHOWN_HZ = 25.0
"""How often viewers are given a device's pose, at the most."""

BLOCK = 256
"""Cycles in a message."""

CONFIGURATION, CLOCK = "configuration.json", "clock"
"""Name of an attachment, and of metadata."""

CHUNK_BYTES = 512 * 1024
"""What is compressed and written at a time, of a recording that is written at once."""

LIVE_CHUNK_BYTES = 4 * 1024
"""The same of one that grows, which holds then what is half a second old, whatever happens."""


class RecordingError(OrientdError):
    """A recording that cannot be written any further, or not be read."""


class _Sink:
    """A file without buffers, in which a full disk shows at once."""

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        self._position = 0

    def write(self, content: bytes) -> int:
        rest = memoryview(content)
        while rest:
            written = os.write(self._descriptor, rest)
            self._position += written
            rest = rest[written:]
        return len(content)

    def tell(self) -> int:
        return self._position

    def flush(self) -> None:
        """Do nothing: nothing is held back."""

    def close(self) -> None:
        os.close(self._descriptor)


class RecordingWriter:
    """One recording that is being written; a context manager that completes it.

    Several threads may add to it; all of them get a :class:`RecordingError` once it cannot be
    written any further.
    """

    def __init__(
        self,
        path: Path,
        *,
        offset_ns: int,
        has_scalars: bool = False,
        chunk_bytes: int = CHUNK_BYTES,
    ) -> None:
        """Begin a file.

        Args:
            path: is overwritten.
            offset_ns: from the monotonic clock to the time of day.
            has_scalars: whether every cycle is written as plain numbers too, for tools that plot.
            chunk_bytes: how much is compressed and written at a time, about.

        Raises:
            RecordingError: it cannot be written.
        """
        self._path = path
        self._offset_ns = offset_ns
        self._has_scalars = has_scalars
        self._rates: dict[str, float] = {}
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._ended = ""
        self._lock = threading.RLock()
        try:
            self._sink = _Sink(path)
        except OSError as error:
            raise RecordingError(f"cannot write {path}: {error.strerror}") from error
        with self._guarded():
            sink: Any = self._sink  # all of a stream that a writer uses
            self._writer: Any = Writer(
                sink, chunk_size=chunk_bytes, compression=CompressionType.ZSTD
            )
            self._writer.start(library=f"orientd {__version__}")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add_device(self, name: str, rate_hz: float) -> None:
        """Say how fast a device's cycles come, before the first of them."""
        with self._lock:
            self._rates[name] = rate_hz

    def add_cycles(self, device: str, cycles: Table) -> None:
        """Add cycles of a device, in their order."""
        for begin in range(0, len(cycles), BLOCK):
            block = cycles[begin : begin + BLOCK]
            time_ns = int(block["deadline_ns"][-1]) + self._offset_ns
            self._add(f"/{device}/cycles", time_ns, to_block(block))
        step = max(1, round(self._rates[device] / SHOWN_HZ))
        shown = cycles[np.asarray(cycles["index"]) % step == 0]
        for topic, time_ns, message in foxglove.cycles_shown(device, shown, self._offset_ns):
            self._add(topic, time_ns, message)
        if self._has_scalars:
            for time_ns, message in scalars_of(cycles, self._offset_ns):
                self._add(f"/{device}/scalars", time_ns, message)

    def add_event(self, event: pb.Event) -> None:
        """Add an event."""
        self._add(f"/{event.device}/events", event.time_ns + self._offset_ns, event)
        for topic, time_ns, message in foxglove.event_shown(event, self._offset_ns):
            self._add(topic, time_ns, message)

    def add_state(self, state: pb.GetStateResponse, time_ns: int, *, prefix: str = "") -> None:
        """Add what the daemon said of itself and its devices at *time_ns*, monotonic clock.

        Args:
            state: as the daemon says it, on its own clock.
            time_ns: on the clock of the file.
            prefix: the daemon's name and a slash, in the file of a cell.
        """
        self._add(f"/{prefix}state", time_ns + self._offset_ns, state)

    def add_configuration(self, json: str, facts: dict[str, str], *, prefix: str = "") -> None:
        """Add the daemon's settings, and what else there is to know of the recording.

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
        """Add where the clock of a daemon stood against that of the file.

        Args:
            daemon: its name.
            time_ns: when, monotonic clock.
            offset_ns: how far it was ahead, by which its times in the file are shifted.
            bound_ns: how far that may be wrong, either way.
        """
        told = {"time_ns": time_ns, "offset_ns": offset_ns, "bound_ns": bound_ns}
        with self._guarded():
            self._writer.add_metadata(
                CLOCK, {"daemon": daemon, **{name: str(ns) for name, ns in told.items()}}
            )

    def close(self) -> None:
        """Complete the file.

        Raises:
            RecordingError: it cannot be completed.
        """
        with self._lock:
            if self._ended:
                return
            with self._guarded():
                self._writer.finish()
            self._ended = f"the recording {self._path} has ended"
            self._sink.close()

    def _add(self, topic: str, time_ns: int, message: Message) -> None:
        with self._guarded():
            channel = self._channels.get(topic)
            if channel is None:
                channel = self._channel(topic, message)
            self._writer.add_message(
                channel, log_time=time_ns, data=message.SerializeToString(), publish_time=time_ns
            )

    def _channel(self, topic: str, message: Message) -> int:
        name = message.DESCRIPTOR.full_name
        if name not in self._schemas:
            self._schemas[name] = register_schema(self._writer, type(message))
        channel: int = self._writer.register_channel(topic, "protobuf", self._schemas[name])
        self._channels[topic] = channel
        return channel

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        """Let one thread write; turn the end of the disk into the end of the recording."""
        with self._lock:
            if self._ended:
                raise RecordingError(self._ended)
            try:
                yield
            except OSError as error:
                self._ended = (
                    f"the recording {self._path} ends after {self._sink.tell()} bytes: "
                    f"{error.strerror}"
                )
                self._sink.close()
                raise RecordingError(self._ended) from error
