"""Targets: taken from a caller as they come, and followed until there are no more."""

from __future__ import annotations

import asyncio
import functools
from collections.abc import AsyncIterator
from typing import Any

from orientd.daemon.calls.calls import Calls, Context, interval
from orientd.daemon.calls.track_call import TrackCall
from orientd.daemon.motion_starter import GONE
from orientd.daemon.motions import ActiveMotion
from orientd.errors import RequestError, StateError
from orientd.rpc import Outcome, limits_to_wish, report_to_message
from orientd.rpc import control_pb2 as pb


class TrackingCalls(Calls):
    """The call that has a device follow targets."""

    async def Track(
        self, request_iterator: AsyncIterator[pb.TrackRequest], context: Context
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
            following = TrackCall(device)
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
                    yield report_to_message(now)
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


async def _read_targets(requests: AsyncIterator[pb.TrackRequest], following: TrackCall) -> None:
    async for request in requests:
        if request.WhichOneof("what") == "target":
            following.take(request.target)
        else:
            following.refuse("target: expected in every message after the first")
