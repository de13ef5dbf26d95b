"""Planners that run in the test's own process, for tests of their clients."""

from __future__ import annotations

import asyncio
import json
from concurrent.futures import Future

from orientd.daemon.device import AT_ONCE
from orientd.daemon.planners import reporting
from orientd.daemon.planners.messages import CHUNK, Planned, PlanRequest, RecordFile, Rest
from orientd.daemon.planners.planned_motion import PlannedMotion
from orientd.daemon.planners.worker import Worker
from orientd.motion_file import written
from orientd.planner.facts import HISTORY
from orientd.planner.recorded import rows_of, start_of
from orientd.planner.state import State


class DirectPlanners:
    """The planners of some devices."""

    timeout = 10.0

    def __init__(self, settings):
        self.worker = Worker(settings)

    async def plan(self, request: PlanRequest, *, rank=None) -> PlannedMotion:
        file = RecordFile()
        planned = self.worker.plan(request, file)
        rest = Future()
        rest.set_result(self.worker.rest(request, planned, file))
        return PlannedMotion(planned, request, file, more=self._more, rest=rest)

    def _more(self, request, file, first, _lasts):
        more = Future()
        again = request.again(self.timeout, first=first, count=CHUNK)
        more.set_result(self.worker.plan(again, file).end)
        return more

    async def records(self, motion, first):
        count, file = motion.facts.record_count - first, RecordFile()
        again = motion.request.again(self.timeout, first=first, count=count)
        return file.read(first, self.worker.plan(again, file).end - first)

    async def report(self, motion, caller, rate_hz):
        again = motion.request.again(self.timeout, caller=caller, rate_hz=rate_hz, count=0)
        return self.worker.plan(again, RecordFile()).samples

    async def methods(self):
        return reporting.methods()


def recorded(motion) -> PlannedMotion:
    """Return a motion of the planner with all of its records, as the daemon has it."""
    count, file, rest = motion.record_count, RecordFile(), Future()
    file.write(-HISTORY, motion.recorded().packed())
    rest.set_result(Rest(count, b"", 0))
    planned = Planned(motion.facts, 0, b"", b"", None, count)
    return PlannedMotion(planned, None, file, more=None, rest=rest)


def state_at(motion: PlannedMotion, record) -> State:
    """Return the state in a record of a motion, for another one to take over."""
    return start_of(rows_of(motion.start_at(record))).start


def order_of(request) -> PlanRequest:
    return PlanRequest(json.dumps(written(request)).encode())


def run(device, motion, options=AT_ONCE):
    """Have a device begin to run a planned motion, and return what runs."""

    async def begin():
        with device.expecting(options) as queued:
            await device.run(queued, motion)
        return queued

    return asyncio.run(begin())


def move(device, order, options=AT_ONCE):
    """Have a device plan a motion and begin it, and return what runs."""

    async def begin():
        with device.expecting(options) as queued:
            await device.move(queued, order)
        return queued

    return asyncio.run(begin())


def plan(device, request) -> PlannedMotion:
    """Have a device plan a request."""
    return asyncio.run(device.plan(order_of(request)))
