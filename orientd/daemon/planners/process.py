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

import numpy as np

from orientd.daemon.planners.jobs import (
    BLOCK_BYTES,
    HEADER,
    STAGE_BYTES,
    Answer,
    Planned,
    Question,
    SetUp,
    frame,
    unframed,
)
from orientd.errors import DaemonError
from orientd.rotation import Floats

_log = logging.getLogger(__name__)

GIVE_UP = 1.0
"""How long a planner may take to end what nobody waits for any more, s; then it is killed."""

_NICE = 5
"""A planner yields to the daemon and to whatever else keeps a device going."""


class PlannerProcess:
    """A planner process; it takes one question at a time.

    Attributes:
        number: which of the pool's it is.
        answers: how many questions it has answered.
    """

    def __init__(self, number: int, *, nice: int = _NICE) -> None:
        self.number = number
        self.answers = 0
        self._nice = nice
        self._process: subprocess.Popen[bytes] | None = None
        self._memory = os.memfd_create(f"orientd-planner-{number}", os.MFD_CLOEXEC)
        os.ftruncate(self._memory, STAGE_BYTES + BLOCK_BYTES)
        self._block = mmap.mmap(self._memory, STAGE_BYTES + BLOCK_BYTES)

    async def start(self, set_up: SetUp) -> None:
        """Start the process and wait until it is warm.

        Raises:
            DaemonError: it has ended instead.
        """
        ours, theirs = socket.socketpair()
        with theirs:
            arguments = [str(theirs.fileno()), str(self._memory)]
            self._process = subprocess.Popen(
                [sys.executable, "-m", "orientd.daemon.planners", *arguments],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno(), self._memory],
                cwd="/",
            )
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, self._nice)
        self._reader, self._writer = await asyncio.open_connection(sock=ours)
        self._writer.write(frame(set_up))
        await self._hear()

    @property
    def pid(self) -> int | None:
        """Its process id."""
        return None if self._process is None else self._process.pid

    async def ask(self, question: Question) -> tuple[Answer, Floats | None]:
        """Return the answer to a question, with its records.

        Raises:
            DaemonError: the process has ended instead.
        """
        self._block[0] = 0
        self._writer.write(frame(question))
        answer = await self._hear()
        self.answers += 1
        content = answer.content
        if not isinstance(content, Planned):
            return answer, None
        rows, columns = content.shape
        here = np.frombuffer(self._block, np.float64, rows * columns, STAGE_BYTES)
        copied = here.reshape(rows, columns).copy()
        return answer, copied

    @property
    def stage(self) -> str:
        """What it is at, or was at last."""
        return self._block[:STAGE_BYTES].partition(b"\0")[0].decode(errors="replace")

    def give_up(self) -> None:
        """Tell it that nobody waits any more for what it is doing."""
        if self._process is not None and self._process.poll() is None:
            self._process.send_signal(signal.SIGUSR1)

    def kill(self) -> None:
        """End it at once; whoever waits for its answer hears of that."""
        if self._process is not None and self._process.poll() is None:
            self._process.kill()

    async def end(self) -> None:
        """Let it end, and release what it used."""
        if self._process is not None:
            with contextlib.suppress(AttributeError):
                self._writer.close()
            for _ in range(100):
                if self._process.poll() is not None:
                    break
                await asyncio.sleep(0.01)
            self.kill()
            self._process.wait()
        with contextlib.suppress(BufferError):
            self._block.close()
        if self._memory >= 0:
            os.close(self._memory)
            self._memory = -1

    async def _hear(self) -> Answer:
        try:
            (length,) = HEADER.unpack(await self._reader.readexactly(HEADER.size))
            answer: Answer = unframed(await self._reader.readexactly(length))
        except (asyncio.IncompleteReadError, ConnectionError) as error:
            raise DaemonError(self._ending()) from error
        return answer

    def _ending(self) -> str:
        """Return how it came to its end."""
        if self._process is None:
            return "the planner process was never started"
        try:
            status = self._process.wait(GIVE_UP)
        except subprocess.TimeoutExpired:
            self.kill()
            status = self._process.wait()
        how = f"was ended by {signal.Signals(-status).name}" if status < 0 else "ended"
        what = f" while {self.stage}" if self.stage else ""
        return f"the planner process {self._process.pid} {how}{what}"
