"""Motions: planned, begun, and reported on until they end."""

from __future__ import annotations

import asyncio
import functools
import math
import time
from collections.abc import AsyncIterator

from orientd.daemon.access import Caller
from orientd.daemon.calls import report
from orientd.daemon.calls.calls import Calls, interval
from orientd.daemon.device import Device
from orientd.daemon.motion_starter import GONE
from orientd.daemon.motions import ActiveMotion, ArrivalCondition, MoveOptions
from orientd.daemon.planners import PlanCall, PlannedMotion
from orientd.errors import GOING_DOWN, DaemonError, OrientdError, RequestError
from orientd.rpc import control_pb2 as pb
from orientd.stream import UNKNOWN

SETTLING_TIMEOUT = 5.0
"""How long a device may take to be on target after the last setpoint, by default, s."""

LONGEST_WAIT = 3600.0
"""How far ahead a start time may be, s."""

KEPT_INSTANTS = 64
"""Start times that are remembered, for the motions of other devices."""


class MovingCalls(Calls):
    """Calls that plan and run motions."""

    async def Plan(self, request: pb.PlanRequest, caller: Caller) -> bytes:
        """Plan a motion and keep it."""
        received_ns = time.monotonic_ns()
        try:
            device = self._cell.device(request.device)
            rate_hz = _sample_rate(request.sample_rate_hz, device)
            order = self._order(request, caller, rate_hz)
            motion = await self._cell.plan(device, order)
            # Messages put one behind the other are merged.
            took = pb.PlanResponse(plan=pb.Plan(planning=_seconds_since(received_ns)))
            return (motion.response or _unsampled(motion)) + took.SerializeToString()
        except OrientdError as error:
            error.planning = _seconds_since(received_ns)
            raise self._in_the_end(error) from None

    async def GetPlan(
        self, request: pb.GetPlanRequest, caller: Caller
    ) -> pb.GetPlanResponse | bytes:
        """Report the plan of a motion."""
        try:
            device = self._cell.device(request.device)
            rate_hz = _sample_rate(request.sample_rate_hz, device)
            motion = self._cell.present(device, request.motion_id)
            if motion is None:
                return pb.GetPlanResponse()
            order = PlanCall(motion.job.motion, caller.key, self._cell.planners.timeout)
            if not rate_hz:
                return _unsampled(motion)
            return await self._cell.planners.report(motion.job, order, rate_hz)
        except OrientdError as error:
            raise self._in_the_end(error) from None

    def _order(
        self, request: pb.PlanRequest | pb.MoveRequest, caller: Caller, rate_hz: float = 0.0
    ) -> PlanCall:
        """Return what is to be planned, for whom, and for how long at the most.

        Raises:
            RequestError: the time for it is none, or there are more keyframes than one may ask for.
        """
        longest = self._cell.planners.timeout
        wanted = request.plan_timeout or longest
        if not 0.0 < wanted < math.inf:
            raise RequestError("plan_timeout", f"expected more than 0 s, got {wanted:g}")
        motion = request.motion
        count = max(len(motion.keyframes), len(motion.columns.quaternions) // 4)
        if count > self._cell.keyframes:
            expected = f"expected at most {self._cell.keyframes}"
            raise RequestError("keyframes", f"{expected}, got {count}")
        # The planner reads the rest: it takes as long as planning a small motion.
        return PlanCall(motion.SerializeToString(), caller.key, min(wanted, longest), rate_hz)

    def _in_the_end(self, error: OrientdError) -> OrientdError:
        """Return why a call failed: once the daemon ends, because of that."""
        return DaemonError(GOING_DOWN) if self._cell.is_closing else error

    async def Move(self, request: pb.MoveRequest, caller: Caller) -> AsyncIterator[pb.MoveResponse]:
        """Run a motion and report until it ends; a caller that goes away stops it."""
        run: ActiveMotion | None = None
        received_ns = time.monotonic_ns()
        try:
            await self._in_turn(request.lease_token, request.device, request.lease_sequence)
            pause = interval("progress_rate_hz", request.progress_rate_hz)
            device = self._cell.device(request.device)
            self._cell.check(request.lease_token, device, request.lease_sequence)
            move_options = self._move_options(request)
            stops = self._cell.runs.stops(device)
            run, timing = await self._start(
                device, request, move_options, stops, received_ns, caller
            )
            yield _started(run, timing)
            reader = report.ProgressReader(run)
            ended = asyncio.wrap_future(run.ended)
            while not (await asyncio.wait({ended}, timeout=pause))[0]:
                progress = reader.read()
                if progress is not None:
                    yield pb.MoveResponse(progress=progress)
            yield await self._cell.in_worker(lambda: self._summary(run))
        except OrientdError as error:
            if run is None:
                error.planning = _seconds_since(received_ns)
            raise self._in_the_end(error) from None
        finally:
            if run is not None and not run.ended.done():
                self._cell.in_worker(functools.partial(self._cell.runs.abandon, run, GONE))

    async def _start(
        self,
        device: Device,
        request: pb.MoveRequest,
        move_options: MoveOptions,
        stops: int,
        received_ns: int,
        caller: Caller,
    ) -> tuple[ActiveMotion, pb.MoveTiming]:
        """Plan and begin a motion."""
        token, what = request.lease_token, request.WhichOneof("what")
        if what == "motion":
            return await self._cell.starter.move(
                token,
                device,
                self._order(request, caller),
                move_options,
                stops=stops,
                received_ns=received_ns,
            )
        if what == "motion_id":
            motion = self._cell.plans.find(device.name, request.motion_id)
            planned_ns = time.monotonic_ns()
            run = await self._cell.starter.start(token, device, motion, move_options, stops=stops)
            return run, pb.MoveTiming(
                planning=(planned_ns - received_ns) * 1e-9,
                splicing=_seconds_since(planned_ns),
                received_ns=received_ns,
                attempts=0,
            )
        raise RequestError("motion", "expected a motion or a motion_id, got neither")

    def _move_options(self, request: pb.MoveRequest) -> MoveOptions:
        """Return how the motion of *request* is to begin and to end.

        Raises:
            RequestError: that is not well formed.
        """
        gate = None
        if request.HasField("on_target"):
            asked = request.on_target
            timeout = asked.timeout or SETTLING_TIMEOUT
            gate = ArrivalCondition(asked.tolerance, asked.rate, asked.settle_time, timeout)
        blend = request.blend_tolerance
        if not 0.0 <= blend < math.pi:
            raise RequestError("blend_tolerance", f"expected 0 to pi rad, got {blend!r}")
        if blend and not request.queue:
            raise RequestError("blend_tolerance", "expected with queue only")
        start_ns = self._start_ns(request)
        return MoveOptions(is_queued=request.queue, blend=blend, start_ns=start_ns, gate=gate)

    def _start_ns(self, request: pb.MoveRequest) -> int:
        """Return when the motion of *request* is to begin, monotonic clock.

        Raises:
            RequestError: that is not well formed, or not ahead.
        """
        field = "start_ns" if request.start_ns else "start_time"
        if not (request.start_ns or request.HasField("start_time")):
            return UNKNOWN
        if request.queue:
            raise RequestError(field, "expected without queue only")
        if request.start_ns:
            if request.HasField("start_time"):
                raise RequestError(field, "expected without start_time only")
            ahead = request.start_ns - time.monotonic_ns()
        else:
            try:
                wanted_ns = request.start_time.ToNanoseconds()
            except ValueError as error:
                raise RequestError(field, f"expected a time: {error}") from error
            ahead = wanted_ns - time.time_ns()
        if not 0 < ahead <= LONGEST_WAIT * 1e9:
            raise RequestError(
                field, f"expected up to {LONGEST_WAIT:g} s ahead of now, got {ahead * 1e-9:.6g} s"
            )
        return request.start_ns or _instant(wanted_ns)

    def _summary(self, run: ActiveMotion) -> pb.MoveResponse:
        return pb.MoveResponse(summary=report.summary(run, self._cell.runs))


def _started(run: ActiveMotion, timing: pb.MoveTiming) -> pb.MoveResponse:
    if run.motion is None:
        raise ValueError("the run has no motion")
    return pb.MoveResponse(
        started=pb.MoveStarted(
            motion_number=run.number,
            plan=pb.Plan.FromString(run.motion.plan),
            timing=timing,
            speed=run.device.snapshot().speed,
        )
    )


@functools.lru_cache(KEPT_INSTANTS)
def _instant(time_ns: int) -> int:
    """Return when it will be *time_ns* since the epoch, on the monotonic clock.

    Whoever asks for the same time is given the same instant, whatever is done to the clock on the
    wall meanwhile.
    """
    return time.monotonic_ns() + time_ns - time.time_ns()


def _sample_rate(rate_hz: float, device: Device) -> float:
    """Return *rate_hz*, at which a motion of *device* is to be sampled; 0 for not at all."""
    if not 0.0 <= rate_hz <= device.rate_hz:
        raise RequestError("sample_rate_hz", f"expected 0 to {device.rate_hz:g}, got {rate_hz:g}")
    return rate_hz


def _unsampled(motion: PlannedMotion) -> bytes:
    """Return a serialised answer with the plan of a motion alone."""
    return pb.PlanResponse(plan=pb.Plan.FromString(motion.plan)).SerializeToString()


def _seconds_since(instant_ns: int) -> float:
    return (time.monotonic_ns() - instant_ns) * 1e-9
