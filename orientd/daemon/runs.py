"""The motions that devices run: who started each, and how and why each of them ended.

A device reports its events from its own thread; whatever waits for the end of a motion waits for a
future here.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field

from orientd.daemon.device import Device
from orientd.daemon.device_report import DeviceEvent, EventKind
from orientd.errors import OrientdError, StateError
from orientd.planner import Motion
from orientd.rpc.reports import Outcome
from orientd.stream import State

_log = logging.getLogger(__name__)

Ended = tuple[Outcome, str]


@dataclass(eq=False)
class Run:
    """One motion of one device, from its start to its end.

    Attributes:
        device: what runs it.
        number: of the motion, 1 for the first of the device.
        motion: what is run.
        token: the lease that it was started with.
        ended: how it ended and why, once it has.
    """

    device: Device
    number: int
    motion: Motion
    token: str
    ended: Future[Ended] = field(default_factory=Future)


class Runs:
    """The newest motion of every device."""

    def __init__(self, devices: Mapping[str, Device]) -> None:
        """Know of no motion yet.

        Args:
            devices: by name; may be filled in later, before the first event.
        """
        self._devices = devices
        self._lock = threading.Lock()
        self._runs: dict[str, Run] = {}
        self._ends: dict[str, tuple[int, Ended]] = {}
        self._stops: dict[str, int] = {}
        self._reasons: dict[str, str] = {}

    def stops(self, device: Device) -> int:
        """Return how often *device* was told to stop, to give to :meth:`begin` later on."""
        with self._lock:
            return self._stops.get(device.name, 0)

    def unfinished(self, token: str | None = None) -> list[Run]:
        """Return the motions under way: all of them, or those that were started with *token*."""
        with self._lock:
            return [
                run
                for run in self._runs.values()
                if not run.ended.done() and token in (None, run.token)
            ]

    def begin(
        self,
        device: Device,
        motion: Motion,
        *,
        token: str,
        stops: int,
        is_owned: Callable[[], bool],
    ) -> Run:
        """Start *motion* on *device*.

        Args:
            device: what is to move.
            motion: planned for it.
            token: the lease that it is started with.
            stops: what :meth:`stops` returned before the motion was planned: whoever stopped the
                device since then stopped this motion too.
            is_owned: whether the lease is still held.

        Raises:
            StateError: the device is not ready to move, or was stopped meanwhile.
        """
        with self._lock:
            if self._stops.get(device.name, 0) != stops:
                reason = self._reasons.get(device.name, "stopped")
                raise StateError(f"device {device.name} was stopped before it began: {reason}")
            self._reasons.pop(device.name, None)
        number = device.start(motion)
        run = Run(device, number, motion, token)
        with self._lock:
            self._runs[device.name] = run
            ended_number, ended = self._ends.get(device.name, (0, None))
            is_stopped = self._stops.get(device.name, 0) != stops
            if ended is not None and ended_number == number:
                run.ended.set_result(ended)
        if not run.ended.done() and (is_stopped or not is_owned()):
            # Told to stop, or disowned, between the checks and the start.
            device.stop()
        return run

    def halt(self, devices: Iterable[Device], reason: str) -> list[OrientdError]:
        """Stop *devices* on their paths, all of them even where one fails; return the failures."""
        failures: list[OrientdError] = []
        for device in devices:
            with self._lock:
                self._stops[device.name] = self._stops.get(device.name, 0) + 1
                self._reasons[device.name] = reason
            _log.info("%s: stop: %s", device.name, reason)
            try:
                device.stop()
            except OrientdError as error:
                _log.warning("%s: stop failed: %s", device.name, error)
                failures.append(error)
        return failures

    def conclude(self, run: Run, ended: Ended) -> None:
        """Note how *run* ended, unless that is known."""
        with self._lock:
            if not run.ended.done():
                run.ended.set_result(ended)

    def hear(self, event: DeviceEvent) -> None:
        """Note what a device reports; called from its own thread, or from within its start."""
        number = f" {event.motion_number}" if event.motion_number else ""
        text = event.text
        if event.kind is EventKind.MOTION_DONE:
            self._end(event, (Outcome.DONE, ""))
        elif event.kind is EventKind.MOTION_STOPPED:
            ended = self._why(event)
            text = ended[1]
            self._end(event, ended)
        is_bad = event.kind in (EventKind.FAULT, EventKind.SERVO_DIED)
        _log.log(
            logging.ERROR if is_bad else logging.INFO,
            "%s: %s%s%s",
            event.device,
            event.kind.value,
            number,
            f": {text}" if text else "",
        )

    def _why(self, event: DeviceEvent) -> Ended:
        snapshot = self._devices[event.device].snapshot()
        if snapshot.state is State.FAULT:
            return Outcome.FAULT, snapshot.fault_text or event.text
        with self._lock:
            return Outcome.STOPPED, self._reasons.get(event.device, event.text)

    def _end(self, event: DeviceEvent, ended: Ended) -> None:
        with self._lock:
            self._ends[event.device] = (event.motion_number, ended)
            run = self._runs.get(event.device)
        if run is not None and run.number == event.motion_number:
            self.conclude(run, ended)
