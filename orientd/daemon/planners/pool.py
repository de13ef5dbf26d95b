"""The planners of a daemon: which task is next, for how long, and what becomes of the others.

Three ranks keep what is short from waiting behind what is long: planner 0 serves moving devices
alone, planner 1 these and small requests, all others whatever there is.
"""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Coroutine, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, field

from orientd.daemon.planners.planned_motion import PlannedMotion
from orientd.daemon.planners.process import ForkServer, PlannerProcess
from orientd.daemon.planners.task import (
    CHUNK,
    PlanCall,
    PlanInput,
    Planned,
    PlannerDevice,
    Rank,
    RecordFile,
    Rest,
)
from orientd.errors import GOING_DOWN, DaemonError, DeadlineError, OrientdError, TooMuchError
from orientd.rotation import Floats

_log = logging.getLogger(__name__)

MOST_WAITING = 32
"""Requests of one caller that may wait for their turn."""

MOST_BYTES = 64 * 2**20
"""Of all requests that wait; of each caller one may wait in any case."""

RETIRED_BYTES = 128 * 2**20
"""A planner that still uses so much after its work makes room for a new one."""

_RESTART = 0.1  # s before another process is tried after one that did not start
_MORE = 5.0
"""How long a planner may take over the rest of a chunk and what the journal reports, s."""

_ENDING = 0.5
"""How long whatever serves may take to notice that the planners have ended, s."""

_NICE = {0: 0, 1: 5}
_NICEST = 10


@dataclass(eq=False, slots=True)
class Task:
    """A motion to plan, who waits for it, and the planner that works on it.

    Attributes:
        input: what to plan.
        call: who asks, and until when it is waited for.
        rank: what it may wait for.
        first, count: the records that are wanted.
        rate_hz: samples a second to report; 0 for none.
        file: for the records.
        answer: what the planner answers.
        rest: what follows the answer.
        planner: works on the answer; ``None`` before and afterwards.
    """

    input: PlanInput
    call: PlanCall
    rank: Rank
    first: int = 0
    count: int = CHUNK
    rate_hz: float = 0.0
    file: RecordFile = field(default_factory=RecordFile)
    answer: asyncio.Future[Planned] = field(default_factory=lambda: asyncio.Future())
    rest: Future[Rest] = field(default_factory=Future)
    planner: PlannerProcess | None = None


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
        self._waiting: list[Task] = []
        self._planners: dict[int, PlannerProcess] = {}
        self._idle: dict[int, PlannerProcess] = {}
        self._work: set[asyncio.Task[None]] = set()
        self._server: ForkServer | None = None
        self._has_methods = asyncio.Event()
        self._methods = b""
        self._is_closing = False
        self._loop: asyncio.AbstractEventLoop | None = None

    def start(self) -> None:
        """Start the processes and return at once; to be called in the event loop."""
        self._loop = asyncio.get_running_loop()
        self._spawn(self._start_all())

    async def close(self) -> None:
        """End every process; whoever waits is told that the daemon is going down."""
        self._is_closing = True
        for task in self._waiting:
            task.answer.set_exception(DaemonError(GOING_DOWN))
        self._waiting.clear()
        # Whoever is being served hears of it by the end of their planner.
        for planner in self._planners.values():
            planner.kill()
        if self._work:
            await asyncio.wait(self._work, timeout=_ENDING)
        for work in self._work:
            work.cancel()
        await asyncio.gather(*self._work, return_exceptions=True)
        for planner in self._planners.values():
            planner.end()
        self._end_server()

    # What can be asked

    async def plan(
        self, plan_input: PlanInput, call: PlanCall, *, rank: Rank | None = None
    ) -> PlannedMotion:
        """Plan a motion.

        Args:
            plan_input: what to plan.
            call: who asks, and how long it may take.
            rank: what it may wait for; by default by its size.

        Raises:
            RequestError: it is not well formed.
            PlanError: it cannot be planned.
            DeadlineError: it takes too long.
            TooMuchError: too much waits already.
            DaemonError: the planner has ended.
        """
        chosen = call.rank if rank is None else rank
        task = Task(plan_input, call, chosen, rate_hz=call.rate_hz)
        planned = await self._answer(task)
        return PlannedMotion(planned, plan_input, task.file, more=self._more, rest=task.rest)

    async def report(self, plan_input: PlanInput, call: PlanCall, rate_hz: float) -> bytes:
        """Return a serialised ``PlanResponse`` of a motion; arguments and errors as of a plan."""
        task = Task(plan_input, call, call.rank, count=0, rate_hz=rate_hz)
        return (await self._answer(task)).response

    async def methods(self) -> bytes:
        """Return a serialised ``ListMethodsResponse``, once there is a planner."""
        try:
            async with asyncio.timeout(self.timeout):
                await self._has_methods.wait()
        except TimeoutError:
            raise DeadlineError(f"no planner has started within {self.timeout:g} s") from None
        return self._methods

    async def records(self, motion: PlannedMotion, first: int) -> Floats:
        """Return the records of a motion from one on to its end."""
        count = motion.facts.record_count - first
        file = RecordFile()
        planned = await self._answer(self._records(motion.input, file, first, count))
        return file.read(first, planned.end - first, planned.columns)

    def _more(self, plan_input: PlanInput, file: RecordFile, first: int) -> Future[int]:
        """Have more records of a motion added to its file, from any thread; return the end."""
        if self._loop is None:
            raise DaemonError(GOING_DOWN)

        async def end() -> int:
            return (await self._answer(self._records(plan_input, file, first, CHUNK))).end

        return asyncio.run_coroutine_threadsafe(end(), self._loop)

    def _records(self, plan_input: PlanInput, file: RecordFile, first: int, count: int) -> Task:
        call = PlanCall(plan_input.motion, timeout=self.timeout)
        return Task(plan_input, call, Rank.URGENT, first, count, file=file)

    # How

    async def _answer(self, task: Task) -> Planned:
        """Have a planner work on *task*; return its answer."""
        if self._is_closing:
            raise DaemonError(GOING_DOWN)
        self._enter(task)
        self._dispatch()
        try:
            async with asyncio.timeout(task.call.time_left):
                return await task.answer
        except TimeoutError:
            raise DeadlineError(_too_long(task)) from None
        finally:
            task.answer.cancel()
            if task in self._waiting:
                self._waiting.remove(task)
            elif task.planner is not None:
                # Nobody waits any more for what it is doing.
                _log.info("planner %d: killed while %s", task.planner.pid, task.file.stage)
                task.planner.kill()

    def _enter(self, task: Task) -> None:
        """Have *task* wait behind those of its rank.

        Raises:
            TooMuchError: too much of the same caller, or of all, waits already.
        """
        caller = task.call.caller
        own = sum(one.call.caller == caller for one in self._waiting)
        if caller and own >= MOST_WAITING:
            problem = f"at most {MOST_WAITING} requests of one caller may wait to be planned"
            raise TooMuchError(problem)
        size = sum(len(one.input.motion) for one in [task, *self._waiting])
        if caller and own and size > MOST_BYTES:
            raise TooMuchError(f"at most {MOST_BYTES >> 20} MiB of requests may wait")
        self._waiting.append(task)
        self._waiting.sort(key=lambda one: one.rank)

    def _dispatch(self) -> None:
        """Give idle planners the first tasks that they may serve.

        A moving device is served by the first planner, which gives way to nobody and has done the
        same lately; all else by the last, so that the first stay free.
        """
        for task in list(self._waiting):
            able = [one for one in self._idle if task.rank <= self._slowest(one)]
            if able:
                number = min(able) if task.rank is Rank.URGENT else max(able)
                self._waiting.remove(task)
                task.planner = self._idle.pop(number)
                self._spawn(self._serve(task, task.planner))

    def _slowest(self, number: int) -> Rank:
        """Return the rank up to which a planner serves: the last of those that are there, all."""
        return Rank.LARGE if number == max(self._planners) else Rank(min(number, Rank.LARGE))

    async def _serve(self, task: Task, planner: PlannerProcess) -> None:
        try:
            answer = await planner.plan(task.input, task.first, task.count, task.rate_hz, task.file)
            task.planner = None
            if task.answer.done():
                pass  # nobody waits for it
            elif isinstance(answer, OrientdError):
                task.answer.set_exception(answer)
            else:
                task.answer.set_result(answer)
            async with asyncio.timeout(_MORE):
                rest = await planner.rest()
            task.rest.set_result(rest)
            if rest.resident <= RETIRED_BYTES:
                self._idle[planner.number] = planner
                self._dispatch()
                return
            _log.info("planner %d uses %d MiB: replaced", planner.pid, rest.resident >> 20)
        except (DaemonError, TimeoutError) as error:
            task.planner = None
            task.rest.cancel()
            if not task.answer.done():
                problem = GOING_DOWN if self._is_closing else str(error)
                task.answer.set_exception(DaemonError(problem))
                _log.warning("%s", problem)
        if not self._is_closing:
            del self._planners[planner.number]
            planner.end()
            self._dispatch()
            await self._start(planner.number)

    # Life

    async def _start_all(self) -> None:
        for number in range(self._count):
            await self._start(number)

    async def _start(self, number: int) -> None:
        while not self._is_closing:
            server = None
            try:
                server = self._server = self._server or ForkServer(self._devices)
                planner = await server.fork(number, _NICE.get(number, _NICEST))
            except DaemonError as error:
                _log.error("a planner did not start: %s", error)
                if server is self._server:
                    self._end_server()
                await asyncio.sleep(_RESTART)
                continue
            self._methods = server.methods
            self._has_methods.set()
            self._planners[number] = self._idle[number] = planner
            self._dispatch()
            return

    def _end_server(self) -> None:
        if self._server is not None:
            self._server.end()
            self._server = None

    def _spawn(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._work.add(task)
        task.add_done_callback(self._work.discard)


def _too_long(task: Task) -> str:
    timeout = task.call.timeout
    if task.planner is None:
        return f"planning did not begin within {timeout:g} s: the planners are busy"
    return f"planning took longer than {timeout:g} s: {task.file.stage}"


def default_processes() -> int:
    """Return how many planners there are unless the settings say."""
    return max(3, min(len(os.sched_getaffinity(0)), 6))
