"""The cell: the devices of one daemon, the lease to command them, and the motions they run.

Nothing here knows of gRPC.  Every method may be called from any thread; those that plan or command
may take as long as planning and the device do, and belong into a worker thread.
"""

from __future__ import annotations

import logging
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from typing import Any

from orientd import motion_file, planner
from orientd.clock import Clock, MonotonicClock
from orientd.config import DeviceSettings, Settings
from orientd.daemon.device import Device, DeviceEvent, EventKind
from orientd.daemon.lease import Lease, LeaseDesk
from orientd.errors import (
    DaemonError,
    OrientdError,
    RequestError,
    StartError,
    StateError,
    UnknownNameError,
)
from orientd.planner import Motion
from orientd.rotation import angle
from orientd.rpc.reports import Outcome
from orientd.stream import State

_log = logging.getLogger(__name__)

KEPT_PLANS = 4
"""Plans kept for a later move; a plan of 100,000 keyframes takes some tens of MiB."""

START_TOLERANCE = 1e-6
"""How far from where the device is commanded to be a kept plan may begin, rad and m."""

MakeDevice = Callable[..., Device]
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


class Cell:
    """Devices, lease and plans of a daemon."""

    def __init__(
        self,
        settings: Settings,
        *,
        make_device: MakeDevice = Device,
        clock: Clock | None = None,
    ) -> None:
        """Make the devices of *settings*, without starting anything.

        Args:
            settings: what the daemon was configured with.
            make_device: makes a device of its settings and an event handler.
            clock: tells when a lease has run out; the machine's monotonic clock by default.

        Raises:
            ConfigError: a device's driver is not there, or refuses its options.
        """
        self.desk = LeaseDesk(
            seconds=settings.daemon.lease_seconds, clock=clock or MonotonicClock()
        )
        self._lock = threading.Lock()
        self._runs: dict[str, Run] = {}
        self._ends: dict[str, tuple[int, Ended]] = {}
        self._stops: dict[str, int] = {}
        self._reasons: dict[str, str] = {}
        self._plans: OrderedDict[str, tuple[str, Motion]] = OrderedDict()
        self._is_closing = False
        self.devices: Mapping[str, Device] = {
            name: self._make(make_device, device) for name, device in settings.devices.items()
        }

    def _make(self, make_device: MakeDevice, settings: DeviceSettings) -> Device:
        return make_device(settings, on_event=self._hear)

    # Life

    def launch(self) -> None:
        """Start every device and return at once."""
        for device in self.devices.values():
            device.launch()

    def wait_ready(self, timeout: float) -> list[str]:
        """Wait until every device is ready or has failed; return what is wrong, if anything."""
        with ThreadPoolExecutor(len(self.devices)) as pool:
            answers = pool.map(lambda device: device.wait_ready(timeout), self.devices.values())
            are_ready = dict(zip(self.devices.values(), answers, strict=True))
        return [
            f"device {device.name}: {device.failure or f'not ready after {timeout:g} s'}"
            for device, is_ready in are_ready.items()
            if not is_ready
        ]

    def shutdown(self, reason: str) -> None:
        """Stop every device on its path, let the motions end, and release everything."""
        with self._lock:
            self._is_closing = True
        self._halt(self.devices.values(), reason)
        with self._lock:
            runs = [run for run in self._runs.values() if not run.ended.done()]
        for run in runs:
            wait([run.ended], timeout=run.motion.certificate.stop_time + 1.0)
        with ThreadPoolExecutor(len(self.devices)) as pool:
            list(pool.map(lambda device: device.shutdown(), self.devices.values()))
        for run in runs:
            self._conclude(run, (Outcome.STOPPED, reason))

    # The lease

    def acquire(self, holder: str) -> Lease:
        """Give the lease to *holder*.

        Raises:
            RequestError: the holder has no name.
            LeaseError: somebody else holds it.
        """
        holder = " ".join(holder.split())[:200]
        if not holder:
            raise RequestError("holder", "expected a name to tell others, got nothing")
        self.expire()
        lease = self.desk.acquire(holder)
        _log.info("lease: acquired by %r", holder)
        return lease

    def release(self, token: str) -> None:
        """Take the lease back; a motion that was started with it stops.

        Raises:
            LeaseError: it is not held with *token*.
        """
        lease = self.desk.release(token)
        _log.info("lease: released by %r", lease.holder)
        self._disown(lease, "was released")

    def expire(self) -> None:
        """Take the lease back if it has run out; a motion that was started with it stops."""
        lease = self.desk.collect_expired()
        if lease is not None:
            _log.warning("lease: that of %r has expired", lease.holder)
            self._disown(lease, "has expired")

    def _disown(self, lease: Lease, what: str) -> None:
        with self._lock:
            owned = [
                run.device
                for run in self._runs.values()
                if run.token == lease.token and not run.ended.done()
            ]
        self._halt(owned, f"the lease of {lease.holder!r} {what}")

    # Motions

    def device(self, name: str) -> Device:
        """Return the device called *name*; the only one if the name is empty.

        Raises:
            UnknownNameError: there is none of that name.
            RequestError: there are several, and the name is empty.
        """
        names = ", ".join(self.devices)
        if not name:
            if len(self.devices) > 1:
                raise RequestError("device", f"expected one of {names}, got nothing")
            return next(iter(self.devices.values()))
        if name not in self.devices:
            raise UnknownNameError("device", f"expected one of {names}, got {name!r}")
        return self.devices[name]

    def plan(self, device: Device, mapping: Mapping[str, Any], *, keep: bool = False) -> Motion:
        """Plan what *mapping*, the content of a motion file, asks of *device*.

        It begins where the device is commanded to be; a plan that is kept for later, where the
        device will be once its present motion has ended.

        Args:
            device: what is to move.
            mapping: see :mod:`orientd.motion_file`.
            keep: whether the plan will be asked for again by its name.

        Raises:
            RequestError: it is not well formed.
            StateError: the device is not at rest, ready to move.
            PlanError: it cannot be planned, or would break a limit.
        """
        request = motion_file.parse(mapping)
        start = device.next_start() if keep else device.commanded()
        period = device.period_ns * 1e-9
        motion = planner.plan(request, start=start, limits=device.limits, period=period)
        device.examine(motion)
        if keep:
            with self._lock:
                self._plans[motion.id] = (device.name, motion)
                while len(self._plans) > KEPT_PLANS:
                    self._plans.popitem(last=False)
        return motion

    def kept(self, device: Device, motion_id: str) -> Motion:
        """Return a plan that was kept for *device*.

        Raises:
            UnknownNameError: there is none of that name, or no longer.
        """
        with self._lock:
            name, motion = self._plans.get(motion_id, ("", None))
        if motion is None or name != device.name:
            raise UnknownNameError(
                "motion_id", f"device {device.name!r} has no plan {motion_id!r}, plan it again"
            )
        return motion

    def stops(self, device: Device) -> int:
        """Return how often *device* was told to stop, to give to :meth:`start` later on."""
        with self._lock:
            return self._stops.get(device.name, 0)

    def start(self, token: str, device: Device, motion: Motion, *, stops: int) -> Run:
        """Begin to run *motion*.

        Args:
            token: the lease.
            device: what is to move.
            motion: planned for it.
            stops: what :meth:`stops` returned before the motion was planned: whoever stopped the
                device since then stopped this motion too.

        Raises:
            LeaseError: *token* is not that of the lease.
            StateError: the device is not at rest, ready to move, or was stopped meanwhile.
            StartError: the motion does not begin where the device is commanded to be.
        """
        lease = self.desk.check(token)
        self._check_start(device, motion)
        with self._lock:
            if self._is_closing:
                raise DaemonError("the daemon is going down")
            if self._stops.get(device.name, 0) != stops:
                reason = self._reasons.get(device.name, "stopped")
                raise StateError(f"device {device.name!r} was stopped before it began: {reason}")
            self._reasons.pop(device.name, None)
        number = device.start(motion)
        run = Run(device, number, motion, token)
        with self._lock:
            self._runs[device.name] = run
            ended = self._ends.get(device.name, (0, None))
            is_stopped = self._stops.get(device.name, 0) != stops
        owner = self.desk.current()
        if ended[0] == number and ended[1] is not None:
            self._conclude(run, ended[1])
        elif is_stopped or owner is None or owner.token != token:
            # Told to stop, or disowned, between the checks above and the start.
            device.stop()
        _log.info("%s: motion %d is commanded by %r", device.name, number, lease.holder)
        return run

    def _check_start(self, device: Device, motion: Motion) -> None:
        here, begin = device.commanded(), motion.start_state
        turn = float(angle(here.q, begin.q))
        if turn > START_TOLERANCE:
            raise StartError(
                f"the motion begins {turn:.6g} rad from where device {device.name!r} is commanded "
                f"to be; plan it again"
            )
        away = float(abs(here.position - begin.position).max())
        if away > START_TOLERANCE:
            raise StartError(
                f"the motion begins {away:.6g} m from where device {device.name!r} is commanded "
                f"to be; plan it again"
            )

    def abandon(self, run: Run, reason: str) -> None:
        """Stop *run* on its path, unless it has ended."""
        if not run.ended.done():
            self._halt([run.device], reason)

    # Commands

    def stop(self, name: str, caller: str) -> list[Device]:
        """Stop a device, or all of them if *name* is empty, on its path.  Needs no lease.

        Raises:
            UnknownNameError: there is no such device.
            DaemonError: a servo does not answer.
        """
        devices = [self.device(name)] if name else list(self.devices.values())
        caller = " ".join(caller.split())[:200] or "somebody"
        failures = self._halt(devices, f"stopped by {caller}")
        if failures:
            raise failures[0]
        return devices

    def command(self, token: str, name: str, what: str, act: Callable[[Device], None]) -> Device:
        """Have something done to a device by whoever holds the lease.

        Args:
            token: the lease.
            name: of the device.
            what: is done, for the log.
            act: does it.

        Raises:
            LeaseError: *token* is not that of the lease.
            UnknownNameError: there is no such device.
            StateError: the device's state does not allow it.
            DaemonError: the servo does not answer.
        """
        device = self.device(name)
        lease = self.desk.check(token)
        with self._lock:
            if self._is_closing:
                raise DaemonError("the daemon is going down")
        act(device)
        _log.info("%s: %s by %r", device.name, what, lease.holder)
        return device

    def _halt(self, devices: Iterable[Device], reason: str) -> list[OrientdError]:
        """Stop *devices*, all of them even where one fails, and return the failures."""
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

    # Events

    def _hear(self, event: DeviceEvent) -> None:
        """Note what a device reports; called from the device's own thread, or within its start."""
        level = logging.INFO
        if event.kind in (EventKind.FAULT, EventKind.SERVO_DIED):
            level = logging.ERROR
        number = f" {event.motion_number}" if event.motion_number else ""
        about = f"{event.kind.value}{number}"
        if event.kind is EventKind.MOTION_DONE:
            self._end(event, (Outcome.DONE, ""))
        elif event.kind is EventKind.MOTION_STOPPED:
            ended = self._why(event)
            self._end(event, ended)
            _log.log(level, "%s: %s: %s", event.device, about, ended[1])
            return
        _log.log(level, "%s: %s%s", event.device, about, f": {event.text}" if event.text else "")

    def _why(self, event: DeviceEvent) -> Ended:
        snapshot = self.devices[event.device].snapshot()
        if snapshot.state is State.FAULT:
            return Outcome.FAULT, snapshot.fault_text or event.text
        with self._lock:
            return Outcome.STOPPED, self._reasons.get(event.device, event.text)

    def _end(self, event: DeviceEvent, ended: Ended) -> None:
        with self._lock:
            self._ends[event.device] = (event.motion_number, ended)
            run = self._runs.get(event.device)
        if run is not None and run.number == event.motion_number:
            self._conclude(run, ended)

    def _conclude(self, run: Run, ended: Ended) -> None:
        with self._lock:
            if not run.ended.done():
                run.ended.set_result(ended)
