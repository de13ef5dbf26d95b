"""The devices of a daemon, with the leases to command them and the plans for them.

Nothing here knows of gRPC.  Every method may be called from any thread.  Which threads do what is
said in :mod:`orientd.daemon.workers`.
"""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Collection, Iterable
from concurrent.futures import Future, wait
from functools import partial
from typing import TYPE_CHECKING

from orientd.client.stop_call import check_answered
from orientd.clock import Clock, MonotonicClock
from orientd.config import Settings
from orientd.daemon.device import Device, DeviceEvent
from orientd.daemon.leases import EXPIRED, Lease, Leases
from orientd.daemon.observe.flight_recorder import FlightRecorder
from orientd.daemon.observe.journal import EventLog, Journal
from orientd.daemon.planners.planned_motion import PlannedMotion
from orientd.daemon.planners.pool import Planners, default_processes
from orientd.daemon.workers import Threads
from orientd.errors import (
    GOING_DOWN,
    DaemonError,
    OrientdError,
    RequestError,
    UnknownNameError,
)
from orientd.one_line import one_line

if TYPE_CHECKING:
    from orientd.daemon.stops import StopFolder

KEPT_PLANS = 4
"""Plans kept for a later move; each takes as much memory as its request, and up to 14 MB more."""


class PlanStore:
    """Plans by their names, each for one device; the oldest make room for new ones."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._plans: OrderedDict[str, tuple[str, PlannedMotion]] = OrderedDict()

    def keep(self, device: str, motion: PlannedMotion) -> None:
        """Keep *motion*, planned for the device of that name."""
        with self._lock:
            self._plans[motion.id] = (device, motion)
            while len(self._plans) > KEPT_PLANS:
                self._plans.popitem(last=False)

    def find(self, device: str, motion_id: str) -> PlannedMotion:
        """Return a plan that was kept for the device of that name.

        Raises:
            UnknownNameError: there is none of that name, or no longer.
        """
        with self._lock:
            name, motion = self._plans.get(motion_id, ("", None))
        if motion is None or name != device:
            raise UnknownNameError(
                "motion_id", f"device {device!r} has no plan {motion_id!r}, plan it again"
            )
        return motion.again()


_log = logging.getLogger(__name__)

_READY_STEP = 0.1

MakeDevice = Callable[..., Device]
OnEvent = Callable[[DeviceEvent, Device], object]


class Devices:
    """Devices, lease and plans of a daemon."""

    def __init__(
        self,
        settings: Settings,
        *,
        make_device: MakeDevice = Device,
        planners: Planners | None = None,
        clock: Clock | None = None,
        stops: StopFolder | None = None,
        on_event: OnEvent = lambda _event, _device: None,
    ) -> None:
        """Make the devices of *settings*, without starting anything.

        Args:
            settings: what the daemon was configured with.
            make_device: makes a device of its settings, planners and an event handler.
            planners: plan for all of them; by default processes of their own.
            clock: tells when a lease has run out; the machine's monotonic clock by default.
            stops: where servos listen for stops that the daemon has no part in.
            on_event: called with every event and its device, from the device's thread.

        Raises:
            ConfigError: a device's driver is not there, or refuses its options.
        """
        self.leases = Leases(
            tuple(settings.devices),
            seconds=settings.daemon.lease_seconds,
            clock=clock or MonotonicClock(),
            lost=self._disown,
        )
        self.plans = PlanStore()
        self.is_closing = False
        self.configuration = settings.model_dump_json(exclude_none=True)
        self._on_event = on_event
        self.by_name: dict[str, Device] = {}
        self.journal = Journal(kept=settings.recorder.seconds)
        self._event_log = EventLog()
        self._flight = FlightRecorder(settings, self.journal, self.by_name)
        self.planners = planners or Planners(
            list(settings.devices.values()),
            processes=settings.planner.processes or default_processes(),
            timeout=settings.planner.plan_timeout,
        )
        for name, device in settings.devices.items():
            self.by_name[name] = make_device(
                device,
                planners=self.planners,
                on_event=self._publish,
                leases=self.leases,
                cycle_memory=self._flight.memory(name, device.rate_hz),
                stops=stops,
            )

    def _publish(self, event: DeviceEvent) -> None:
        self._on_event(event, self.by_name[event.device])
        self._event_log.on_event(event)
        self.journal.on_event(event)
        self._flight.on_event(event)

    def _disown(self, lease: Lease, devices: Collection[str], what: str) -> None:
        """Have the motions of a lost lease stopped, and return at once; see :meth:`stopped`.

        If the lease has expired, a device released for hand guiding holds again.
        """
        for name in devices:
            device = self.by_name[name]
            reason = f"the lease of {lease.who} {what}"
            disown = partial(device.disown, lease.token, reason)
            device.workers.stops.submit(_logged, disown, f"{name}: stop failed")
            if what == EXPIRED:
                problem = f"lease: cannot end hand guiding of {name}"
                device.workers.commands.submit(_logged, device.end_free, problem)

    async def stopped(self, names: Iterable[str]) -> None:
        """Wait until every stop that was asked for before has reached its device."""
        latest = [self.by_name[name].workers.stops.latest for name in names]
        stops = [asyncio.wrap_future(stop) for stop in latest if stop is not None]
        if stops:
            await asyncio.wait(stops)

    async def end_unowned(self, names: Iterable[str]) -> None:
        """End every motion of devices whose lease was lost, and wait for the servos' answers.

        A stop that had no answer before is repeated.

        Raises:
            DaemonError: a servo does not answer.
        """
        devices = [self.by_name[name] for name in names]
        stops = {one.name: one.workers.stops.submit(self._end_unowned, one) for one in devices}
        await asyncio.wait([asyncio.wrap_future(stop) for stop in stops.values()])
        silent = {name: str(error) for name, stop in stops.items() if (error := stop.result())}
        check_answered("stop", silent, [name for name in stops if name not in silent])

    def _end_unowned(self, device: Device) -> OrientdError | None:
        """End the motions of a device whose lease was lost; return the error if that fails."""
        for token in {queued.token for queued in device.unfinished() if queued.token}:
            try:
                if not self.leases.is_valid(token, device.name):
                    device.disown(token, "its lease was lost")
            except OrientdError as error:
                return error
        return None

    # Life

    def launch(self) -> None:
        """Start every device and return at once."""
        self._flight.start()
        for device in self.by_name.values():
            device.launch()

    def wait_ready(
        self, timeout: float, *, is_cancelled: Callable[[], bool] = lambda: False
    ) -> list[str]:
        """Wait until every device is ready or has failed; return the problems, if any.

        Args:
            timeout: longest wait, s.
            is_cancelled: returns whether the caller has given up.
        """
        deadline = time.monotonic() + timeout
        problems = []
        for device in self.by_name.values():
            while not (is_ready := device.wait_ready(_READY_STEP)):
                if device.failure or time.monotonic() > deadline or is_cancelled():
                    break
            if not is_ready:
                reason = device.failure or f"not ready after {timeout:g} s"
                problems.append(f"device {device.name}: {reason}")
        return problems

    def shutdown(self) -> None:
        """Stop every device on its path, let the motions end, and release everything."""
        self.is_closing = True
        living = [device for device in self.by_name.values() if not device.failure]
        wait(_stop(living, GOING_DOWN).values())
        unfinished = [
            run for device in self.by_name.values() for run in device.unfinished() if run.begun_ns
        ]
        # From a lower speed a stop may take longer than from full speed, but not than this.
        stops = [1.0 / run.motion.facts.brake_rate for run in unfinished if run.planned is not None]
        wait([run.ended for run in unfinished], timeout=max(stops, default=0.0) + 1.0)
        ending = Threads(len(self.by_name), "end")
        for end in [ending.submit(device.shutdown) for device in self.by_name.values()]:
            end.result()
        ending.close()
        self._flight.close()
        self.journal.close()

    def close(self) -> None:
        """End the threads of the devices, once their work is done; return at once."""
        for device in self.by_name.values():
            device.workers.close()

    # Motions

    def device(self, name: str) -> Device:
        """Return the device called *name*; the only one if the name is empty.

        Raises:
            UnknownNameError: there is none of that name.
            RequestError: there are several, and the name is empty.
        """
        names = ", ".join(self.by_name)
        if not name:
            if len(self.by_name) > 1:
                raise RequestError("device", f"expected one of {names}, got nothing")
            return next(iter(self.by_name.values()))
        if name not in self.by_name:
            raise UnknownNameError("device", f"expected one of {names}, got {name!r}")
        return self.by_name[name]

    def named(self, names: Iterable[str]) -> list[str]:
        """Return the names of devices that are called *names*; see :meth:`device`."""
        return [self.device(name).name for name in names]

    def present(self, device: Device, motion_id: str) -> PlannedMotion | None:
        """Return the motion that *device* runs or ran last, or the plan called *motion_id*.

        Raises:
            UnknownNameError: there is no motion or plan of that name, or no longer.
        """
        motion = device.snapshot().motion
        if not motion_id or (motion is not None and motion.id == motion_id):
            return motion
        return self.plans.find(device.name, motion_id)

    # Commands

    async def stop(
        self, name: str, caller: str, *, is_quickest: bool = False, motion: int = 0
    ) -> list[Device]:
        """Stop a device, or all of them at once if *name* is empty.  Needs no lease.

        A device that does not answer keeps no other one from stopping.  Once it is asked for, the
        stop takes place, whatever becomes of the caller.

        Args:
            name: of the device.
            caller: who stops.
            is_quickest: whether to leave the path where that is quicker.
            motion: the number of the only motion that is to end; 0 for whatever there is.

        Raises:
            UnknownNameError: there is no such device.
            DaemonError: a servo does not answer.
        """
        devices = [self.device(name)] if name else list(self.by_name.values())
        caller = one_line(caller, 200) or "somebody"
        reason = f"stopped by {caller}"
        stops = _stop(devices, reason, is_quickest=is_quickest, motion=motion)
        await asyncio.wait([asyncio.wrap_future(stop) for stop in stops.values()])
        failures = {
            name: error for name, stop in stops.items() if (error := stop.result()) is not None
        }
        silent = {name: str(e) for name, e in failures.items() if isinstance(e, DaemonError)}
        taken = [device.name for device in devices if device.name not in failures]
        check_answered("halt" if is_quickest else "stop", silent, taken)
        if failures:
            raise next(iter(failures.values()))
        return devices

    def check(self, token: str, device: Device, owner: str) -> Lease:
        """Return the lease of *token*, under which *owner* commands *device*.

        Raises:
            LeaseError: there is no such lease.
            DaemonError: the daemon is going down.
        """
        lease = self.leases.check(token, device.name, owner)
        if self.is_closing:
            raise DaemonError(GOING_DOWN)
        return lease


def _stop(
    devices: Iterable[Device], reason: str, *, is_quickest: bool = False, motion: int = 0
) -> dict[str, Future[OrientdError | None]]:
    """Have all *devices* stopped at once, or their motion *motion*; return what fails, by name."""

    def stop(device: Device) -> OrientdError | None:
        try:
            if not motion:
                device.stop(reason, is_quickest=is_quickest)
            elif (run := device.find(motion)) is not None:
                device.abandon(run, reason)
        except OrientdError as error:
            _log.warning("%s: stop failed: %s", device.name, error)
            return error
        return None

    return {device.name: device.workers.stops.submit(stop, device) for device in devices}


def _logged(act: Callable[[], object], problem: str) -> None:
    """Call *act* in a thread of a device; log a *problem* if it is refused."""
    try:
        act()
    except OrientdError as error:
        _log.warning("%s: %s", problem, error)
