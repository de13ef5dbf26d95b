"""The journal: the events of devices as messages, for clients that watch and for recordings.

A thread of its own makes the messages.  So neither a device nor the control socket waits for those
of long motions.  :class:`EventLog` writes the same events to the log.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from queue import SimpleQueue

from orientd.daemon.device import DeviceEvent, EventKind
from orientd.daemon.log import about
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import titled

_log = logging.getLogger(__name__)

KEPT_BYTES = 4 << 20
"""Size of the events that are kept for the flight recorder."""

WAITING = 1000
"""Events that may wait for one watcher."""

_URGENT = (EventKind.FAULT, EventKind.SERVO_DIED)
"""Events that wait for no plan of a motion that has started before."""


class Subscription:
    """The events that wait for one watcher; see :meth:`Journal.subscribe`."""

    def __init__(self, journal: Journal, device: str, wake: Callable[[], object]) -> None:
        self._journal = journal
        self._device = device
        self._wake = wake
        self._waiting: deque[pb.Event] = deque()
        self._lost = 0
        self._lock = threading.Lock()

    def put(self, event: pb.Event) -> None:
        """Queue *event* and wake the watcher; drop and count it if too many wait."""
        if self._device not in ("", event.device):
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
        """Return the events that wait, and the number of those dropped since the last call."""
        with self._lock:
            taken, lost = list(self._waiting), self._lost
            self._waiting.clear()
            self._lost = 0
        return pb.WatchEventsResponse(events=taken, lost=lost)

    def close(self) -> None:
        """Collect no more events."""
        self._journal.forget(self)


class Journal:
    """Make the messages of events, tell watchers, and keep the newest of them serialised."""

    def __init__(self, *, kept: float = 0.0) -> None:
        """Begin without a thread, which starts with the first event.

        Args:
            kept: the age up to which events are kept, s.
        """
        self._oldest_ns = round(kept * 1e9)
        # Each event, and whether the watchers know it already.
        self._queue: SimpleQueue[tuple[DeviceEvent, bool] | None] = SimpleQueue()
        self._urgent = 0
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._subscriptions: list[Subscription] = []
        self._kept: deque[tuple[str, int, bytes]] = deque()
        self._kept_bytes = 0

    def on_event(self, event: DeviceEvent) -> None:
        """Record an event; return at once.  Safe to call from any thread."""
        with self._lock:
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="journal", daemon=True)
                self._thread.start()
            self._urgent += event.kind in _URGENT
        self._queue.put((event, False))

    def subscribe(self, device: str, wake: Callable[[], object]) -> Subscription:
        """Return a subscription to the events from now on.

        Args:
            device: the only device of interest; empty for all devices.
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
        """Return the serialised events of *device* since an instant of the monotonic clock."""
        with self._lock:
            kept = list(self._kept)
        return [event for of, time_ns, event in kept if of == device and time_ns >= since_ns]

    def close(self) -> None:
        """Take note of nothing more."""
        with self._lock:
            thread = self._thread
        if thread is not None:
            self._queue.put(None)
            thread.join()

    def _keep(self, event: DeviceEvent, content: bytes) -> None:
        """Keep an event; drop the oldest ones that exceed the age or the size."""
        self._kept.append((event.device, event.time_ns, content))
        self._kept_bytes += len(content)
        oldest_ns = event.time_ns - self._oldest_ns
        while len(self._kept) > 1 and (
            self._kept_bytes > KEPT_BYTES or self._kept[0][1] < oldest_ns
        ):
            self._kept_bytes -= len(self._kept.popleft()[2])

    def _work(self) -> None:
        while (item := self._queue.get()) is not None:
            event, is_told = item
            if event.kind in _URGENT:
                with self._lock:
                    self._urgent -= 1
            # A fault of the first second waits for no plan: it follows the start without one, and
            # the recording gets the plan when it is there.
            is_late = not _await_plan(event, lambda: self._urgent > 0)
            if is_late:
                self._queue.put((event, True))
            if is_late and is_told:
                continue
            try:
                message = event_to_message(event)
                content = message.SerializeToString()
            except Exception:  # noqa: BLE001 - or nothing would be told ever after
                _log.exception("%s: cannot report an event", event.device)
                continue
            with self._lock:
                subscriptions = self._subscriptions
                if not is_late:
                    self._keep(event, content)
            for subscription in () if is_told else subscriptions:
                subscription.put(message)


def _await_plan(event: DeviceEvent, is_urgent: Callable[[], bool]) -> bool:
    """Wait for the plan of a motion that starts; return ``False`` if that was cut short."""
    queued = event.queued
    if event.kind is not EventKind.MOTION_STARTED or queued is None or queued.planned is None:
        return True
    return queued.planned.await_event(is_urgent)


def event_to_message(event: DeviceEvent) -> pb.Event:
    """Return *event* as a message; with the plan, request and samples of a motion that starts."""
    message = pb.Event(
        device=event.device,
        kind=f"EVENT_KIND_{event.kind.name}",
        motion_number=event.motion_number,
        text=event.text,
        time_ns=event.time_ns,
    )
    queued = event.queued
    if event.kind is EventKind.MOTION_STARTED and queued is not None and queued.planned is not None:
        message.MergeFromString(queued.planned.event)
        if queued.first_index is not None:
            message.path_index = queued.first_index
    return message


_LEVELS = {
    EventKind.FAULT: logging.ERROR,
    EventKind.SERVO_DIED: logging.ERROR,
    EventKind.WARNING: logging.WARNING,
}


class EventLog:
    """Write a line for each event of a device, and one for who commands a motion."""

    def __init__(self) -> None:
        self._died: dict[str, str] = {}

    def on_event(self, event: DeviceEvent) -> None:
        """Log an event; called from the device's own thread, or from a command."""
        number, planned = event.motion_number, event.queued and event.queued.planned
        motion_id, name = (planned.id, planned.facts.name) if planned else ("", "")
        title, text, outcome = titled(number, name), event.text, None
        if event.ended is not None:
            ended, text = event.ended
            outcome = pb.Outcome.Name(ended).removeprefix("OUTCOME_").lower()
        _log.log(
            self._level(event),
            "%s: %s%s%s",
            event.device,
            event.kind.value,
            f" {title}" if number else "",
            f": {text}" if text else "",
            extra=about(
                device=event.device,
                event=event.kind.value,
                motion=number,
                motion_id=motion_id,
                motion_name=name,
                outcome=outcome,
            ),
        )
        if event.lease is not None:
            _log.info(
                "%s: motion %s is commanded by %s",
                event.device,
                title,
                event.lease.who,
                extra=about(
                    device=event.device,
                    motion=number,
                    motion_id=motion_id,
                    motion_name=name,
                    identity=event.lease.owner,
                    planned_duration=planned.facts.duration if planned else None,
                ),
            )

    def _level(self, event: DeviceEvent) -> int:
        """Return how loudly to log an event: a start that fails again as before is logged once."""
        if event.kind is EventKind.READY:
            self._died.pop(event.device, None)
        elif event.kind is EventKind.SERVO_DIED:
            last, self._died[event.device] = self._died.get(event.device), event.text
            if event.text == last:
                return logging.DEBUG
        return _LEVELS.get(event.kind, logging.INFO)
