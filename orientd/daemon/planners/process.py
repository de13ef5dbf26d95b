"""Planner processes, seen from the daemon: forked, asked, killed."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import pickle
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Sequence
from typing import Any

from orientd.config import DeviceSettings
from orientd.daemon.planners.messages import (
    HEADER,
    Planned,
    PlanRequest,
    RecordFile,
    Rest,
    packed,
    packed_request,
)
from orientd.errors import DaemonError, OrientdError

_log = logging.getLogger(__name__)

_ENVIRONMENT = {
    # Threads would not outlive a fork, and sums must not depend on their number.
    "OPENBLAS_NUM_THREADS": "1",
    # Arrays of the usual size stay in memory that is mapped, or each plan takes 100 page faults.
    "MALLOC_MMAP_THRESHOLD_": str(4 << 20),
    "MALLOC_TRIM_THRESHOLD_": str(16 << 20),
}


class ForkServer:
    """Manage the process that forks planners.

    Attributes:
        methods: the families of curves, as a serialised ``ListMethodsResponse``.
    """

    def __init__(self, devices: Sequence[DeviceSettings]) -> None:
        """Start the process, which loads what plans for *devices*.

        Raises:
            DaemonError: it cannot be started.
        """
        self.methods = b""
        self._devices = devices
        self._turn = asyncio.Lock()
        self._writer: asyncio.StreamWriter | None = None
        self._socket, theirs = socket.socketpair()
        with theirs:
            try:
                self._process = subprocess.Popen(
                    [sys.executable, "-m", "orientd.daemon.planners", str(theirs.fileno())],
                    stdin=subprocess.DEVNULL,
                    pass_fds=[theirs.fileno()],
                    process_group=0,  # out of the reach of a Ctrl-C, while it imports too
                    cwd="/",
                    env=os.environ | _ENVIRONMENT,
                )
            except OSError as error:
                self._socket.close()
                raise DaemonError(f"no planner process can be started: {error}") from error

    async def fork(self, number: int, nice: int) -> PlannerProcess:
        """Return a new planner process.

        Args:
            number: which of the pool's it is.
            nice: how far it yields to others.

        Raises:
            DaemonError: the fork server, or the planner, has ended.
        """
        ours, theirs = socket.socketpair()
        with theirs:
            try:
                async with self._turn:
                    await self._load()
                    socket.send_fds(self._socket, [b"f"], [theirs.fileno()])
                    pid = await _message(self._reader)
                handle = os.pidfd_open(pid)
            except (asyncio.IncompleteReadError, OSError) as error:
                ours.close()
                raise DaemonError("the process that forks planners has ended") from error
        try:
            os.setpriority(os.PRIO_PROCESS, pid, nice)
        except OSError:
            _log.debug("planner %d: cannot be given the nice value %d", pid, nice)
        return PlannerProcess(number, pid, handle, ours, *await asyncio.open_connection(sock=ours))

    async def _load(self) -> None:
        """Wait until the process has loaded everything."""
        if self._writer is None:
            self._reader, self._writer = await asyncio.open_connection(sock=self._socket)
            self._writer.write(packed(self._devices))
            self.methods = await _message(self._reader)

    def end(self) -> None:
        """End the process, and its planners with it."""
        self._process.kill()
        self._process.wait()
        if self._writer is not None:
            self._writer.close()
        self._socket.close()


class PlannerProcess:
    """A planner process; it takes one request at a time.

    Attributes:
        number: which of the pool's it is.
        pid: its process id.
        requests: how many it was given.
    """

    def __init__(
        self,
        number: int,
        pid: int,
        handle: int,
        connection: socket.socket,
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
    ) -> None:
        self.number, self.pid, self.requests = number, pid, 0
        self._handle, self._socket = handle, connection
        self._reader, self._writer = reader, writer

    async def plan(self, request: PlanRequest, file: RecordFile) -> Planned | OrientdError:
        """Return the answer to a request, once its records are in *file*; see :meth:`.Worker.plan`.

        Raises:
            DaemonError: the process has ended instead.
        """
        self.requests += 1
        parts = packed_request(request)
        # The first bytes take the descriptor along; nothing else is on its way meanwhile.
        with contextlib.suppress(ConnectionError):
            sent = socket.send_fds(self._socket, parts, [file.descriptor])
            for part in parts:
                if sent < len(part):
                    self._writer.write(memoryview(part)[sent:])
                sent = max(0, sent - len(part))
        try:
            answer: Planned | OrientdError = await _message(self._reader)
        except (asyncio.IncompleteReadError, ConnectionError) as error:
            problem = f"the planner process {self.pid} ended while {file.stage}"
            raise DaemonError(problem) from error
        return answer

    async def rest(self) -> Rest:
        """Return what follows each answer.

        Raises:
            DaemonError: the process has ended instead.
        """
        try:
            rest: Rest = await _message(self._reader)
        except (asyncio.IncompleteReadError, ConnectionError) as error:
            raise DaemonError(f"the planner process {self.pid} ended") from error
        return rest

    def watch(self, ended: Callable[[PlannerProcess], object]) -> None:
        """Call *ended* with it once the process has ended by itself, whatever it does then."""
        loop = asyncio.get_running_loop()

        def tell() -> None:
            loop.remove_reader(self._handle)
            ended(self)

        loop.add_reader(self._handle, tell)

    def kill(self) -> None:
        """End it at once; a call that waits for its answer fails."""
        if self._handle >= 0:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._handle, signal.SIGKILL)

    def end(self) -> None:
        """End it, and release what it used."""
        self.kill()
        self._writer.close()
        if self._handle >= 0:
            asyncio.get_running_loop().remove_reader(self._handle)
            os.close(self._handle)
        self._handle = -1


async def _message(reader: asyncio.StreamReader) -> Any:  # noqa: ANN401 - whatever was sent
    (length,) = HEADER.unpack(await reader.readexactly(HEADER.size))
    return pickle.loads(await reader.readexactly(length))
