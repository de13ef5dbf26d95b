"""Targets: taken from a caller as they come, and followed until there are no more."""

from __future__ import annotations

import asyncio
import functools
import time
from collections.abc import AsyncIterator
from typing import Any

from orientd.daemon.access import Caller
from orientd.daemon.calls.calls import Calls, interval
from orientd.daemon.calls.report import quaternion, vector
from orientd.daemon.device import Device
from orientd.daemon.motion_starter import GONE
from orientd.daemon.motions import ActiveMotion
from orientd.driver import Quaternion
from orientd.errors import OrientdError, RequestError, StateError
from orientd.floats import difference, norm
from orientd.rpc import (
    Outcome,
    limits_to_wish,
    target_from_message,
)
from orientd.rpc import control_pb2 as pb


class TrackingCalls(Calls):
    """The call that has a device follow targets."""

    async def Track(
        self, request_iterator: AsyncIterator[pb.TrackRequest], caller: Caller
    ) -> AsyncIterator[pb.TrackResponse]:
        """Follow the caller's targets until there are no more."""
        run: ActiveMotion | None = None
        reading: asyncio.Task[None] | None = None
        try:
            begin = await _first(request_iterator)
            await self._in_turn(begin.lease_token, begin.device, begin.lease_sequence)
            pause = interval("start.report_rate_hz", begin.report_rate_hz)
            device = self._cell.device(begin.device)
            limits = limits_to_wish(begin.limits)
            self._cell.check(begin.lease_token, device, begin.lease_sequence)
            stops = self._cell.runs.stops(device)
            run = await self._cell.in_worker(
                lambda: self._cell.starter.track(begin.lease_token, device, limits, stops=stops)
            )
            following = _Following(device)
            reading = asyncio.ensure_future(_read_targets(request_iterator, following))
            ended = asyncio.wrap_future(run.ended)
            waiting: set[asyncio.Future[Any]] = {ended, reading}
            while not ended.done():
                await asyncio.wait(waiting, timeout=pause)
                if reading in waiting and reading.done():
                    waiting.discard(reading)
                    await self._cell.in_worker(
                        lambda: self._cell.runs.abandon(run, "the targets have ended")
                    )
                now = following.report()
                if now is not None:
                    yield now
            outcome, text = run.ended.result(timeout=0)
            if outcome is Outcome.FAULT:
                raise StateError(text)
        finally:
            if reading is not None:
                reading.cancel()
            if run is not None and not run.ended.done():
                self._cell.in_worker(functools.partial(self._cell.runs.abandon, run, GONE))


async def _first(requests: AsyncIterator[pb.TrackRequest]) -> pb.TrackStart:
    async for request in requests:
        if request.WhichOneof("what") == "start":
            return request.start
        break
    raise RequestError("start", "expected as the first message")


async def _read_targets(requests: AsyncIterator[pb.TrackRequest], following: _Following) -> None:
    async for request in requests:
        if request.WhichOneof("what") == "target":
            following.take(request.target)
        else:
            following.refuse("target: expected in every message after the first")


class _Following:
    """The targets of one caller for one device, and what there is to report of them."""

    def __init__(self, device: Device) -> None:
        """Begin with nothing to follow on *device*, whose servo does."""
        self._device = device
        self._given, self._left_out = device.targets
        self._refused = 0
        self._refusal = ""
        self._newest: Quaternion | None = None

    def take(self, message: pb.TrackTarget) -> None:
        """Hand a target on; one that is none is counted and left out."""
        try:
            target = target_from_message(message, time.monotonic_ns())
            self._device.aim(*target)
        except OrientdError as error:
            self.refuse(str(error))
        else:
            self._newest = target.q

    def refuse(self, problem: str) -> None:
        """Count something that is not even a target."""
        self._refused += 1
        self._refusal = problem

    def report(self) -> pb.TrackResponse | None:
        """Return how it goes; ``None`` while there is no servo to tell."""
        cycle = self._device.snapshot().cycle
        if cycle is None:
            return None
        given, left_out = self._device.targets
        return pb.TrackResponse(
            state=f"STATE_{cycle.state.name}",
            orientation=quaternion(cycle.q),
            omega_body=vector(cycle.omega_body),
            time_ns=cycle.deadline_ns,
            targets=given - self._given,
            left_out=left_out - self._left_out,
            refused=self._refused,
            refusal=self._refusal,
            error=None if self._newest is None else norm(difference(cycle.q, self._newest)),
        )
