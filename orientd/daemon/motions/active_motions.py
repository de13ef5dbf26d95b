"""The motions that devices run: who started each, and how and why each of them ended.

A device reports its events from its own thread; whatever waits for the end of a motion waits for a
future here.
"""

from __future__ import annotations

import logging
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from orientd.daemon.devices import STOPPED, DeviceEvent, EventKind
from orientd.daemon.observe import about
from orientd.errors import Fault, OrientdError, StateError
from orientd.rpc import Outcome, titled
from orientd.stream import UNKNOWN

if TYPE_CHECKING:
    from orientd.daemon.device import Device
    from orientd.daemon.planners import PlannedMotion

_log = logging.getLogger(__name__)

Ended = tuple[Outcome, str]

_OUTCOMES = {
    EventKind.MOTION_DONE: Outcome.DONE,
    EventKind.MOTION_PASSED: Outcome.PASSED,
    EventKind.MOTION_REPLACED: Outcome.REPLACED,
    EventKind.MOTION_UNSETTLED: Outcome.UNSETTLED,
}

_LEVELS = {
    EventKind.FAULT: logging.ERROR,
    EventKind.SERVO_DIED: logging.ERROR,
    EventKind.WARNING: logging.WARNING,
}

_KEPT_STARTS = 64
"""Motions with a start time whose beginnings are compared."""

_KEPT_ENDS = 8
"""Ends of a device's motions that are kept for whoever is about to ask for them."""


@dataclass(eq=False)
class ActiveMotion:
    """One motion of one device, from its start to its end.

    Attributes:
        device: what runs it.
        number: of the motion, 1 for the first of the device.
        motion: what is run; ``None`` where the device follows targets.
        token: the lease that it was started with.
        start_ns: when it was to begin, if that was asked for.
        reason: why it was told to end, by itself or with its device; empty while it was not.
        ended: how it ended and why, once it has.
    """

    device: Device
    number: int
    motion: PlannedMotion | None
    token: str
    start_ns: int = UNKNOWN
    reason: str = ""
    ended: Future[Ended] = field(default_factory=Future)


class ActiveMotions:
    """The motions of every device that have not ended."""

    def __init__(self, devices: Mapping[str, Device]) -> None:
        """Know of no motion yet.

        Args:
            devices: by name; may be filled in later, before the first event.
        """
        self._devices = devices
        self._lock = threading.Lock()
        self._runs: dict[tuple[str, int], ActiveMotion] = {}
        self._ends: dict[str, dict[int, Ended]] = {}
        self._ids: dict[str, dict[int, tuple[str, str]]] = {}
        self._stops: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}
        self._died: dict[str, str] = {}
        self._timed: list[ActiveMotion] = []

    def stops(self, device: Device) -> int:
        """Return how often *device* was told to stop, to give to :meth:`begin` later on."""
        with self._lock:
            return self._stops[device.name] + device.stops_beside

    def unfinished(self, token: str | None = None) -> list[ActiveMotion]:
        """Return the motions under way: all of them, or those that were started with *token*."""
        with self._lock:
            return [
                run
                for run in self._runs.values()
                if not run.ended.done() and token in (None, run.token)
            ]

    def find(self, device: Device, number: int) -> ActiveMotion | None:
        """Return motion *number* of *device*, if it has not ended."""
        with self._lock:
            return self._runs.get((device.name, number))

    def abandon(self, run: ActiveMotion, reason: str) -> list[OrientdError]:
        """End *run*, and nothing that runs before it; return what failed.

        One that waits for its turn is taken out; else the device is stopped on its path.
        """
        if run.ended.done():
            return []
        run.reason = reason
        return [] if run.device.withdraw(run.number, reason) else self.halt([run.device], reason)

    def begin(
        self,
        device: Device,
        start: Callable[[], int],
        *,
        motion: PlannedMotion | None,
        token: str,
        stops: int,
        is_owned: Callable[[], bool],
        start_ns: int = UNKNOWN,
    ) -> ActiveMotion:
        """Have *device* begin to move.

        Args:
            device: what is to move.
            start: begins it, and returns the motion's number.
            motion: planned for it; ``None`` where it follows targets.
            token: the lease that it is started with.
            stops: what :meth:`stops` returned before the motion was planned: whoever stopped the
                device since then stopped this motion too.
            is_owned: whether the lease is still held.
            start_ns: when the motion is to begin, if that was asked for.

        Raises:
            LateError: the device has passed the point at which it was to begin.
            StateError: the device is not ready to move, or was stopped meanwhile.
        """
        with self._lock:
            if self._stops[device.name] + device.stops_beside != stops:
                reason = self._reasons.get(device.name, "stopped")
                raise StateError(f"device {device.name} was stopped before it began: {reason}")
            self._reasons.pop(device.name, None)
        number = start()
        run = ActiveMotion(device, number, motion, token, start_ns)
        with self._lock:
            is_stopped = self._stops[device.name] + device.stops_beside != stops
            ended = self._ends.get(device.name, {}).get(number)
            if ended is not None:
                run.ended.set_result(ended)
            else:
                self._runs[device.name, number] = run
            if start_ns != UNKNOWN:
                self._timed = [*self._timed[1 - _KEPT_STARTS :], run]
        # Told to stop, or disowned, between the checks and the start.
        if not run.ended.done() and is_stopped:
            device.stop()
        elif not is_owned():
            self.abandon(run, "the lease was lost before it began")
        return run

    def starts(self, run: ActiveMotion) -> tuple[float | None, float | None]:
        """Return how late *run* began and how far apart all of its start time did, s."""
        if run.start_ns == UNKNOWN:
            return None, None
        with self._lock:
            timed = [other for other in self._timed if other.start_ns == run.start_ns]
        began = {r: r.device.began_ns(r.number) for r in timed}
        mine = began.get(run)
        instants = [instant for instant in began.values() if instant is not None]
        lateness = None if mine is None else (mine - run.start_ns) * 1e-9
        return lateness, (max(instants) - min(instants)) * 1e-9 if len(instants) > 1 else None

    def halt(
        self, devices: Iterable[Device], reason: str, *, is_quickest: bool = False
    ) -> list[OrientdError]:
        """Stop *devices*, all of them even where one fails; return the failures.

        Args:
            devices: to stop on their paths.
            reason: what whoever runs a motion is told.
            is_quickest: whether to leave the path where that is quicker.
        """
        failures: list[OrientdError] = []
        for device in devices:
            with self._lock:
                self._stops[device.name] += 1
            self.note_stop([device.name], reason)
            _log.info("%s: stop: %s", device.name, reason)
            try:
                device.halt() if is_quickest else device.stop()
            except OrientdError as error:
                _log.warning("%s: stop failed: %s", device.name, error)
                failures.append(error)
        return failures

    def note_stop(self, devices: Iterable[str], reason: str) -> None:
        """Note that *devices* were told to stop, and why."""
        stopped = dict.fromkeys(devices, reason)
        with self._lock:
            self._reasons.update(stopped)
            # What is asked for while they come to rest forgets the reason of the device.
            for run in self._runs.values():
                if run.device.name in stopped and not run.reason:
                    run.reason = reason

    def conclude(self, run: ActiveMotion, ended: Ended) -> None:
        """Note how *run* ended, unless that is known."""
        with self._lock:
            self._runs.pop((run.device.name, run.number), None)
            if not run.ended.done():
                run.ended.set_result(ended)

    def _level(self, event: DeviceEvent) -> int:
        """Return how loudly to log an event: a start that fails again as before is said once."""
        if event.kind is EventKind.READY:
            self._died.pop(event.device, None)
        elif event.kind is EventKind.SERVO_DIED:
            last, self._died[event.device] = self._died.get(event.device), event.text
            if event.text == last:
                return logging.DEBUG
        return _LEVELS.get(event.kind, logging.INFO)

    def hear(self, event: DeviceEvent) -> None:
        """Note what a device reports; called from its own thread, or from within its start."""
        motion_id, name = self._identity_of(event)
        number = f" {titled(event.motion_number, name)}" if event.motion_number else ""
        ended = self._how(event)
        text = event.text if ended is None else ended[1]
        _log.log(
            self._level(event),
            "%s: %s%s%s",
            event.device,
            event.kind.value,
            number,
            f": {text}" if text else "",
            extra=about(
                device=event.device,
                event=event.kind.value,
                motion=event.motion_number,
                motion_id=motion_id,
                motion_name=name,
                outcome=ended[0].name.lower() if ended is not None else None,
            ),
        )
        if ended is not None:
            self._end(event, ended)

    def _identity_of(self, event: DeviceEvent) -> tuple[str, str]:
        """Return id and name of the motion of *event*; empty where there is none, or it tracks."""
        with self._lock:
            ids = self._ids.setdefault(event.device, {})
            if event.motion is not None:
                ids[event.motion_number] = event.motion.id, event.motion.facts.name
                while len(ids) > _KEPT_ENDS:
                    del ids[min(ids)]
            return ids.get(event.motion_number, ("", ""))

    def _how(self, event: DeviceEvent) -> Ended | None:
        """Return how the motion of *event* ended; ``None`` where it did not by that."""
        if event.kind is EventKind.MOTION_STOPPED:
            return self._why(event)
        outcome = _OUTCOMES.get(event.kind)
        return None if outcome is None else (outcome, event.text)

    def _why(self, event: DeviceEvent) -> Ended:
        snapshot = self._devices[event.device].snapshot()
        if snapshot.fault is not Fault.NONE:
            return Outcome.FAULT, snapshot.fault_text or event.text
        with self._lock:
            run = self._runs.get((event.device, event.motion_number))
            reason = (run.reason if run is not None else "") or self._reasons.get(event.device)
        if not reason or event.text == STOPPED:
            return Outcome.STOPPED, reason or event.text
        return Outcome.STOPPED, f"{event.text}: {reason}"

    def _end(self, event: DeviceEvent, ended: Ended) -> None:
        with self._lock:
            ends = self._ends.setdefault(event.device, {})
            ends[event.motion_number] = ended
            while len(ends) > _KEPT_ENDS:
                del ends[min(ends)]
            run = self._runs.get((event.device, event.motion_number))
        if run is not None:
            self.conclude(run, ended)
