"""The gRPC service ``orientd.v1.Control`` in front of a cell: messages in, messages out.

Nothing that plans, commands or waits for a device happens in the event loop.
"""

from __future__ import annotations

import asyncio
import logging
import math
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, NoReturn, Protocol, TypeVar

import grpc

from orientd.daemon import report
from orientd.daemon.access.identity import Identity, caller_key
from orientd.daemon.cell import Cell, pause, resume
from orientd.daemon.device import Device
from orientd.daemon.following import Following
from orientd.daemon.lease import Lease
from orientd.daemon.manner import Gate, Manner
from orientd.daemon.planners import Planners
from orientd.daemon.runs import Run
from orientd.errors import DaemonError, OrientdError, RequestError, StateError
from orientd.rpc import control_pb2 as pb
from orientd.rpc.control_pb2_grpc import ControlServicer
from orientd.rpc.motion_wire import limits_to_wish, to_mapping
from orientd.rpc.reports import DaemonReport, MoveTiming, Outcome
from orientd.rpc.state_wire import (
    cycle_to_message,
    daemon_to_message,
    device_to_message,
    limits_to_message,
    method_to_message,
    outline_to_messages,
)
from orientd.rpc.status import DETAILS_KEY, to_status
from orientd.rpc.track_wire import report_to_message
from orientd.stream import UNKNOWN
from orientd.stream.records import CYCLE_RECORD

if TYPE_CHECKING:
    from orientd.planner import Motion

_log = logging.getLogger(__name__)

DEFAULT_REPORTS_HZ = 20.0
SLOWEST_REPORTS_HZ = 0.1
FASTEST_REPORTS_HZ = 100.0

PLANNERS = 2
"""Motions planned at the same time."""

COMMANDERS = 8
"""Commands under way at the same time; a device may take its time over one."""

MOST_SAMPLES = 300_000
"""In the answer to one Plan; each takes some 170 bytes of a message."""

SETTLING_TIMEOUT = 5.0
"""How long a device may take to be on target after the last setpoint, by default, s."""

LONGEST_WAIT = 3600.0
"""How far ahead a start time may be, s."""

_GONE = "its caller has gone away"

Result = TypeVar("Result")
Context = grpc.aio.ServicerContext[Any, Any]


class _CommandRequest(Protocol):
    """What every command to a device says."""

    @property
    def lease_token(self) -> str: ...

    @property
    def device(self) -> str: ...


class ControlService(ControlServicer):
    """What the control socket offers."""

    def __init__(
        self,
        cell: Cell,
        describe: Callable[[], DaemonReport],
        *,
        who: Callable[[str], Identity],
    ) -> None:
        """Serve *cell*.

        Args:
            cell: devices, lease and motions.
            describe: says what there is to say about the daemon itself.
            who: returns who is called by a name and may command.
        """
        self._cell = cell
        self._who = who
        self._describe = describe
        self._planners = Planners(PLANNERS)
        self._commanders = ThreadPoolExecutor(COMMANDERS, thread_name_prefix="command")
        self._closing = asyncio.Event()

    def end_calls(self) -> None:
        """Let every WatchState come to its end, and every call that waits for a plan."""
        self._closing.set()

    def close(self) -> None:
        """Take on no more work."""
        self._commanders.shutdown(wait=False, cancel_futures=True)

    # What there is

    async def GetState(self, request: pb.GetStateRequest, context: Context) -> pb.GetStateResponse:
        """Report on the daemon and its devices."""
        try:
            devices = (
                [self._cell.device(request.device)]
                if request.device
                else self._cell.devices.values()
            )
        except OrientdError as error:
            await _refuse(context, error)
        return pb.GetStateResponse(
            daemon=daemon_to_message(self._describe()),
            devices=[_device_message(device) for device in devices],
        )

    async def WatchState(
        self, request: pb.WatchStateRequest, context: Context
    ) -> AsyncIterator[pb.WatchStateResponse]:
        """Report cycles until the caller goes."""
        try:
            device = self._cell.device(request.device)
            interval = _interval("rate_hz", request.rate_hz)
        except OrientdError as error:
            await _refuse(context, error)
        reader = report.CycleReader(device)
        step = max(1, request.decimation)
        while not await self._is_closing_within(interval):
            response = pb.WatchStateResponse()
            if request.as_records:
                records, response.lost = reader.read_records()
                response.records, response.layout = b"".join(records), CYCLE_RECORD.format
            else:
                cycles, response.lost = reader.read()
                response.cycles.extend(
                    cycle_to_message(cycle) for cycle in cycles if cycle.index % step == 0
                )
            if not (response.records or response.cycles or response.lost):
                continue
            if request.with_outline:
                response.outline.extend(outline_to_messages(device.outline()))
            yield response

    async def WatchEvents(
        self, request: pb.WatchEventsRequest, context: Context
    ) -> AsyncIterator[pb.WatchEventsResponse]:
        """Report events until the caller goes."""
        try:
            device = self._cell.device(request.device).name if request.device else ""
        except OrientdError as error:
            await _refuse(context, error)
        loop, wake = asyncio.get_running_loop(), asyncio.Event()
        subscription = self._cell.journal.subscribe(
            device, lambda: loop.call_soon_threadsafe(wake.set)
        )
        try:
            yield pb.WatchEventsResponse()
            while await self._is_woken(wake):
                events, lost = subscription.take()
                yield pb.WatchEventsResponse(
                    events=[pb.Event.FromString(event) for event in events], lost=lost
                )
        finally:
            subscription.close()

    async def GetConfiguration(
        self, request: pb.GetConfigurationRequest, context: Context
    ) -> pb.GetConfigurationResponse:
        """Report the settings."""
        del request, context
        answer = pb.GetConfigurationResponse(json=self._cell.configuration)
        answer.monotonic_ns = time.monotonic_ns()
        answer.time.FromNanoseconds(time.time_ns())
        return answer

    async def ListMethods(
        self, request: pb.ListMethodsRequest, context: Context
    ) -> pb.ListMethodsResponse:
        """List the families of curves."""
        del request, context
        return pb.ListMethodsResponse(methods=[method_to_message(m) for m in report.methods()])

    async def ListDevices(
        self, request: pb.ListDevicesRequest, context: Context
    ) -> pb.ListDevicesResponse:
        """List the devices."""
        del request, context
        return pb.ListDevicesResponse(
            devices=[
                pb.Device(
                    name=device.name,
                    driver=device.driver,
                    rate_hz=device.rate_hz,
                    limits=limits_to_message(device.limits),
                    lead=device.lead,
                )
                for device in self._cell.devices.values()
            ]
        )

    # Motions

    async def Plan(self, request: pb.PlanRequest, context: Context) -> pb.PlanResponse:
        """Plan a motion and keep it."""

        def work() -> pb.PlanResponse:
            device = self._cell.device(request.device)
            rate_hz = _sample_rate(request.sample_rate_hz, device)
            motion = self._cell.plan(device, to_mapping(request.motion))
            plan, samples = _planned_messages(motion, rate_hz)
            return pb.PlanResponse(plan=plan, samples=samples)

        try:
            return await self._planned(self._planners.submit(work))
        except OrientdError as error:
            await _refuse(context, error)

    async def GetPlan(self, request: pb.GetPlanRequest, context: Context) -> pb.GetPlanResponse:
        """Report the plan of a motion."""

        def work() -> pb.GetPlanResponse:
            device = self._cell.device(request.device)
            rate_hz = _sample_rate(request.sample_rate_hz, device)
            motion = self._cell.present(device, request.motion_id)
            if motion is None:
                return pb.GetPlanResponse()
            plan, samples = _planned_messages(motion, rate_hz)
            return pb.GetPlanResponse(plan=plan, samples=samples)

        return await self._do(context, work)

    async def Move(
        self, request: pb.MoveRequest, context: Context
    ) -> AsyncIterator[pb.MoveResponse]:
        """Run a motion and report until it ends; a caller that goes away stops it."""
        run: Run | None = None
        received_ns = time.monotonic_ns()
        try:
            interval = _interval("progress_rate_hz", request.progress_rate_hz)
            device = self._cell.device(request.device)
            self._cell.desk.check(request.lease_token)
            manner = self._manner(request)
            stops = self._cell.runs.stops(device)
            run, timing = await self._begun(
                lambda: self._start(device, request, manner, stops, received_ns)
            )
            yield await self._in_worker(lambda: _started(run, timing))
            reader = report.ProgressReader(run)
            ended = asyncio.wrap_future(run.ended)
            while not (await asyncio.wait({ended}, timeout=interval))[0]:
                progress = _progress(reader)
                if progress is not None:
                    yield pb.MoveResponse(progress=progress)
            yield await self._in_worker(lambda: self._summary(run))
        except OrientdError as error:
            await _refuse(context, error)
        finally:
            if run is not None and not run.ended.done():
                self._commanders.submit(self._cell.abandon, run, _GONE)

    def _start(
        self,
        device: Device,
        request: pb.MoveRequest,
        manner: Manner,
        stops: int,
        received_ns: int,
    ) -> tuple[Run, MoveTiming]:
        """Plan and begin a motion; called where planning may take its time."""
        token, what = request.lease_token, request.WhichOneof("what")
        if what == "motion":
            return self._cell.move(
                token,
                device,
                to_mapping(request.motion),
                manner,
                stops=stops,
                received_ns=received_ns,
            )
        if what == "motion_id":
            motion = self._cell.kept(device, request.motion_id)
            planned_ns = time.monotonic_ns()
            run = self._cell.start(token, device, motion, manner, stops=stops)
            return run, _timing(received_ns, planned_ns, attempts=0)
        raise RequestError("motion", "expected a motion or a motion_id, got neither")

    async def _begun(self, work: Callable[[], tuple[Run, MoveTiming]]) -> tuple[Run, MoveTiming]:
        """Do *work*, which begins a motion; if the caller goes away meanwhile, stop it again."""
        beginning = self._planners.submit(work)
        try:
            return await self._planned(beginning)
        except (asyncio.CancelledError, DaemonError):
            beginning.add_done_callback(self._abandon)
            raise

    def _abandon(self, beginning: Future[tuple[Run, MoveTiming]]) -> None:
        """Stop what was begun for a caller who has gone away meanwhile."""
        if not beginning.cancelled() and beginning.exception() is None:
            self._commanders.submit(self._cell.abandon, beginning.result()[0], _GONE)

    def _manner(self, request: pb.MoveRequest) -> Manner:
        """Return how the motion of *request* is to begin and to end.

        Raises:
            RequestError: that is not well formed.
        """
        gate = None
        if request.HasField("on_target"):
            wish = request.on_target
            timeout = wish.timeout or SETTLING_TIMEOUT
            gate = Gate(wish.tolerance, wish.rate, wish.settle_time, timeout)
        blend = request.blend_tolerance
        if not 0.0 <= blend < math.pi:
            raise RequestError("blend_tolerance", f"expected 0 to pi rad, got {blend!r}")
        if blend and not request.queue:
            raise RequestError("blend_tolerance", "expected with queue only")
        start_ns = UNKNOWN
        if request.HasField("start_time"):
            if request.queue:
                raise RequestError("start_time", "expected without queue only")
            try:
                wanted_ns = request.start_time.ToNanoseconds()
            except ValueError as error:
                raise RequestError("start_time", f"expected a time: {error}") from error
            ahead = wanted_ns - time.time_ns()
            if not 0 < ahead <= LONGEST_WAIT * 1e9:
                raise RequestError(
                    "start_time",
                    f"expected up to {LONGEST_WAIT:g} s ahead of now, got {ahead * 1e-9:.6g} s",
                )
            start_ns = self._cell.instant(wanted_ns)
        return Manner(is_queued=request.queue, blend=blend, start_ns=start_ns, gate=gate)

    def _summary(self, run: Run) -> pb.MoveResponse:
        from orientd.daemon import motion_report
        from orientd.rpc.move_wire import summary_to_message

        summary = motion_report.summary(run, self._cell.runs)
        return pb.MoveResponse(summary=summary_to_message(summary))

    # Targets

    async def Track(
        self, request_iterator: AsyncIterator[pb.TrackRequest], context: Context
    ) -> AsyncIterator[pb.TrackResponse]:
        """Follow the caller's targets until there are no more."""
        run: Run | None = None
        reading: asyncio.Task[None] | None = None
        try:
            begin = await _first(request_iterator)
            interval = _interval("start.report_rate_hz", begin.report_rate_hz)
            device = self._cell.device(begin.device)
            limits = limits_to_wish(begin.limits)
            stops = self._cell.runs.stops(device)
            run = await self._in_worker(
                lambda: self._cell.track(begin.lease_token, device, limits, stops=stops)
            )
            following = Following(device)
            reading = asyncio.ensure_future(_read_targets(request_iterator, following))
            ended = asyncio.wrap_future(run.ended)
            waiting: set[asyncio.Future[Any]] = {ended, reading}
            while not ended.done():
                await asyncio.wait(waiting, timeout=interval)
                if reading in waiting and reading.done():
                    waiting.discard(reading)
                    await self._in_worker(lambda: self._cell.abandon(run, "the targets have ended"))
                now = following.report()
                if now is not None:
                    yield report_to_message(now)
            outcome, text = run.ended.result(timeout=0)
            if outcome is Outcome.FAULT:
                raise StateError(text)
        except OrientdError as error:
            await _refuse(context, error)
        finally:
            if reading is not None:
                reading.cancel()
            if run is not None and not run.ended.done():
                self._commanders.submit(self._cell.abandon, run, _GONE)

    # Commands

    async def Stop(self, request: pb.StopRequest, context: Context) -> pb.StopResponse:
        """Stop devices on their paths."""

        def work() -> pb.StopResponse:
            devices = self._cell.stop(request.device, request.caller)
            return pb.StopResponse(devices=[_device_message(device) for device in devices])

        return await self._do(context, work)

    async def Halt(self, request: pb.HaltRequest, context: Context) -> pb.HaltResponse:
        """Stop devices as quickly as the limits allow."""

        def work() -> pb.HaltResponse:
            devices = self._cell.stop(request.device, request.caller, is_quickest=True)
            return pb.HaltResponse(devices=[_device_message(device) for device in devices])

        return await self._do(context, work)

    async def Pause(self, request: pb.PauseRequest, context: Context) -> pb.PauseResponse:
        """Pause a motion."""
        device = await self._command(context, request, "pause", pause)
        return pb.PauseResponse(device=device)

    async def Resume(self, request: pb.ResumeRequest, context: Context) -> pb.ResumeResponse:
        """Go on with a paused motion."""
        device = await self._command(context, request, "resume", resume)
        return pb.ResumeResponse(device=device)

    async def SetSpeed(self, request: pb.SetSpeedRequest, context: Context) -> pb.SetSpeedResponse:
        """Set the rate at which motions run."""
        speed = request.speed
        if not 0.0 < speed <= 1.0:
            problem = f"expected more than 0 and at most 1, got {speed:g}"
            await _refuse(context, RequestError("speed", problem))
        device = await self._command(
            context, request, f"speed {speed:g}", lambda device: device.set_speed(speed)
        )
        return pb.SetSpeedResponse(device=device)

    async def Enable(self, request: pb.EnableRequest, context: Context) -> pb.EnableResponse:
        """Make a device follow."""
        device = await self._command(context, request, "enable", lambda device: device.enable())
        return pb.EnableResponse(device=device)

    async def Disable(self, request: pb.DisableRequest, context: Context) -> pb.DisableResponse:
        """Leave a device at rest, no longer following."""
        device = await self._command(context, request, "disable", lambda device: device.disable())
        return pb.DisableResponse(device=device)

    async def Reset(self, request: pb.ResetRequest, context: Context) -> pb.ResetResponse:
        """Clear a fault."""
        device = await self._command(context, request, "reset", lambda device: device.reset())
        return pb.ResetResponse(device=device)

    # The lease

    async def AcquireLease(
        self, request: pb.AcquireLeaseRequest, context: Context
    ) -> pb.AcquireLeaseResponse:
        """Take the lease if it is free."""
        owner = caller_key()
        lease = await self._do(context, lambda: self._cell.acquire(request.holder, owner))
        return pb.AcquireLeaseResponse(lease=self._lease_message(lease))

    async def RenewLease(
        self, request: pb.RenewLeaseRequest, context: Context
    ) -> pb.RenewLeaseResponse:
        """Hold the lease for its full time again."""
        try:
            # At once and not in a worker, which might be busy until the lease has run out.
            lease = self._cell.desk.renew(request.token)
        except OrientdError as error:
            await _refuse(context, error)
        return pb.RenewLeaseResponse(lease=self._lease_message(lease))

    async def ReleaseLease(
        self, request: pb.ReleaseLeaseRequest, context: Context
    ) -> pb.ReleaseLeaseResponse:
        """Give the lease back."""
        await self._do(context, lambda: self._cell.release(request.token))
        return pb.ReleaseLeaseResponse()

    async def TransferLease(
        self, request: pb.TransferLeaseRequest, context: Context
    ) -> pb.TransferLeaseResponse:
        """Hand the lease over."""

        def work() -> Lease:
            to = self._who(request.to)
            return self._cell.transfer(request.token, to.key, to.name)

        lease = await self._do(context, work)
        return pb.TransferLeaseResponse(seconds=self._cell.desk.remaining(lease))

    async def SeizeLease(
        self, request: pb.SeizeLeaseRequest, context: Context
    ) -> pb.SeizeLeaseResponse:
        """Take the lease whoever holds it."""
        owner = caller_key()
        lease = await self._do(
            context, lambda: self._cell.seize(request.holder, owner, request.reason)
        )
        return pb.SeizeLeaseResponse(lease=self._lease_message(lease))

    def _lease_message(self, lease: Lease) -> pb.Lease:
        return pb.Lease(
            token=lease.token, holder=lease.holder, seconds=self._cell.desk.remaining(lease)
        )

    # How

    async def _command(
        self,
        context: Context,
        request: _CommandRequest,
        what: str,
        act: Callable[[Device], None],
    ) -> pb.DeviceReport:
        def work() -> pb.DeviceReport:
            device = self._cell.command(request.lease_token, request.device, what, act)
            return _device_message(device)

        return await self._do(context, work)

    async def _is_closing_within(self, seconds: float) -> bool:
        try:
            await asyncio.wait_for(self._closing.wait(), seconds)
        except TimeoutError:
            return False
        return True

    async def _is_woken(self, wake: asyncio.Event) -> bool:
        """Wait for *wake*; return whether it came before the daemon's end."""
        waiting = [asyncio.ensure_future(event.wait()) for event in (wake, self._closing)]
        try:
            await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for one in waiting:
                one.cancel()
        wake.clear()
        return not self._closing.is_set()

    async def _do(self, context: Context, work: Callable[[], Result]) -> Result:
        try:
            return await self._in_worker(work)
        except OrientdError as error:
            await _refuse(context, error)

    def _in_worker(self, work: Callable[[], Result]) -> Awaitable[Result]:
        return asyncio.get_running_loop().run_in_executor(self._commanders, work)

    async def _planned(self, planning: Future[Result]) -> Result:
        """Wait for a plan; whoever waits for that does not keep the daemon from ending.

        Raises:
            DaemonError: the daemon is going down.
        """
        waiting = asyncio.wrap_future(planning)
        closing = asyncio.ensure_future(self._closing.wait())
        try:
            either: set[asyncio.Future[Any]] = {waiting, closing}
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            if waiting.done():
                return waiting.result()
            raise DaemonError("the daemon is going down")
        finally:
            waiting.cancel()
            closing.cancel()


async def _first(requests: AsyncIterator[pb.TrackRequest]) -> pb.TrackStart:
    async for request in requests:
        if request.WhichOneof("what") == "start":
            return request.start
        break
    raise RequestError("start", "expected as the first message")


async def _read_targets(requests: AsyncIterator[pb.TrackRequest], following: Following) -> None:
    async for request in requests:
        if request.WhichOneof("what") == "target":
            following.take(request.target)
        else:
            following.refuse("target: expected in every message after the first")


def _started(run: Run, timing: MoveTiming) -> pb.MoveResponse:
    from orientd.daemon import motion_report
    from orientd.rpc.move_wire import plan_to_message, timing_to_message

    if run.motion is None:
        raise ValueError("the run has no motion")
    return pb.MoveResponse(
        started=pb.MoveStarted(
            motion_number=run.number,
            plan=plan_to_message(motion_report.plan(run.motion)),
            timing=timing_to_message(timing),
        )
    )


def _sample_rate(rate_hz: float, device: Device) -> float:
    """Return *rate_hz*, at which a motion of *device* is to be sampled; 0 for not at all."""
    if not 0.0 <= rate_hz <= device.rate_hz:
        raise RequestError("sample_rate_hz", f"expected 0 to {device.rate_hz:g}, got {rate_hz:g}")
    return rate_hz


def _planned_messages(motion: Motion, rate_hz: float) -> tuple[pb.Plan, list[pb.MotionSample]]:
    from orientd.daemon import motion_report
    from orientd.rpc.move_wire import plan_to_message, samples_to_messages

    if rate_hz * motion.duration > MOST_SAMPLES:
        raise RequestError(
            "sample_rate_hz",
            f"{motion.duration:.6g} s make more than {MOST_SAMPLES} samples at {rate_hz:g} Hz",
        )
    samples = samples_to_messages(motion_report.samples(motion, rate_hz)) if rate_hz else []
    return plan_to_message(motion_report.plan(motion)), samples


def _progress(reader: report.ProgressReader) -> pb.MoveProgress | None:
    from orientd.rpc.move_wire import progress_to_message

    progress = reader.read()
    return None if progress is None else progress_to_message(progress)


def _timing(received_ns: int, planned_ns: int, *, attempts: int) -> MoveTiming:
    return MoveTiming(
        planning=(planned_ns - received_ns) * 1e-9,
        splicing=(time.monotonic_ns() - planned_ns) * 1e-9,
        received_ns=received_ns,
        attempts=attempts,
    )


def _device_message(device: Device) -> pb.DeviceReport:
    return device_to_message(report.device_report(device))


def _interval(field: str, rate_hz: float) -> float:
    """Return the seconds between reports, of which *rate_hz* are wanted; 0 is the default."""
    if rate_hz == 0.0:
        return 1.0 / DEFAULT_REPORTS_HZ
    if not SLOWEST_REPORTS_HZ <= rate_hz <= FASTEST_REPORTS_HZ:
        raise RequestError(
            field, f"expected {SLOWEST_REPORTS_HZ:g} to {FASTEST_REPORTS_HZ:g}, got {rate_hz:g}"
        )
    return 1.0 / rate_hz


async def _refuse(context: Context, error: OrientdError) -> NoReturn:
    """End the call with *error*, in full."""
    status = to_status(error)
    codes = {code.value[0]: code for code in grpc.StatusCode}
    await context.abort(
        codes[status.code], status.message, ((DETAILS_KEY, status.SerializeToString()),)
    )
