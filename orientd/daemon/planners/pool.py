"""The planners of a daemon: who is served next, for how long, and what becomes of the rest.

Three lanes keep what is short from waiting behind what is long: planner 0 serves moving devices
alone, planner 1 these and small requests, all others whatever there is.
"""

from __future__ import annotations

import asyncio
import functools
import logging
import os
from collections.abc import Coroutine, Sequence
from concurrent.futures import Future

from orientd.daemon.planners.jobs import (
    Methods,
    PlanInput,
    PlannedRecords,
    PlannerDevice,
    Question,
    Records,
    RemainingRecords,
    Report,
)
from orientd.daemon.planners.lanes import Lanes, PlanCall, Rank, Waiting
from orientd.daemon.planners.planned_motion import PlannedMotion
from orientd.daemon.planners.process import GIVE_UP, ForkServer, PlannerProcess
from orientd.daemon.planners.record_file import Chunk
from orientd.errors import GOING_DOWN, DaemonError, DeadlineError
from orientd.rotation import Floats

_log = logging.getLogger(__name__)

RETIRED_BYTES = 128 * 2**20
"""A planner that still uses so much after its work makes room for a new one."""

_RESTART = 0.1  # s before another process is tried where one did not start
_MORE = 5.0
"""How long a planner may take over the rest of a chunk and what the journal tells, s."""

_ENDING = 0.5
"""How long whatever serves may take to notice that the planners have ended, s."""

_NICE = {0: 0, 1: 5}
_NICEST = 10


def _chunk(answered: Waiting) -> tuple[PlannedRecords, Chunk]:
    what, planned, file = answered.question.what, answered.content, answered.file
    if not isinstance(what, Records) or not isinstance(planned, PlannedRecords) or file is None:
        raise DaemonError("the planner said something else")
    return planned, Chunk(what.first, *planned.shape, file)


class Planners:
    """Planner processes, replaced whenever one ends.

    Attributes:
        timeout: how long a request may take at the most, s.
    """

    def __init__(
        self,
        devices: Sequence[PlannerDevice],
        *,
        processes: int,
        timeout: float,
    ) -> None:
        """Start nothing yet.

        Args:
            devices: to plan for.
            processes: how many planners there are.
            timeout: how long a request may take at the most, s.
        """
        self.timeout = timeout
        self._devices = devices
        self._count = processes
        self._lanes = Lanes()
        self._idle: list[PlannerProcess] = []
        self._all: set[PlannerProcess] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._is_closing = False
        self._loop: asyncio.AbstractEventLoop | None = None
        self._started: set[int] = set()
        self._server: ForkServer | None = None
        self._turn = asyncio.Lock()

    def start(self) -> None:
        """Start the processes and return at once; to be called in the event loop."""
        self._loop = asyncio.get_running_loop()
        self._spawn(self._start_all())

    async def close(self) -> None:
        """End every process; whoever waits is told that the daemon is going down."""
        self._is_closing = True
        while (waiting := self._lanes.take()) is not None:
            waiting.answer.set_exception(DaemonError(GOING_DOWN))
        # Whoever is being served hears of it by the end of their planner.
        for process in self._all:
            process.kill()
        if self._tasks:
            await asyncio.wait(self._tasks, timeout=_ENDING)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for process in list(self._all):
            self._remove(process)
        self._end_server()

    # What can be asked

    async def plan(
        self, job: PlanInput, order: PlanCall, *, rank: Rank | None = None
    ) -> PlannedMotion:
        """Plan a motion.

        Args:
            job: what to plan.
            order: who asks, and how long it may take.
            rank: what it may wait for; by default by its size.

        Raises:
            RequestError: it is not well formed.
            PlanError: it cannot be planned.
            DeadlineError: it takes too long.
            TooMuchError: too much of the same caller waits already.
            DaemonError: the planner has ended.
        """
        chosen = order.rank if rank is None else rank
        question = Question(Records(rate_hz=order.rate_hz), job)
        answered = await self._ask(question, chosen, order)
        planned, chunk = _chunk(answered)
        fetch = functools.partial(self._more, job)
        return PlannedMotion(planned, job, chunk, fetch=fetch, rest=answered.rest)

    async def report(self, job: PlanInput, order: PlanCall, rate_hz: float) -> bytes:
        """Return a serialised ``PlanResponse`` of a motion; arguments and errors as of a plan."""
        content = (await self._ask(Question(Report(rate_hz), job), order.rank, order)).content
        return content if isinstance(content, bytes) else b""

    async def methods(self, caller: str) -> bytes:
        """Return a serialised ``ListMethodsResponse``."""
        order = PlanCall(b"", caller, self.timeout)
        content = (await self._ask(Question(Methods()), Rank.SMALL, order)).content
        return content if isinstance(content, bytes) else b""

    def _more(self, job: PlanInput, first: int, count: int) -> Future[Chunk]:
        """Ask for more records of a motion, from any thread."""
        if self._loop is None:
            raise DaemonError(GOING_DOWN)
        return asyncio.run_coroutine_threadsafe(self._records(job, first, count), self._loop)

    async def _records(self, job: PlanInput, first: int, count: int) -> Chunk:
        order = PlanCall(job.motion, "", self.timeout)
        answered = await self._ask(Question(Records(first, count), job), Rank.URGENT, order)
        return _chunk(answered)[1]

    async def records(self, motion: PlannedMotion, first: int) -> Floats:
        """Return the records of a motion from one on to its end."""
        count = motion.facts.record_count - first
        chunk = await self._records(motion.job, first, count)
        return chunk.read(first, chunk.count)

    # How

    async def _ask(self, question: Question, rank: Rank, order: PlanCall) -> Waiting:
        """Return what waited for the answer, once it is there."""
        if self._is_closing:
            raise DaemonError(GOING_DOWN)
        waiting = self._lanes.enter(question, rank, order)
        self._dispatch()
        try:
            async with asyncio.timeout(order.time_left):
                answer = await waiting.answer
        except (TimeoutError, DaemonError) as error:
            if self._is_closing:
                raise DaemonError(GOING_DOWN) from None
            if isinstance(error, DaemonError):
                raise
            raise DeadlineError(self._too_long(waiting, order.timeout)) from None
        finally:
            waiting.answer.cancel()
            self._give_up(waiting)
        if answer.error is not None:
            raise answer.error.error()
        return waiting

    def _dispatch(self) -> None:
        """Give every planner that has nothing to do the first of what it may do.

        A moving device is served by the first of them, which give way to nobody and have done the
        same lately; all else by the last, so that the first stay free.
        """
        order = sorted(self._idle, key=lambda idle: idle.number)
        for process in order:
            self._give(process, Rank.URGENT)
        for process in reversed(order):
            # Until all are there, the last of those that are takes everything.
            is_last = process.number == max(self._started, default=0)
            self._give(process, Rank.LARGE if is_last else Rank(min(process.number, Rank.LARGE)))

    def _give(self, process: PlannerProcess, slowest: Rank) -> None:
        """Give a planner the first of what waits, unless it is slower than what it may do."""
        waiting = self._lanes.take(slowest) if process in self._idle else None
        if waiting is not None:
            self._idle.remove(process)
            waiting.process = process
            self._spawn(self._serve(process, waiting))

    async def _serve(self, process: PlannerProcess, waiting: Waiting) -> None:
        what = waiting.question.what
        try:
            answer = await process.ask(waiting.question, waiting.file)
            waiting.process = None
            if not waiting.answer.done():
                waiting.answer.set_result(answer)
            if answer.error is None and isinstance(what, Records) and what.is_first:
                async with asyncio.timeout(_MORE):
                    answer = await process.hear()
                if isinstance(answer.content, RemainingRecords):
                    waiting.rest.set_result(answer.content)
        except (DaemonError, TimeoutError) as error:
            waiting.process = None
            if not waiting.answer.done():
                waiting.answer.set_exception(error)
            waiting.rest.cancel()
            if self._is_closing:
                return
            _log.warning("%s", error or f"planner {process.pid}: it does not answer")
            await self._replace(process)
            return
        if answer.resident > RETIRED_BYTES:
            _log.info("planner %s uses %d MiB: replaced", process.pid, answer.resident >> 20)
            await self._replace(process)
            return
        self._idle.append(process)
        self._dispatch()

    def _give_up(self, waiting: Waiting) -> None:
        """Have a planner end what nobody waits for any more, or be ended itself."""
        process, waiting.process = waiting.process, None
        if process is not None:
            process.give_up()
            self._spawn(self._kill_late(process))

    async def _kill_late(self, process: PlannerProcess) -> None:
        questions = process.questions
        await asyncio.sleep(GIVE_UP)
        is_at_it = process not in self._idle and process.questions == questions
        if process in self._all and is_at_it:
            _log.warning("planner %s: killed while %s", process.pid, process.stage)
            process.kill()

    def _too_long(self, waiting: Waiting, timeout: float) -> str:
        if waiting.process is None:
            return f"planning did not begin within {timeout:g} s: the planners are busy"
        return f"planning took longer than {timeout:g} s: {waiting.process.stage}"

    # Life

    async def _start_all(self) -> None:
        for number in range(self._count):
            await self._start(number)

    async def _start(self, number: int) -> None:
        while not self._is_closing:
            process = PlannerProcess(number)
            self._all.add(process)
            try:
                await process.start(await self._forking(), nice=_NICE.get(number, _NICEST))
            except DaemonError as error:
                _log.error("a planner did not start: %s", error)
                self._remove(process)
                self._end_server()
                await asyncio.sleep(_RESTART)
                continue
            self._idle.append(process)
            self._started.add(number)
            self._dispatch()
            return

    async def _forking(self) -> ForkServer:
        """Return what planners are forked from, started anew where it has ended."""
        async with self._turn:
            if self._server is None:
                self._server = ForkServer()
                await self._server.start(self._devices)
            return self._server

    async def _replace(self, process: PlannerProcess) -> None:
        self._started.discard(process.number)
        self._remove(process)
        self._dispatch()
        await self._start(process.number)

    def _remove(self, process: PlannerProcess) -> None:
        self._all.discard(process)
        process.end()

    def _end_server(self) -> None:
        if self._server is not None:
            self._server.end()
            self._server = None

    def _spawn(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


def default_processes() -> int:
    """Return how many planners there are unless the settings say."""
    return max(3, min(len(os.sched_getaffinity(0)), 6))
