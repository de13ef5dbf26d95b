"""One planner process, seen from the daemon: started, asked, given up, killed."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import mmap
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from orientd.daemon.planners.jobs import (
    HEADER,
    PID,
    STAGE_BYTES,
    PlannerAnswer,
    PlannerDevice,
    Question,
    frame,
    unframed,
)
from orientd.daemon.planners.record_file import RecordFile
from orientd.errors import DaemonError

_log = logging.getLogger(__name__)

GIVE_UP = 1.0
"""How long a planner may take to end what nobody waits for any more, s; then it is killed."""


class ForkServer:
    """The process that planners are forked from."""

    def __init__(self) -> None:
        """Start nothing yet."""
        self._process: subprocess.Popen[bytes] | None = None
        self._turn = asyncio.Lock()

    async def start(self, devices: Sequence[PlannerDevice]) -> None:
        """Start the process and wait until it has loaded what plans for *devices*.

        Raises:
            DaemonError: it has ended instead.
        """
        self._socket, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "orientd.daemon.planners", str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                process_group=0,  # out of the reach of a Ctrl-C, while it imports too
                cwd="/",
                # Threads would not outlive a fork, and sums must not depend on how many there are.
                env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
            )
        self._reader, self._writer = await asyncio.open_connection(sock=self._socket)
        self._writer.write(frame(devices))
        try:
            await _frame_from(self._reader)
        except (asyncio.IncompleteReadError, ConnectionError) as error:
            status = await asyncio.to_thread(self._process.wait)
            raise DaemonError(f"it ended with status {status}") from error

    async def fork(self, descriptors: list[int]) -> int:
        """Return the process id of a new planner, which is given two descriptors.

        Raises:
            DaemonError: the process has ended.
        """
        async with self._turn:
            try:
                socket.send_fds(self._socket, [b"f"], descriptors)
                (pid,) = PID.unpack(await self._reader.readexactly(PID.size))
            except (asyncio.IncompleteReadError, OSError) as error:
                raise DaemonError("what planners are forked from has ended") from error
        return int(pid)

    def end(self) -> None:
        """End the process; its planners go on to whoever has them."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._writer.close()


class PlannerProcess:
    """A planner process; it takes one question at a time.

    Attributes:
        number: which of the pool's it is.
        questions: how many it was asked.
        pid: its process id; 0 before it was started.
    """

    def __init__(self, number: int) -> None:
        self.number = number
        self.questions = self.pid = 0
        self._handle = -1
        self._memory = os.memfd_create(f"orientd-planner-{number}", os.MFD_CLOEXEC)
        os.ftruncate(self._memory, STAGE_BYTES)
        self._block = mmap.mmap(self._memory, STAGE_BYTES)

    async def start(self, server: ForkServer, *, nice: int) -> None:
        """Have the process forked.

        Args:
            server: forks it.
            nice: how far it yields to others.

        Raises:
            DaemonError: it cannot be.
        """
        ours, theirs = socket.socketpair()
        with theirs:
            self.pid = await server.fork([theirs.fileno(), self._memory])
        try:
            self._handle = os.pidfd_open(self.pid)
            os.setpriority(os.PRIO_PROCESS, self.pid, nice)
        except ProcessLookupError as error:
            raise DaemonError(f"the planner process {self.pid} ended at once") from error
        except PermissionError:
            _log.debug("planner %d: not permitted to be given the nice value %d", self.pid, nice)
        self._socket = ours
        self._reader, self._writer = await asyncio.open_connection(sock=ours)

    async def ask(self, question: Question, file: RecordFile | None = None) -> PlannerAnswer:
        """Return the answer to a question, once its records are in *file*.

        Raises:
            DaemonError: the process has ended instead.
        """
        self._block[0] = 0
        self.questions += 1
        asked = frame(question)
        if file is not None:
            # The first bytes take the descriptor along; nothing else is on its way meanwhile.
            with contextlib.suppress(ConnectionError):
                socket.send_fds(self._socket, [asked[: HEADER.size]], [file.descriptor])
            asked = asked[HEADER.size :]
        self._writer.write(asked)
        return await self.hear()

    async def hear(self) -> PlannerAnswer:
        """Return the next answer; the second one to a question that has two.

        Raises:
            DaemonError: the process has ended instead.
        """
        try:
            answer: PlannerAnswer = await _frame_from(self._reader)
        except (asyncio.IncompleteReadError, ConnectionError) as error:
            what = f" while {self.stage}" if self.stage else ""
            raise DaemonError(f"the planner process {self.pid} ended{what}") from error
        return answer

    @property
    def stage(self) -> str:
        """What it is at, or was at last."""
        if self._memory < 0:
            return ""
        return self._block[:STAGE_BYTES].partition(b"\0")[0].decode(errors="replace")

    def give_up(self) -> None:
        """Tell it that nobody waits any more for what it is doing."""
        self._signal(signal.SIGUSR1)

    def kill(self) -> None:
        """End it at once; whoever waits for its answer hears of that."""
        self._signal(signal.SIGKILL)

    def _signal(self, number: signal.Signals) -> None:
        if self._handle >= 0:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._handle, number)

    def end(self) -> None:
        """End it, and release what it used."""
        self.kill()
        with contextlib.suppress(AttributeError):
            self._writer.close()
        with contextlib.suppress(BufferError):
            self._block.close()
        for descriptor in (self._handle, self._memory):
            if descriptor >= 0:
                os.close(descriptor)
        self._handle = self._memory = -1


async def _frame_from(reader: asyncio.StreamReader) -> Any:  # noqa: ANN401 - whatever was framed
    (length,) = HEADER.unpack(await reader.readexactly(HEADER.size))
    return unframed(await reader.readexactly(length))
