"""The planner process: it plans what it is asked to, one request after the other.

It knows the devices by their settings and their drivers, which it never opens.  Planners are forked
from a process that has loaded everything and plans nothing, so that each is there within
milliseconds, and shares what was loaded.  All end with the daemon, whichever way that ends.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import mmap
import os
import signal
import socket
from collections import OrderedDict
from collections.abc import Iterable
from types import FrameType
from typing import Any

from google.protobuf.message import DecodeError

from orientd.daemon.planners import reporting
from orientd.daemon.planners.jobs import (
    FIRST,
    HEADER,
    PID,
    STAGE_BYTES,
    Failure,
    Methods,
    PlanInput,
    PlannedRecords,
    PlannerAnswer,
    PlannerDevice,
    Question,
    Records,
    RemainingRecords,
    frame,
    unframed,
)
from orientd.daemon.planners.record_file import write
from orientd.driver import make_driver
from orientd.errors import OrientdError, PlanError, RequestError
from orientd.planner import DevicePlanner, Frame, Keyframe, Motion, MotionRequest, State
from orientd.rpc import control_pb2 as pb
from orientd.rpc import to_request

KEPT = 2
"""Motions that are remembered, in case more of one is asked for."""

_BLOCK = 8192
"""Records worked out at a time: more would take memory without being quicker."""

_PR_SET_PDEATHSIG = 1


class Abandoned(BaseException):
    """Nobody waits any more for what is being done."""


class Work:
    """What a planner can do, apart from hearing of it."""

    def __init__(self, devices: Iterable[PlannerDevice]) -> None:
        """Make a planner for each device."""
        self._planners = {device.name: _planner(device) for device in devices}
        self._memory: memoryview | None = None
        self._known: OrderedDict[str, tuple[Motion, int, Frame | None]] = OrderedDict()

    def show_stage(self, memory: memoryview) -> None:
        """Write to shared memory what is being done, for whoever gives it up."""
        self._memory = memory

    def warm_up(self) -> None:
        """Plan something small for each device, so that nothing is left to be loaded."""
        q = ((1.0, 0.0, 0.0, 0.0), (0.9999500004166653, 0.0, 0.0, 0.009999833334166664))
        for planner in self._planners.values():
            request = MotionRequest([Keyframe(one) for one in q])
            try:
                planner.plan(request, start=State.at_rest(q[0]), joints=(), is_offline=True)
            except (OrientdError, ValueError):
                continue  # not every device can do that; what it loads is loaded

    def do(self, question: Question, file: int = -1) -> bytes | PlannedRecords:
        """Return what was asked for, once records have been written to *file* where these were.

        Raises:
            OrientdError: it cannot be done.
        """
        what, job = question.what, question.job
        if isinstance(what, Methods):
            return reporting.methods()
        if job is None:
            raise ValueError("the question needs a job")
        motion, leave, frame = self._motion(job)
        self._say(f"reporting on {motion.record_count} records")
        if not isinstance(what, Records):
            return reporting.plan_response(motion, what.rate_hz)
        most = min(what.count, FIRST) if what.is_first else what.count
        rows = motion.rows(what.first, min(most, motion.record_count - what.first))
        write(file, 0, rows)
        return PlannedRecords(
            facts=motion.facts,
            leave=leave,
            plan=reporting.plan(motion).SerializeToString() if what.is_first else b"",
            response=(
                reporting.plan_response(motion, what.rate_hz, frame) if what.rate_hz else b""
            ),
            shape=(rows.shape[0], rows.shape[1]),
            frame=frame,
        )

    def rest(self, question: Question, file: int = -1) -> RemainingRecords | None:
        """Return what follows the answer to *question*, if anything does."""
        what, job = question.what, question.job
        if not isinstance(what, Records) or not what.is_first or job is None:
            return None
        motion, _, _ = self._known[job.motion_id]
        count = min(what.count, motion.record_count)
        for first in range(FIRST, count, _BLOCK):
            write(file, first, motion.rows(first, min(_BLOCK, count - first)))
        return RemainingRecords(count, reporting.event(motion))

    def _motion(self, job: PlanInput) -> tuple[Motion, int, Frame | None]:
        """Return the motion of a job, where it leaves the one before, and in which frame it is."""
        known = self._known.get(job.motion_id)
        if known is not None:
            return known
        self._say("reading the request")
        try:
            message = pb.MotionRequest.FromString(job.motion)
        except DecodeError as error:
            raise RequestError("motion", f"cannot be read: {error}") from error
        request = to_request(message)
        duration = f", duration {request.duration}" if request.duration else ""
        self._say(f"planning {len(request.keyframes)} keyframes with {request.method}{duration}")
        planner = self._planners[job.device]
        leave, after = 0, job.after
        if after is not None:
            leave, motion = planner.blend(
                after.first,
                request,
                tolerance=after.tolerance,
                earliest=after.earliest,
                motion_id=job.motion_id,
            )
        elif job.start is not None:
            motion = planner.plan(
                request,
                start=job.start,
                joints=job.joints,
                before=job.before,
                rates=job.rates,
                motion_id=job.motion_id,
            )
        else:
            raise ValueError("the job needs a start")
        known = self._known[job.motion_id] = motion, leave, planner.report_frame(request)
        while len(self._known) > KEPT:
            self._known.popitem(last=False)
        return known

    def _say(self, stage: str) -> None:
        if self._memory is not None:
            text = stage.encode()[: STAGE_BYTES - 1]
            self._memory[: len(text) + 1] = text + b"\0"


def _planner(device: PlannerDevice) -> DevicePlanner:
    driver = make_driver(device.name, device.driver, device.options, device.period_ns)
    period = device.period_ns * 1e-9
    return DevicePlanner(driver, limits=device.limits, period=period, frames=device.frames)


def main(channel: int) -> None:
    """Be what planners are forked from, until the daemon says no more.

    Args:
        channel: descriptor of a stream socket to the daemon.  After the first frame each byte comes
            with the descriptors of a planner's own socket and memory, and is answered with its pid.
    """
    _end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the daemon's to hear
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for planners here
    with socket.socket(fileno=channel) as peer:
        devices = _framed(peer, [])
        if devices is None:
            return
        work = Work(devices)
        work.warm_up()
        # What there is now is shared with every planner, as long as nobody touches it.
        gc.collect()
        gc.freeze()
        peer.sendall(frame(PlannerAnswer(resident=resident())))
        while True:
            asked, descriptors, _, _ = socket.recv_fds(peer, 1, 2)
            if not asked:
                return
            pid = os.fork()
            if not pid:
                peer.close()
                _plan(work, *descriptors)
                os._exit(0)
            for descriptor in descriptors:
                os.close(descriptor)
            peer.sendall(PID.pack(pid))


def _plan(work: Work, channel: int, memory: int) -> None:
    """Be a planner until the daemon says no more."""
    _end_with_parent()
    with (
        socket.socket(fileno=channel) as peer,
        mmap.mmap(memory, STAGE_BYTES) as block,
        memoryview(block) as view,
        contextlib.suppress(ConnectionError),
    ):
        work.show_stage(view)
        _serve(peer, work)


def _serve(peer: socket.socket, work: Work) -> None:
    is_busy = False
    files: list[int] = []

    def give_up(_number: int, _frame: FrameType | None) -> None:
        nonlocal is_busy
        if is_busy:
            is_busy = False
            raise Abandoned

    signal.signal(signal.SIGUSR1, give_up)
    while (question := _framed(peer, files)) is not None:
        content: bytes | PlannedRecords | None = None
        failure: Failure | None = None
        try:
            is_busy = True
            content, failure = _done(work, question, files)
            is_busy = False
        except Abandoned:
            failure = Failure.of(PlanError("nobody waits for it any more"))
        peer.sendall(frame(PlannerAnswer(content, failure, resident())))
        # Whoever waits for the motion does not wait for the rest of it.
        if failure is None and (rest := work.rest(question, *files)) is not None:
            peer.sendall(frame(PlannerAnswer(rest, None, resident())))
        while files:
            os.close(files.pop())


def _done(
    work: Work, question: Question, files: list[int]
) -> tuple[bytes | PlannedRecords | None, Failure | None]:
    """Return what was asked for, or why it cannot be had; to give it up interrupts both."""
    try:
        return work.do(question, *files), None
    except OrientdError as error:
        return None, Failure.of(error)
    except MemoryError:
        return None, Failure.of(PlanError("the planner has not enough memory for it"))
    except Exception as error:  # noqa: BLE001 - one request fails, and says why
        return None, Failure.of(PlanError(f"planning failed: {type(error).__name__}: {error}"))


def _framed(peer: socket.socket, files: list[int]) -> Any:  # noqa: ANN401 - whatever was framed
    """Return what comes next, and add the descriptor that comes with it; ``None`` at the end."""
    header, descriptors, _, _ = socket.recv_fds(peer, HEADER.size, 1)
    files += descriptors
    more = _exactly(peer, HEADER.size - len(header)) if header else None
    body = None if more is None else _exactly(peer, HEADER.unpack(header + more)[0])
    return None if body is None else unframed(body)


def _exactly(peer: socket.socket, count: int) -> bytearray | None:
    taken = bytearray(count)
    view, have = memoryview(taken), 0
    while have < count:
        more = peer.recv_into(view[have:])
        if not more:
            return None
        have += more
    return taken


def resident() -> int:
    """Return how many bytes of memory this process uses."""
    with open("/proc/self/statm", encoding="ascii") as statm:  # noqa: PTH123 - after every plan
        return int(statm.read().split()[1]) * mmap.PAGESIZE


def _end_with_parent() -> None:
    """Have the kernel kill this process when the daemon is killed, in the middle of a plan too."""
    parent = os.getppid()
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        raise SystemExit
