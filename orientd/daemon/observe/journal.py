"""The journal: what happens to devices, as messages, for whoever watches and for the record.

A thread of its own makes the messages, so that neither a device nor the control socket waits for
those of long motions.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from queue import SimpleQueue
from typing import NamedTuple

from orientd.daemon.devices import DeviceEvent
from orientd.daemon.ring_file import RingFile
from orientd.rpc import control_pb2 as pb

_log = logging.getLogger(__name__)

KEPT_BYTES = 4 << 20
"""Of events, for the flight recorder."""

WAITING = 1000
"""Events that wait for one who watches."""


class Subscription:
    """The events that wait for one who watches; see :meth:`Journal.subscribe`."""

    def __init__(self, journal: Journal, device: str, wake: Callable[[], object]) -> None:
        self._journal = journal
        self._device = device
        self._wake = wake
        self._waiting: deque[bytes] = deque()
        self._lost = 0
        self._lock = threading.Lock()

    def put(self, device: str, event: bytes) -> None:
        """Let an event wait, and tell the watcher; the newest one is dropped when there are many.

        Args:
            device: what it happened to.
            event: serialised.
        """
        if self._device not in ("", device):
            return
        with self._lock:
            if len(self._waiting) >= WAITING:
                self._lost += 1
                return
            self._waiting.append(event)
        try:
            self._wake()
        except RuntimeError:  # the watcher's event loop has ended
            self.close()

    def take(self) -> pb.WatchEventsResponse:
        """Return the events that wait, and how many were dropped since this was last called."""
        with self._lock:
            taken, lost = list(self._waiting), self._lost
            self._waiting.clear()
            self._lost = 0
        return pb.WatchEventsResponse(events=map(pb.Event.FromString, taken), lost=lost)

    def close(self) -> None:
        """Wait for no more events."""
        self._journal.forget(self)


class _Kept(NamedTuple):
    """Where an event is kept."""

    device: str
    time_ns: int
    place: int
    length: int


class Journal:
    """Events as serialised messages ``orientd.v1.Event``, the newest of them kept."""

    def __init__(self, *, kept: float = 0.0) -> None:
        """Begin without a thread, which starts with the first event.

        Args:
            kept: how old events may be for :meth:`kept`, s.
        """
        self._oldest_ns = round(kept * 1e9)
        self._queue: SimpleQueue[DeviceEvent | None] = SimpleQueue()
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._subscriptions: list[Subscription] = []
        self._kept: deque[_Kept] = deque()
        self._file = RingFile("orientd-events", KEPT_BYTES)

    def hear(self, event: DeviceEvent) -> None:
        """Take note of an event; waits for nothing.  May be called from any thread."""
        with self._lock:
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="journal", daemon=True)
                self._thread.start()
        self._queue.put(event)

    def subscribe(self, device: str, wake: Callable[[], object]) -> Subscription:
        """Return what collects the events from now on.

        Args:
            device: those of one device; of all where it is empty.
            wake: called from the journal's thread when there is an event to take.
        """
        subscription = Subscription(self, device, wake)
        with self._lock:
            self._subscriptions = [*self._subscriptions, subscription]
        return subscription

    def forget(self, subscription: Subscription) -> None:
        """Collect no more events in *subscription*."""
        with self._lock:
            self._subscriptions = [s for s in self._subscriptions if s is not subscription]

    def kept(self, device: str, since_ns: int) -> list[bytes]:
        """Return the events of *device* since an instant of the monotonic clock."""
        with self._lock:
            return [self._file.read(one.place, one.length) for one in self._kept
                    if one.device == device and one.time_ns >= since_ns]  # fmt: skip

    def close(self) -> None:
        """Take note of nothing more."""
        with self._lock:
            thread = self._thread
        if thread is not None:
            self._queue.put(None)
            thread.join()

    def _keep(self, event: DeviceEvent, message: bytes) -> None:
        """Keep an event, and none that are older than they may be, or that it takes the room of."""
        kept, file = self._kept, self._file
        if len(message) > file.size:
            kept.clear()
            file.restart(len(message))
        place = file.end
        file.append(message)
        kept.append(_Kept(event.device, event.time_ns, place, len(message)))
        oldest, oldest_ns = file.end - file.size, event.time_ns - self._oldest_ns
        while kept and (kept[0].place < oldest or kept[0].time_ns < oldest_ns):
            kept.popleft()

    def _work(self) -> None:
        while (event := self._queue.get()) is not None:
            try:
                message = event_to_message(event).SerializeToString()
            except Exception:  # noqa: BLE001 - or nothing would be told ever after
                _log.exception("%s: cannot report an event", event.device)
                continue
            with self._lock:
                subscriptions = self._subscriptions
                try:
                    self._keep(event, message)
                except OSError as error:
                    _log.warning("%s: cannot keep an event: %s", event.device, error)
            for subscription in subscriptions:
                subscription.put(event.device, message)


def event_to_message(event: DeviceEvent) -> pb.Event:
    """Return *event* as a message; with the plan, request and samples of a motion that starts."""
    message = pb.Event(
        device=event.device,
        kind=f"EVENT_KIND_{event.kind.name}",
        motion_number=event.motion_number,
        text=event.text,
        time_ns=event.time_ns,
    )
    if event.motion is not None:
        message.MergeFromString(event.motion.event)
        if event.path_index is not None:
            message.path_index = event.path_index
    return message
