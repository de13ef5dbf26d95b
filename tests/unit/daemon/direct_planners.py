"""What planner processes do, done in this process: for tests of what asks them."""

from __future__ import annotations

import asyncio
import functools
from concurrent.futures import Future

from orientd.daemon.cell import planner_device
from orientd.daemon.planners import PlanCall, PlanInput, PlannedMotion
from orientd.daemon.planners.jobs import Methods, PlannedRecords, Question, Records, Report
from orientd.daemon.planners.record_file import Chunk, RecordFile
from orientd.daemon.planners.worker import Work
from orientd.rpc.wire.motion import from_request


class DirectPlanners:
    """The planners of some devices."""

    timeout = 10.0

    def __init__(self, settings):
        self.work = Work(map(planner_device, settings))

    async def plan(self, job: PlanInput, order: PlanCall, *, rank=None) -> PlannedMotion:
        question, file = Question(Records(rate_hz=order.rate_hz), job), RecordFile()
        planned = self.work.do(question, file.descriptor)
        assert isinstance(planned, PlannedRecords)
        rest = Future()
        rest.set_result(self.work.rest(question, file.descriptor))
        fetch = functools.partial(self._more, job)
        chunk = Chunk(0, *planned.shape, file)
        return PlannedMotion(planned, job, chunk, fetch=fetch, rest=rest)

    def _more(self, job, first, count):
        more, file = Future(), RecordFile()
        planned = self.work.do(Question(Records(first, count), job), file.descriptor)
        assert isinstance(planned, PlannedRecords)
        more.set_result(Chunk(first, *planned.shape, file))
        return more

    async def records(self, motion, first):
        chunk = self._more(motion.job, first, motion.facts.record_count - first).result()
        return chunk.read(first, chunk.count)

    async def report(self, job, order, rate_hz):
        return self.work.do(Question(Report(rate_hz), job))

    async def methods(self, caller):
        return self.work.do(Question(Methods()))


def order_of(request) -> PlanCall:
    return PlanCall(from_request(request).SerializeToString())


def plan(device, request) -> PlannedMotion:
    """Have a device plan a request."""
    return asyncio.run(device.plan(order_of(request)))
