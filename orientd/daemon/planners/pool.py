"""The planners of a daemon: which request is next, for how long, and what becomes of the others.

Three ranks keep what is short from waiting behind what is long: planner 0 serves moving devices
alone, planner 1 these and small requests, all others whatever there is.
"""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Coroutine, Sequence
from concurrent.futures import Future
from dataclasses import dataclass

from orientd.config import DeviceSettings
from orientd.daemon.planners.messages import CHUNK, Planned, PlanRequest, Rank, RecordFile, Rest
from orientd.daemon.planners.planned_motion import PlannedMotion
from orientd.daemon.planners.process import ForkServer, PlannerProcess
from orientd.errors import GOING_DOWN, DaemonError, DeadlineError, OrientdError, TooMuchError

_log = logging.getLogger(__name__)

MOST_WAITING = 32
"""Requests of one caller that may wait for their turn."""

MOST_BYTES = 24 * 2**20
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
class _Waiting:
    """A request that waits for a planner."""

    request: PlanRequest
    rank: Rank
    turn: asyncio.Future[PlannerProcess]


class Planners:
    """Planner processes, replaced whenever one ends.

    Attributes:
        timeout: longest time for a request, s.
    """

    def __init__(
        self,
        devices: Sequence[DeviceSettings],
        *,
        processes: int,
        timeout: float,
    ) -> None:
        """Start nothing yet.

        Args:
            devices: to plan for.
            processes: how many planners there are.
            timeout: longest time for a request, s.
        """
        self.timeout = timeout
        self._devices = devices
        self._count = processes
        self._waiting: list[_Waiting] = []
        self._planners: dict[int, PlannerProcess] = {}
        self._idle: dict[int, PlannerProcess] = {}
        self._work: set[asyncio.Task[None]] = set()
        self._server: ForkServer | None = None
        self._start_problem = ""
        self._has_methods, self._has_tried = asyncio.Event(), asyncio.Event()
        self._methods = b""
        self._is_closing = False
        self._loop: asyncio.AbstractEventLoop | None = None

    def start(self) -> None:
        """Start the processes and return at once; to be called in the event loop."""
        self._loop = asyncio.get_running_loop()
        self._spawn(self._start_all())

    async def close(self) -> None:
        """End every process; waiting requests fail because the daemon is shutting down."""
        self._is_closing = True
        for waiting in self._waiting:
            if not waiting.turn.done():
                waiting.turn.set_exception(DaemonError(GOING_DOWN))
        # Requests being planned fail when their planner ends.
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

    async def plan(self, request: PlanRequest, *, rank: Rank | None = None) -> PlannedMotion:
        """Plan a motion.

        Args:
            request: what to plan, for whom, and how long it may take.
            rank: what it may wait for; by default by its size.

        Raises:
            RequestError: it is not well formed.
            PlanError: it cannot be planned.
            DeadlineError: it takes too long.
            TooMuchError: too much waits already.
            DaemonError: the planner has ended.
        """
        file = RecordFile()
        planned, rest = await self._ask(request, file, request.rank if rank is None else rank)
        return PlannedMotion(planned, request, file, more=self._more, rest=rest)

    async def report(self, motion: PlannedMotion, caller: str, rate_hz: float) -> bytes:
        """Return a serialised ``Plan`` of a motion with samples alone; errors as of a plan."""
        request = motion.request.again(self.timeout, caller=caller, rate_hz=rate_hz, count=0)
        planned, _ = await self._ask(request, RecordFile(), request.rank)
        return planned.samples

    async def methods(self) -> bytes:
        """Return a serialised ``ListMethodsResponse``, once there is a planner."""
        try:
            async with asyncio.timeout(self.timeout):
                await self._has_methods.wait()
        except TimeoutError:
            raise DeadlineError(f"no planner has started within {self.timeout:g} s") from None
        return self._methods

    async def started(self) -> str:
        """Wait until there is a planner, or one could not be started; return why there is none."""
        await self._has_tried.wait()
        return "" if self._has_methods.is_set() else self._missing

    async def can_plan(self) -> None:
        """Wait until there has been a planner."""
        await self._has_methods.wait()

    @property
    def _missing(self) -> str:
        """Why there is no planner."""
        problem = self._start_problem
        return f"no planner can be started: {problem}" if problem else "no planner has started yet"

    async def records(self, motion: PlannedMotion, first: int) -> bytes:
        """Return the records of a motion from one on to its end."""
        file, count = RecordFile(), motion.facts.record_count - first
        end = await self._records(motion.request, file, first, count, self.timeout)
        return file.read(first, end - first)

    def _more(
        self, request: PlanRequest, file: RecordFile, first: int, lasts: float
    ) -> Future[int]:
        """Add more records of a motion to its file, from any thread; return the end.

        A planner that does not know the motion plans it again.  On a busy machine that may take
        longer than a request may, and the planner after a killed one would take as long.  So this
        planner may use half of the time for which the records before *first* last.
        """
        if self._loop is None:
            raise DaemonError(GOING_DOWN)
        timeout = max(self.timeout, 0.5 * lasts)
        more = self._records(request, file, first, CHUNK, timeout)
        return asyncio.run_coroutine_threadsafe(more, self._loop)

    async def _records(
        self, request: PlanRequest, file: RecordFile, first: int, count: int, timeout: float
    ) -> int:
        more = request.again(timeout, first=first, count=count)
        planned, _ = await self._ask(more, file, Rank.URGENT)
        return planned.end

    # How

    async def _ask(
        self, request: PlanRequest, file: RecordFile, rank: Rank
    ) -> tuple[Planned, Future[Rest]]:
        """Have a planner answer *request*; return its answer, and what will follow."""
        planner = await self._turn(request, rank)
        try:
            async with asyncio.timeout(request.time_left):
                answer = await planner.plan(request, file)
        except TimeoutError:
            self._discard(planner, f"killed while {file.stage}")
            raise DeadlineError(
                f"planning took longer than {request.timeout:g} s: {file.stage}"
            ) from None
        except asyncio.CancelledError:  # the caller has gone away
            self._discard(planner, f"killed while {file.stage}")
            raise
        except DaemonError as error:
            self._discard(planner, str(error))
            raise DaemonError(GOING_DOWN) if self._is_closing else error from None
        rest: Future[Rest] = Future()
        self._spawn(self._finish(planner, rest))
        try:
            if isinstance(answer, OrientdError):
                raise answer
            return answer, rest
        finally:
            # An error has this frame in its traceback: with a name in it, both would be kept.
            del answer

    async def _finish(self, planner: PlannerProcess, rest: Future[Rest]) -> None:
        """Read the rest that follows an answer; then release the planner."""
        try:
            async with asyncio.timeout(_MORE):
                found = await planner.rest()
        except (DaemonError, TimeoutError) as error:
            rest.cancel()
            self._discard(planner, str(error) or "it does not answer")
            return
        rest.set_result(found)
        if found.resident > RETIRED_BYTES:
            self._discard(planner, f"uses {found.resident >> 20} MiB")
        else:
            self._release(planner)

    async def _turn(self, request: PlanRequest, rank: Rank) -> PlannerProcess:
        """Return a planner that has nothing else to do, once it is the turn of *request*.

        Raises:
            TooMuchError: too much waits already.
            DeadlineError: the planners are busy for too long, or none can be started.
            DaemonError: the daemon is going down.
        """
        if self._is_closing:
            raise DaemonError(GOING_DOWN)
        planner = self._take_idle(rank)
        if planner is not None:
            return planner
        self._check_waiting(request)
        waiting = _Waiting(request, rank, asyncio.get_running_loop().create_future())
        self._waiting.append(waiting)
        self._waiting.sort(key=lambda one: one.rank)
        try:
            async with asyncio.timeout(request.time_left):
                return await waiting.turn
        except BaseException as error:
            turn = waiting.turn
            if turn.done() and not turn.cancelled() and turn.exception() is None:
                self._release(turn.result())  # the turn came after the request had given up
            if isinstance(error, TimeoutError):
                why = "the planners are busy" if self._planners else self._missing
                raise DeadlineError(
                    f"planning did not begin within {request.timeout:g} s: {why}"
                ) from None
            raise
        finally:
            if waiting in self._waiting:
                self._waiting.remove(waiting)

    def _check_waiting(self, request: PlanRequest) -> None:
        """Refuse a request if too much waits: of its caller or, unless it is the first, of all.

        Raises:
            TooMuchError: why.
        """
        own = sum(one.request.caller == request.caller for one in self._waiting)
        size = request.size + sum(one.request.size for one in self._waiting)
        if request.caller and own >= MOST_WAITING:
            problem = f"at most {MOST_WAITING} requests of one caller may wait to be planned"
            raise TooMuchError(problem)
        if request.caller and own and size > MOST_BYTES:
            raise TooMuchError(f"at most {MOST_BYTES >> 20} MiB of requests may wait")

    def _take_idle(self, rank: Rank) -> PlannerProcess | None:
        """Return an idle planner that serves *rank*, which then is idle no more.

        The first planner serves moving devices: it has no other work and has planned the same
        lately.  The last one serves everything else, so that the first stay free.  The last planner
        that has started serves any request.
        """
        last = max(self._planners, default=0)
        able = [one for one in self._idle if one == last or rank <= one]
        if not able:
            return None
        return self._idle.pop(min(able) if rank is Rank.URGENT else max(able))

    def _release(self, planner: PlannerProcess) -> None:
        """Hand a planner to the next waiting request."""
        self._idle[planner.number] = planner
        self._serve_waiting()

    def _serve_waiting(self) -> None:
        for waiting in [one for one in self._waiting if not one.turn.done()]:
            planner = self._take_idle(waiting.rank)
            if planner is not None:
                waiting.turn.set_result(planner)

    def _discard(self, planner: PlannerProcess, why: str) -> None:
        """End a planner, and start another one in its place."""
        if not self._is_closing:
            _log.info("planner %d: replaced: %s", planner.pid, why)
            del self._planners[planner.number]
            planner.end()
            self._serve_waiting()  # another planner may be the last now
            self._spawn(self._start(planner.number))

    def _note_end(self, planner: PlannerProcess) -> None:
        """Replace an idle planner that has ended; a busy one fails its request, which does it."""
        if self._idle.get(planner.number) is planner:
            del self._idle[planner.number]
            self._discard(planner, "it ended")

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
                self._start_problem = str(error)
                self._has_tried.set()
                _log.error("a planner did not start: %s", error)
                if server is self._server:
                    self._end_server()
                await asyncio.sleep(_RESTART)
                continue
            self._start_problem, self._methods = "", server.methods
            self._has_methods.set()
            self._has_tried.set()
            self._planners[number] = planner
            planner.watch(self._note_end)
            self._release(planner)
            return

    def _end_server(self) -> None:
        if self._server is not None:
            self._server.end()
            self._server = None

    def _spawn(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.get_running_loop().create_task(work)
        self._work.add(task)
        task.add_done_callback(self._work.discard)


def default_processes() -> int:
    """Return how many planners there are unless the settings say."""
    return max(3, min(len(os.sched_getaffinity(0)), 6))
