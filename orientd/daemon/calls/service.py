"""The gRPC service ``orientd.v1.Control``: every call, straight down to the devices.

Nothing that plans, commands or waits for a device happens in the event loop.  A call that the
daemon refuses raises an :class:`~orientd.errors.OrientdError`.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import time
from collections import defaultdict
from collections.abc import AsyncIterator, Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from google.protobuf import message_factory
from grpclib.const import Cardinality

import orientd
from orientd.clock import clock_name
from orientd.daemon.access.authorization import Answer, Method
from orientd.daemon.access.identity import Caller
from orientd.daemon.calls import report
from orientd.daemon.calls.following import Following, read_targets
from orientd.daemon.calls.requests import (
    check_moving,
    interval,
    move_options,
    path_tolerance,
    planning_timeout,
    sample_rate,
)
from orientd.daemon.device import GONE, TICK, Device, QueuedMotion, servo_limits_of
from orientd.daemon.devices import Devices
from orientd.daemon.leases import Lease
from orientd.daemon.planners.messages import PlanRequest
from orientd.errors import (
    GOING_DOWN,
    DaemonError,
    LeaseError,
    OrientdError,
    RequestError,
    StateError,
)
from orientd.protocol import control_pb2 as pb
from orientd.protocol.limits import limits_to_wish
from orientd.protocol.values import embedded, field_number
from orientd.stream.records import CYCLE_RECORD, record_index

_log = logging.getLogger(__name__)

CONTROL = pb.DESCRIPTOR.services_by_name["Control"]

_CARDINALITIES = {(one.client_streaming, one.server_streaming): one for one in Cardinality}

_LOOKS = 10
"""How often to look again for the reason of a fault that the device's thread has not heard yet."""

_BATCH = 256
"""Cycles made into messages at a time: other calls get their turn before a watcher far behind."""

_RENEWALS = 3
"""Renewals within the time of a lease that a move has taken itself, until it has begun."""

_PLAN = field_number(pb.PlanResponse, "plan")
"""Of a GetPlanResponse, too."""

_STARTED = field_number(pb.MoveResponse, "started")
_PLAN_STARTED = field_number(pb.MoveStarted, "plan")

_EARLIER = "the client is of orientd 0.2 or earlier, and its motions cannot be read by orientd"

_CommandRequest = pb.CommandRequest | pb.SetSpeedRequest | pb.DisableRequest
"""A command names a device and its lease."""


class Service:
    """Serve the calls of the control socket."""

    def __init__(
        self, devices: Devices, *, keyframes: int, socket: Path, configuration: str, began: float
    ) -> None:
        """Serve *devices*.

        Args:
            devices: devices, leases and motions.
            keyframes: the most of one motion.
            socket: where the daemon listens.
            configuration: path of its configuration; empty for the built-in one.
            began: when it started, monotonic clock, s.
        """
        self.keyframes = keyframes
        self._devices, self._leases = devices, devices.leases
        self._socket, self._configuration, self._began = socket, configuration, began
        self._clock = clock_name()
        self._closing = asyncio.Event()
        self._turns: defaultdict[str, asyncio.Lock] = defaultdict(asyncio.Lock)

    def methods(self) -> Mapping[str, Method]:
        """Return every call by its full name."""
        return {
            f"/{CONTROL.full_name}/{one.name}": Method(
                one.name,
                getattr(self, one.name),
                message_factory.GetMessageClass(one.input_type),
                _CARDINALITIES[one.client_streaming, one.server_streaming],
            )
            for one in CONTROL.methods
        }

    def end_calls(self) -> None:
        """End every WatchState and WatchEvents call."""
        self._closing.set()

    def daemon_report(self) -> pb.DaemonReport:
        """Return the daemon itself as it is now."""
        leases = [
            pb.LeaseReport(
                holder=lease.holder,
                remaining=self._leases.remaining(lease),
                identity=lease.owner,
                devices=lease.devices,
            )
            for lease in self._leases.held()
        ]
        return pb.DaemonReport(
            version=orientd.__version__,
            pid=os.getpid(),
            uptime=time.monotonic() - self._began,
            socket=str(self._socket),
            configuration=self._configuration,
            leases=leases,
        )

    # Looking on

    async def GetState(self, request: pb.GetStateRequest, caller: Caller) -> pb.GetStateResponse:
        """Report on the daemon and its devices."""
        if request.device:
            return await self._state_of([self._devices.device(request.device)])
        return await self._state_of(self._devices.by_name.values())

    async def _state_of(self, devices: Iterable[Device]) -> pb.GetStateResponse:
        reports = [await _with_reason(device) for device in devices]
        answer = pb.GetStateResponse(daemon=self.daemon_report(), devices=reports)
        answer.monotonic_ns, answer.clock = time.monotonic_ns(), self._clock
        return answer

    async def WatchState(
        self, request: pb.WatchStateRequest, caller: Caller
    ) -> AsyncIterator[pb.WatchStateResponse]:
        """Report cycles until the caller goes."""
        device = self._devices.device(request.device)
        pause = interval("rate_hz", request.rate_hz)
        reader = report.CycleReader(device)
        step = max(1, request.decimation)
        wait = pause
        while not await self._ends_within(wait):
            wait = pause
            response = pb.WatchStateResponse()
            records, response.lost = reader.read_records(None if request.as_records else _BATCH)
            if request.as_records:
                response.records, response.layout = b"".join(records), CYCLE_RECORD.format
            else:
                wait = 0.0 if len(records) == _BATCH else pause
                response.cycles.extend(
                    report.record_message(one) for one in records if record_index(one) % step == 0
                )
            if request.with_outline:
                response.outline.extend(
                    pb.Polyline(coordinates=[x for point in line for x in point])
                    for line in device.outline()
                )
            elif not (response.records or response.cycles or response.lost):
                continue
            yield response

    async def WatchEvents(
        self, request: pb.WatchEventsRequest, caller: Caller
    ) -> AsyncIterator[pb.WatchEventsResponse]:
        """Report events until the caller goes."""
        device = self._devices.device(request.device).name if request.device else ""
        wake, loop = asyncio.Event(), asyncio.get_running_loop()
        subscription = self._devices.journal.subscribe(
            device, partial(loop.call_soon_threadsafe, wake.set)
        )
        ending = asyncio.ensure_future(self._closing.wait())
        try:
            yield pb.WatchEventsResponse()
            while not self._closing.is_set():
                waking = asyncio.ensure_future(wake.wait())
                await asyncio.wait((waking, ending), return_when=asyncio.FIRST_COMPLETED)
                waking.cancel()
                wake.clear()
                if not self._closing.is_set():
                    yield subscription.take()
        finally:
            ending.cancel()
            subscription.close()

    async def _ends_within(self, seconds: float) -> bool:
        """Wait *seconds*; return at once, and whether that is so, if the daemon ends."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._closing.wait()
        return self._closing.is_set()

    async def GetConfiguration(
        self, request: pb.GetConfigurationRequest, caller: Caller
    ) -> pb.GetConfigurationResponse:
        """Report the settings."""
        answer = pb.GetConfigurationResponse(json=self._devices.configuration)
        answer.monotonic_ns = time.monotonic_ns()
        answer.time.FromNanoseconds(time.time_ns())
        return answer

    async def ListMethods(self, request: pb.ListMethodsRequest, caller: Caller) -> bytes:
        """List the families of curves."""
        return await self._devices.planners.methods()

    async def ListDevices(
        self, request: pb.ListDevicesRequest, caller: Caller
    ) -> pb.ListDevicesResponse:
        """List the devices."""
        devices = self._devices.by_name.values()
        return pb.ListDevicesResponse(devices=[pb.Device(**report.described(d)) for d in devices])

    # Planning

    async def Plan(self, request: pb.PlanRequest, caller: Caller) -> bytes:
        """Plan a motion and keep it."""
        received_ns = time.monotonic_ns()
        with self._refused_after(received_ns):
            device = self._devices.device(request.device)
            rate_hz = sample_rate(request.sample_rate_hz, device)
            motion = await device.plan(self._asked(request, caller, rate_hz))
            self._devices.plans.keep(device.name, motion)
        took = pb.Plan(planning=_seconds_since(received_ns)).SerializeToString()
        return embedded(_PLAN, motion.plan + motion.samples + took)

    async def GetPlan(
        self, request: pb.GetPlanRequest, caller: Caller
    ) -> pb.GetPlanResponse | bytes:
        """Report the plan of a motion."""
        with self._refused_after():
            device = self._devices.device(request.device)
            rate_hz = sample_rate(request.sample_rate_hz, device)
            motion = self._devices.present(device, request.motion_id)
            if motion is None:
                return pb.GetPlanResponse()
            samples = b""
            if rate_hz:
                samples = await self._devices.planners.report(motion, caller.key, rate_hz)
            return embedded(_PLAN, motion.plan + samples)

    def _asked(
        self, request: pb.PlanRequest | pb.MoveRequest, caller: Caller, rate_hz: float = 0.0
    ) -> PlanRequest:
        """Return the motion to plan, its caller, and the planning timeout.

        Raises:
            RequestError: there is no motion, it is of an earlier version, or the time is none.
        """
        if request.earlier_motion:
            raise RequestError("motion", f"{_EARLIER} {orientd.__version__}; update the client")
        if not (request.motion or request.source):
            raise RequestError("motion", "expected the text of a motion file, got none")
        timeout = planning_timeout(request.plan_timeout, self._devices.planners.timeout)
        return PlanRequest(
            request.motion,
            request.source,
            request.columns,
            self.keyframes,
            caller.key,
            timeout,
            rate_hz,
        )

    @contextlib.contextmanager
    def _refused_after(self, received_ns: int = 0) -> Iterator[None]:
        """Note in a refusal how long it took; once the daemon ends, refuse because of that."""
        try:
            yield
        except OrientdError as error:
            if self._devices.is_closing:
                raise DaemonError(GOING_DOWN) from None
            if received_ns:
                error.planning = _seconds_since(received_ns)
            raise

    # Moving

    async def Move(
        self, request: pb.MoveRequest, caller: Caller
    ) -> AsyncIterator[pb.MoveResponse | Answer]:
        """Run a motion and report until it ends; a caller that goes away stops it."""
        received_ns = time.monotonic_ns()
        device = self._devices.device(request.device)
        run: QueuedMotion | None = None
        try:
            with self._refused_after(received_ns):
                pause = interval("progress_rate_hz", request.progress_rate_hz)
                with device.expecting(move_options(request)) as expected:
                    async with self._lease_for(request, device, caller) as lease:
                        waiting = await self._begin(expected, request, lease.token, device, caller)
                        taken = None if request.lease_token else self._lease_message(lease)
                run = expected
            timing = pb.MoveTiming(
                planning=(run.planned_ns - received_ns) * 1e-9,
                splicing=(run.begun_ns - run.planned_ns) * 1e-9,
                received_ns=received_ns,
                attempts=run.attempts,
                waiting=waiting,
            )
            yield _started(device, run, timing, taken)
            reader = report.ProgressReader(device, run)
            ended = asyncio.wrap_future(run.ended)
            while not (await asyncio.wait({ended}, timeout=pause))[0]:
                progress = reader.read()
                if progress is not None:
                    yield pb.MoveResponse(progress=progress)
            yield pb.MoveResponse(summary=report.summary(run, self._devices.by_name.values()))
        finally:
            self._abandon(device, run)

    async def _begin(
        self,
        run: QueuedMotion,
        request: pb.MoveRequest,
        token: str,
        device: Device,
        caller: Caller,
    ) -> float:
        """Begin the motion of *request*, planned now or before; return how long it waited, s."""
        what = request.WhichOneof("what")
        if what == "motion_id":
            motion = self._devices.plans.find(device.name, request.motion_id)
            await device.run(run, motion, token=token)
            return 0.0
        if what not in ("motion", "earlier_motion"):
            raise RequestError("motion", "expected a motion or a motion_id, got neither")
        asked = self._asked(request, caller)
        try:
            await device.move(run, asked, token=token)
        except OrientdError as error:
            error.waiting = sum(asked.waits)
            raise
        return sum(asked.waits)

    @contextlib.asynccontextmanager
    async def _lease_for(
        self, request: pb.MoveRequest, device: Device, caller: Caller
    ) -> AsyncIterator[Lease]:
        """Return the lease of a move: that of its token, or one that it takes itself.

        A lease that it takes lasts until the motion has begun, and for its full time from then on.
        If the motion does not begin, the lease ends.
        """
        if request.lease_token or not request.holder:
            yield self._devices.check(request.lease_token, device, caller.identity.key)
            return
        lease = await self._acquire(request.holder, [device.name], caller, beside=request.beside)
        renewing = asyncio.create_task(self._keep_renewing(lease))
        try:
            yield lease
        except BaseException:
            with contextlib.suppress(LeaseError):  # lost already
                self._leases.release(lease.token)
            raise
        finally:
            renewing.cancel()

    async def _keep_renewing(self, lease: Lease) -> None:
        with contextlib.suppress(LeaseError):  # lost: the move finds that out
            while True:
                await asyncio.sleep(self._leases.seconds / _RENEWALS)
                self._leases.renew(lease.token)

    def _abandon(self, device: Device, run: QueuedMotion | None) -> None:
        """Stop a motion whose caller has gone away; return at once."""
        if run is not None and not run.ended.done():
            device.workers.stops.submit(device.abandon, run, GONE)

    async def Track(
        self, request_iterator: AsyncIterator[pb.TrackRequest], caller: Caller
    ) -> AsyncIterator[pb.TrackResponse]:
        """Follow the caller's targets until there are no more."""
        run: QueuedMotion | None = None
        reading: asyncio.Task[None] | None = None
        first = await anext(request_iterator, None)
        if first is None or first.WhichOneof("what") != "start":
            raise RequestError("start", "expected as the first message")
        begin = first.start
        device = self._devices.device(begin.device)
        try:
            pause = interval("start.report_rate_hz", begin.report_rate_hz)
            limits = device.limits.narrowed(limits_to_wish(begin.limits))
            limits.check_range(1e-9 * device.period_ns)
            tolerance = path_tolerance(begin.path_tolerance)
            servo_limits = servo_limits_of(limits, brake_rate=1.0, path_tolerance=tolerance)
            self._devices.check(begin.lease_token, device, caller.identity.key)
            with device.expecting() as expected:
                track = partial(device.track, expected, servo_limits, token=begin.lease_token)
                await device.workers.commands.run(track)
            run = expected
            following = Following(device)
            reading = asyncio.create_task(read_targets(request_iterator, following))
            ended = asyncio.wrap_future(run.ended)
            waiting: set[asyncio.Future[Any]] = {ended, reading}
            while not ended.done():
                await asyncio.wait(waiting, timeout=pause)
                if reading in waiting and reading.done():
                    waiting.discard(reading)
                    text = "the targets have ended"
                    await device.workers.stops.run(device.abandon, run, text)
                now = following.report()
                if now is not None:
                    yield now
            outcome, text = run.ended.result(timeout=0)
            if outcome == pb.OUTCOME_FAULT:
                raise StateError(text)
            last = following.report() or pb.TrackResponse()
            last.ended = run.reason or text
            yield last
        finally:
            if reading is not None:
                reading.cancel()
            self._abandon(device, run)

    # Commands

    async def Stop(self, request: pb.StopRequest, caller: Caller) -> pb.StopResponse:
        """Stop devices on their paths."""
        who, motion = str(caller.identity), request.motion_number
        devices = await self._devices.stop(request.device, who, motion=motion)
        return pb.StopResponse(devices=map(report.device_report, devices))

    async def Halt(self, request: pb.StopRequest, caller: Caller) -> pb.StopResponse:
        """Stop devices as quickly as the limits allow."""
        who = str(caller.identity)
        devices = await self._devices.stop(request.device, who, is_quickest=True)
        return pb.StopResponse(devices=map(report.device_report, devices))

    async def Pause(self, request: pb.CommandRequest, caller: Caller) -> pb.CommandResponse:
        """Pause a motion."""
        return await self._command(request, caller, "pause", Device.pause, check=check_moving)

    async def Resume(self, request: pb.CommandRequest, caller: Caller) -> pb.CommandResponse:
        """Resume a paused motion."""
        return await self._command(request, caller, "resume", Device.resume, check=check_moving)

    async def SetSpeed(self, request: pb.SetSpeedRequest, caller: Caller) -> pb.CommandResponse:
        """Set the rate at which motions run."""
        speed = request.speed
        if not 0.0 < speed <= 1.0:
            raise RequestError("speed", f"expected more than 0 and at most 1, got {speed:g}")
        return await self._command(
            request, caller, f"speed {speed:g}", lambda device: device.set_speed(speed)
        )

    async def Enable(self, request: pb.CommandRequest, caller: Caller) -> pb.CommandResponse:
        """Make a device follow."""
        return await self._command(request, caller, "enable", Device.enable)

    async def Disable(self, request: pb.DisableRequest, caller: Caller) -> pb.CommandResponse:
        """Leave a device at rest, no longer following."""
        what = "disable, to be moved by hand" if request.by_hand else "disable"
        return await self._command(
            request, caller, what, lambda device: device.disable(is_freed=request.by_hand)
        )

    async def Reset(self, request: pb.CommandRequest, caller: Caller) -> pb.CommandResponse:
        """Clear a fault."""
        return await self._command(request, caller, "reset", Device.reset)

    async def _command(
        self,
        request: _CommandRequest,
        caller: Caller,
        what: str,
        act: Callable[[Device], object],
        *,
        check: Callable[[Device, str], object] = lambda _device, _what: None,
    ) -> pb.CommandResponse:
        """Run *act* in a thread once it is its turn, and return the device's state afterwards."""
        device = self._devices.device(request.device)
        async with self._turns[device.name]:
            lease = self._devices.check(request.lease_token, device, caller.identity.key)
            check(device, what)
            await device.workers.commands.run(act, device)
            _log.info("%s: %s by %s", device.name, what, lease.who)
            return pb.CommandResponse(device=report.device_report(device))

    # Leases

    async def AcquireLease(
        self, request: pb.AcquireLeaseRequest, caller: Caller
    ) -> pb.LeaseResponse:
        """Acquire the lease of devices that no other client holds."""
        devices = self._devices.named(request.devices)
        lease = await self._acquire(request.holder, devices, caller, beside=request.beside)
        return pb.LeaseResponse(lease=self._lease_message(lease))

    async def _acquire(
        self, holder: str, devices: Sequence[str], caller: Caller, *, beside: bool
    ) -> Lease:
        who = caller.identity
        lease = self._leases.acquire(holder, who.key, name=who.name, devices=devices, beside=beside)
        # If the previous lease has expired, its motion is stopped first.
        await self._devices.stopped(lease.devices)
        return lease

    async def RenewLease(self, request: pb.RenewLeaseRequest, caller: Caller) -> pb.LeaseResponse:
        """Hold the lease for its full time again."""
        lease = self._leases.renew(request.token, caller.identity.key)
        return pb.LeaseResponse(lease=self._lease_message(lease))

    async def ReleaseLease(
        self, request: pb.ReleaseLeaseRequest, caller: Caller
    ) -> pb.ReleaseLeaseResponse:
        """Give the lease back; it is released even if a servo does not answer the stop."""
        lease = self._leases.release(request.token, caller.identity.key)
        await self._devices.end_unowned(lease.devices)
        return pb.ReleaseLeaseResponse()

    async def SeizeLease(self, request: pb.SeizeLeaseRequest, caller: Caller) -> pb.LeaseResponse:
        """Take the lease, even if another client holds it.

        If a servo does not answer the stop of the earlier holder's motion, no client has the lease.
        """
        who, devices = caller.identity, self._devices.named(request.devices)
        lease = self._leases.seize(
            request.holder, who.key, request.reason, name=who.name, devices=devices
        )
        try:
            await self._devices.end_unowned(lease.devices)
        except BaseException:
            with contextlib.suppress(LeaseError):  # lost already
                self._leases.release(lease.token)
            raise
        return pb.LeaseResponse(lease=self._lease_message(lease))

    def _lease_message(self, lease: Lease) -> pb.Lease:
        return pb.Lease(
            token=lease.token,
            holder=lease.holder,
            seconds=self._leases.remaining(lease),
            devices=lease.devices,
        )


async def _with_reason(device: Device) -> pb.DeviceReport:
    """Return the report of a device now; if it is in a fault, with the reason.

    The device's thread reads the reason only after its current work.  That takes a while if the
    daemon itself was suspended.
    """
    now = report.device_report(device)
    for _ in range(_LOOKS):
        if now.state != pb.STATE_FAULT or now.fault_text:
            break
        await asyncio.sleep(TICK)
        now = report.device_report(device)
    return now


def _started(
    device: Device, run: QueuedMotion, timing: pb.MoveTiming, lease: pb.Lease | None
) -> Answer:
    """Return the first answer to a move, with the plan as the planner made it."""
    number, speed = run.number, device.snapshot().speed
    started = pb.MoveStarted(motion_number=number, timing=timing, speed=speed, lease=lease)
    plan = embedded(_PLAN_STARTED, run.motion.plan)
    content = embedded(_STARTED, started.SerializeToString() + plan)
    named = pb.Plan(motion_id=run.motion.id, name=run.motion.facts.name)
    noted = pb.MoveResponse(started=pb.MoveStarted(motion_number=number, plan=named))
    return Answer(content, noted)


def _seconds_since(instant_ns: int) -> float:
    return (time.monotonic_ns() - instant_ns) * 1e-9
