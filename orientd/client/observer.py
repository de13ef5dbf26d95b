"""The calls of a client that only watches: records of cycles, events, the settings."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import grpc

from orientd.client.connection import Connection
from orientd.errors import DaemonError
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import Outline, outline
from orientd.stream.records import CYCLE_RECORD, Cycle, unpack_cycle


@dataclass(frozen=True, slots=True)
class Configuration:
    """The daemon's settings.

    Attributes:
        json: with the keys of its file, including defaults.
        offset_ns: from the daemon's monotonic clock to its time of day.
    """

    json: str
    offset_ns: int


class Observer:
    """Watches devices until it is closed; created by :meth:`orientd.client.robot.Robot.observe`."""

    def __init__(self, connection: Connection) -> None:
        """Watch over *connection*, which others use too."""
        self._connection = connection
        self._stub = connection.stub
        self._lock = threading.Lock()
        self._streams: list[Any] = []
        self._is_closed = False

    def configuration(self) -> Configuration:
        """Return the daemon's settings."""
        answer = self._connection.ask(self._stub.GetConfiguration, pb.GetConfigurationRequest())
        return Configuration(answer.json, answer.time.ToNanoseconds() - answer.monotonic_ns)

    def state(self) -> pb.GetStateResponse:
        """Return the current state of the daemon and its devices, as its message."""
        request = pb.GetStateRequest()
        answer: pb.GetStateResponse = self._connection.ask(self._stub.GetState, request)
        return answer

    def records(self, device: str = "", *, rate_hz: float = 20.0) -> Iterator[tuple[bytes, int]]:
        """Yield every cycle of a device as packed records, in batches, until closed.

        Args:
            device: its name.
            rate_hz: batches a second, 0.1 to 100.

        Yields:
            Consecutive records (:data:`~orientd.stream.records.CYCLE_RECORD`), and the number of
            cycles lost since the previous batch.

        Raises:
            UnknownNameError: the device does not exist.
            DaemonError: the daemon is lost, or has another record format.
        """
        request = pb.WatchStateRequest(device=device, rate_hz=rate_hz, as_records=True)
        for batch in self._records(request):
            yield batch.records, batch.lost

    def sight(
        self, device: str = "", *, rate_hz: float = 20.0, with_outline: bool = True
    ) -> Iterator[tuple[list[Cycle], Outline]]:
        """Yield every cycle of a device, and its shape after each batch, until closed.

        Args:
            device: its name.
            rate_hz: batches a second, 0.1 to 100.
            with_outline: whether to ask for the shape.

        Raises:
            UnknownNameError: the device does not exist.
            DaemonError: the daemon is lost, or has another record format.
        """
        request = pb.WatchStateRequest(
            device=device, rate_hz=rate_hz, as_records=True, with_outline=with_outline
        )
        for batch in self._records(request):
            starts = range(0, len(batch.records), CYCLE_RECORD.size)
            cycles = [unpack_cycle(batch.records, start) for start in starts]
            yield cycles, outline(batch.outline)

    def events(self, device: str = "") -> Iterator[pb.Event]:
        """Yield the events of a device, or of all of them, until closed.

        Raises:
            UnknownNameError: the device does not exist.
            DaemonError: the daemon is lost.
        """
        for batch in self._stream(self._stub.WatchEvents, pb.WatchEventsRequest(device=device)):
            yield from batch.events

    def close(self) -> None:
        """End all subscriptions."""
        with self._lock:
            self._is_closed = True
            streams, self._streams = self._streams, []
        for stream in streams:
            stream.cancel()

    def _records(self, request: pb.WatchStateRequest) -> Iterator[pb.WatchStateResponse]:
        for batch in self._stream(self._stub.WatchState, request):
            if batch.layout != CYCLE_RECORD.format:
                raise DaemonError("the daemon is of another version: it packs cycles otherwise")
            yield batch

    def _stream(self, method: Callable[..., Any], request: object) -> Iterator[Any]:
        with self._lock:
            if self._is_closed:
                return
            stream = self._connection.call(method, request)
            self._streams.append(stream)
        lost = ""
        try:
            for answer in stream:
                lost = f"lost the daemon at {self._connection.way}"
                yield answer
        except grpc.RpcError as error:
            if not self._is_closed:
                raise self._connection.explain(error, lost=lost) from error
        finally:
            stream.cancel()
            with self._lock:
                self._streams = [one for one in self._streams if one is not stream]
