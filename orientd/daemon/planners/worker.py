"""The planner process: it plans what it is asked to, one request after the other.

It knows the devices by their settings and their drivers, which it never opens.  Planners are forked
from a process that has loaded everything and plans nothing, so that each is there within
milliseconds, and shares what was loaded.  All end with the daemon, whichever way that ends.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import gc
import mmap
import os
import pickle
import signal
import socket
from collections import OrderedDict
from collections.abc import Iterable

from orientd import motion_file
from orientd.config import DeviceSettings
from orientd.daemon.planners import reporting
from orientd.daemon.planners.messages import (
    FIRST,
    HEADER,
    Planned,
    PlanRequest,
    RecordFile,
    Rest,
    packed,
    unpacked_request,
)
from orientd.errors import OrientdError, PlanError
from orientd.model.request import Frame, MotionRequest
from orientd.planner.blending import NOT_BLENDED
from orientd.planner.facts import HISTORY
from orientd.planner.motion import Motion
from orientd.planner.recorded import RecordedMotion, rows_of, start_of
from orientd.planner.state import State
from orientd.protocol.columns import keyframe_rows

KEPT = 2
"""Motions that are remembered, in case more of one is asked for."""

_SMALL = b"keyframes: [{rotation_vector: [0, 0, 0]}, {rotation_vector: [0, 0, 0.02]}]"
"""A motion file that needs everything which reads one."""

_BLOCK = 8192
"""Records worked out at a time: more would take memory without being quicker."""

_PR_SET_PDEATHSIG = 1


class Worker:
    """Plans for some devices, and remembers the last motions."""

    def __init__(self, devices: Iterable[DeviceSettings]) -> None:
        """Make a planner for each device."""
        self._planners = {device.name: device.planner() for device in devices}
        self._known: OrderedDict[str, tuple[Motion, int, Frame | None]] = OrderedDict()
        # A motion that is planned again, from another record, is not read again.
        self._read = functools.lru_cache(1)(_read)

    def warm_up(self) -> None:
        """Plan something small for each device, so that nothing is left to be loaded."""
        request = self._read(_SMALL, "", b"", 2)
        for planner in self._planners.values():
            # Not every device can do that; what it loads is loaded.
            with contextlib.suppress(OrientdError, ValueError):
                start = State.at_rest(request.keyframes[0].q)
                planner.plan(request, start=start, joints=(), is_offline=True, unix_ns=0)

    def plan(self, request: PlanRequest, file: RecordFile) -> Planned:
        """Plan a motion and write records of it to *file*, the first of a whole chunk at most.

        Raises:
            OrientdError: it cannot be planned.
        """
        motion, leave, frame = self._motion(request, file)
        file.say(f"reporting on {motion.record_count} records")
        first, count, rate_hz = request.first, request.count, request.rate_hz
        end = min(first + (count if first else min(count, FIRST)), motion.record_count)
        file.write(first or -HISTORY, motion.recorded(first or -HISTORY, end).packed())
        # A report on a plan that is kept, without records, is in the device's own coordinates.
        seen_in = frame if count else None
        return Planned(
            facts=motion.facts,
            leave=leave,
            plan=b"" if first else reporting.plan_of(motion).SerializeToString(),
            samples=reporting.plan_samples(motion, rate_hz, seen_in) if rate_hz else b"",
            frame=frame,
            end=end,
        )

    def rest(self, request: PlanRequest, planned: Planned, file: RecordFile) -> Rest:
        """Write the other records of a first chunk; return the rest of the answer."""
        motion, *_ = self._known[request.motion_id]
        end = min(request.count, motion.record_count)
        for first in range(planned.end, end, _BLOCK):
            file.write(first, motion.recorded(first, min(first + _BLOCK, end)).packed())
        return Rest(max(end, planned.end), reporting.event_samples(motion), resident())

    def _motion(self, asked: PlanRequest, file: RecordFile) -> tuple[Motion, int, Frame | None]:
        """Return the motion, where it leaves the one before, and in which frame it is."""
        known = self._known.get(asked.motion_id)
        if known is not None:
            return known
        request = self._read(asked.motion, asked.source, asked.columns, asked.keyframes)
        duration = f", duration {request.duration}" if request.duration else ""
        file.say(f"planning {len(request.keyframes)} keyframes with {request.method}{duration}")
        planner, rows = self._planners[asked.device], rows_of(asked.records)
        leave, after = 0, asked.after
        if after is not None:
            left = max(0, after.record_count - asked.earliest) * after.period
            leave, motion = planner.blend(
                RecordedMotion(after, rows, after.record_count - len(rows)),
                request,
                tolerance=asked.tolerance,
                earliest=asked.earliest,
                motion_id=asked.motion_id,
                unix_ns=asked.unix_ns + round(1e9 * left),
            )
        else:
            start = start_of(rows)._asdict()
            motion = planner.plan(
                request,
                **start,
                motion_id=asked.motion_id,
                unix_ns=asked.unix_ns,
            )
            if asked.tolerance > 0.0:
                motion = motion.noted(f"{NOT_BLENDED}: the device was at rest")
        known = self._known[asked.motion_id] = motion, leave, planner.report_frame(request)
        while len(self._known) > KEPT:
            self._known.popitem(last=False)
        return known


def _read(text: bytes, source: str, columns: bytes, most: int) -> MotionRequest:
    """Return the request in a text, or in a text and columns.

    Raises:
        RequestError: it is not well formed, or has more keyframes than *most*.
    """
    rows = keyframe_rows(columns, most) if columns else ()
    return motion_file.loads(text, source, rows=rows, most=most)


def main(channel: int) -> None:
    """Fork planners until the daemon closes the channel.

    Args:
        channel: descriptor of a stream socket to the daemon.  The first message is the list of
            devices, and is answered with the methods of the planner.  After it each byte comes with
            the descriptor of a planner's own socket, and is answered with its process id.
    """
    _end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the daemon's to hear
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the kernel reaps ended planners
    with socket.socket(fileno=channel) as peer:
        body = _received(peer, [])
        if body is None:
            return
        worker = Worker(pickle.loads(body))
        worker.warm_up()
        # Planners share this memory until one of them writes to it.
        gc.collect()
        gc.freeze()
        peer.sendall(packed(reporting.methods()))
        while True:
            asked, descriptors, _, _ = socket.recv_fds(peer, 1, 1)
            if not asked:
                return
            pid = os.fork()
            if not pid:
                peer.close()
                _end_with_parent()
                with socket.socket(fileno=descriptors[0]) as own, contextlib.suppress(OSError):
                    serve(own, worker)
                os._exit(0)
            os.close(descriptors[0])
            peer.sendall(packed(pid))


def serve(peer: socket.socket, worker: Worker) -> None:
    """Serve as a planner until the daemon closes the channel."""
    descriptors: list[int] = []
    request: PlanRequest | None
    while (request := _received_request(peer, descriptors)) is not None:
        file = RecordFile(descriptors.pop())
        answer: Planned | OrientdError
        try:
            answer = worker.plan(request, file)
        except OrientdError as error:
            answer = error
        except MemoryError:
            answer = PlanError("the planner has not enough memory for it")
        except Exception as error:  # noqa: BLE001 - one request fails, and says why
            answer = PlanError(f"planning failed: {type(error).__name__}: {error}")
        peer.sendall(packed(answer))
        # The caller gets the answer before the rest is written.
        rest = Rest(0, b"", resident())
        if isinstance(answer, Planned) and request.count and not request.first:
            with contextlib.suppress(MemoryError):
                rest = worker.rest(request, answer, file)
        peer.sendall(packed(rest))


def _received_request(peer: socket.socket, descriptors: list[int]) -> PlanRequest | None:
    """Return the next request, and add the descriptor that comes with it; ``None`` at the end."""
    parts = [_received(peer, descriptors) for _ in range(3)]
    found = [part for part in parts if part is not None]
    return unpacked_request(*found) if len(found) == len(parts) else None


def _received(peer: socket.socket, descriptors: list[int]) -> bytearray | None:
    """Return the next message, and add the descriptor that comes with it; ``None`` at the end."""
    header, received, _, _ = socket.recv_fds(peer, HEADER.size, 1)
    descriptors += received
    more = _exactly(peer, HEADER.size - len(header)) if header else None
    return None if more is None else _exactly(peer, HEADER.unpack(header + more)[0])


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
    """Let the kernel kill this process when its parent is killed, even in the middle of a plan."""
    parent = os.getppid()
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        raise SystemExit
