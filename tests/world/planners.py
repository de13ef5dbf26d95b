"""Planner processes in virtual time: the pool and the work are the daemon's own.

What lies between them is replaced: a message is there at once, and the seed decides how long the
planner takes.
"""

from __future__ import annotations

import asyncio
import copy
import functools
import os
import pickle
from collections import OrderedDict, deque

from processes import PLANNING, Process

from orientd.daemon import devices
from orientd.daemon.planners import pool, reporting, worker
from orientd.daemon.planners.messages import HEADER, packed
from orientd.errors import DaemonError

FORKING = (0.001, 0.005, 0.05)
"""Times that a planner process may take to start, s; the seed decides."""

_COUNT = 3
"""Planners of a daemon, on whatever machine."""

_RESIDENT = 40 << 20


class ForkServer:
    """Start planners.

    Attributes:
        methods: the families of curves, as a serialised ``ListMethodsResponse``.
    """

    world = None

    def __init__(self, settings):
        self.methods, self._planners = b"", []
        self._worker = worker.Worker(settings)

    async def fork(self, number, nice):
        del nice
        await asyncio.sleep(self.world.scheduler.random.choice(FORKING))
        self.methods = self.methods or reporting.methods()
        own = copy.copy(self._worker)
        own._known = OrderedDict()
        planner = PlannerProcess(self.world, number, own)
        self._planners.append(planner)
        return planner

    def end(self):
        for planner in self._planners:
            planner.kill()


class PlannerProcess:
    """A planner process; it takes one request at a time.

    Attributes:
        number: which of the pool's it is.
        pid: its process id.
        requests: how many it was given.
    """

    def __init__(self, world, number, own):
        self._scheduler, self._loop = world.scheduler, asyncio.get_running_loop()
        self._process = process = Process(world.scheduler, "planner")
        self.number, self.pid, self.requests = number, process.pid, 0
        self._given, self._answers = deque(), asyncio.Queue()
        self._ended = None
        world.add(process)
        world.present().at_end(self.kill)
        process.at_end(self._note_end)
        serve = functools.partial(worker.serve, self, own)
        self._serving = self._scheduler.spawn(serve, process.group, process.group)

    # What the pool calls

    async def plan(self, request, file):
        self.requests += 1
        self._given.append((packed(request), os.dup(file.descriptor)))
        self._scheduler.wake(self._serving)
        return await self._answer(lambda: f" while {file.stage}")

    async def rest(self):
        return await self._answer(str)

    async def _answer(self, where):
        answer = await self._answers.get()
        if answer is None:
            self._answers.put_nowait(None)
            raise DaemonError(f"the planner process {self.pid} ended{where()}")
        return answer

    def watch(self, ended):
        self._ended = ended

    def kill(self):
        self._process.kill()

    def end(self):
        self._ended = None
        self.kill()

    def _note_end(self):
        if not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._tell_end)

    def _tell_end(self):
        self._answers.put_nowait(None)
        if self._ended is not None:
            self._ended(self)

    # What its work calls

    def receive(self, descriptors):
        """Return the next request, which takes its time, and the descriptor of its file."""
        while not self._given:
            self._scheduler.wait()
        request, descriptor = self._given.popleft()
        descriptors.append(descriptor)
        self._scheduler.sleep(self._scheduler.random.choice(PLANNING))
        return _content(request)

    def sendall(self, message):
        self._loop.call_soon_threadsafe(self._answers.put_nowait, _content(message))


def _content(message):
    return pickle.loads(bytes(message)[HEADER.size :])


def of_planners(world):
    """Return what a pool of planners finds in a world: owners, names and values to replace."""
    return [
        (ForkServer, "world", world),
        (pool, "ForkServer", ForkServer),
        (devices, "default_processes", lambda: _COUNT),
        (worker, "_received_request", lambda peer, descriptors: peer.receive(descriptors)),
        (worker, "resident", lambda: _RESIDENT),
    ]
