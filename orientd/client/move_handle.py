"""A running motion, from its client's point of view."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterator
from typing import Protocol

import grpc

from orientd.errors import (
    DaemonError,
    LateError,
    MotionFault,
    MotionStopped,
    OrientdError,
    StateError,
)
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import ending

_ENDED_EARLY: dict[int, type[MotionStopped | MotionFault]] = {
    pb.OUTCOME_STOPPED: MotionStopped,
    pb.OUTCOME_FAULT: MotionFault,
}


class Stream(Protocol):
    """The messages of a call, and the end of it."""

    def __iter__(self) -> Iterator[pb.MoveResponse]: ...

    def cancel(self) -> object:
        """End the call."""


class MoveHandle:
    """A motion of a device: watch it, wait for it, cancel it.

    Attributes:
        plan: its plan.
        motion_number: 1 for the first motion of the device.
        timing: durations before its first setpoint.
        speed: of the device at its start, which an earlier command may have set; 1 is as planned.
        lease: the lease that the move took; ``None`` if the client had one.
        device: the device that it was asked for; empty for the only one.
        is_endless: whether another motion takes over before its end, until it is stopped.
        is_cancelled: whether this client has stopped it, or tried to.
        is_told: whether :meth:`wait` has said how it ended.
    """

    def __init__(
        self,
        stream: Stream,
        *,
        explain: Callable[..., OrientdError],
        stop: Callable[[int], object],
        device: str = "",
        has_start_time: bool = False,
        armed_by: float | None = None,
    ) -> None:
        """Wait until the motion has begun.

        Args:
            stream: the call, whose messages are read here.
            explain: converts the exception of a failed call; see :meth:`.Connection.explain`.
            stop: ends the motion with a number, on its path if it runs.
            device: the device that it was asked for; empty for the only one.
            has_start_time: whether it begins at a time that was asked for.
            armed_by: time at which to cancel the call unless the motion has begun or is armed, s,
                by :func:`time.monotonic`; ``None`` for never.

        Raises:
            LateError: the motion was not armed by *armed_by*.
            OrientdError: the motion was refused.
        """
        self.device = device
        self.is_endless = self.is_cancelled = self.is_told = False
        self._stream = stream
        self._explain = explain
        self._stop, self._has_start_time = stop, has_start_time
        self._news = threading.Condition()
        self._progress: pb.MoveProgress | None = None
        self._reports = 0
        self._summary: pb.MoveSummary | None = None
        self._error: OrientdError | None = None
        timer = None
        if armed_by is not None:
            timer = threading.Timer(armed_by - time.monotonic(), stream.cancel)
            timer.start()
        try:
            first = next(iter(stream)).started
        except grpc.RpcError as error:
            if armed_by is not None and time.monotonic() >= armed_by:
                raise LateError("the motion was not armed in time") from error
            raise explain(error) from error
        except BaseException:
            stream.cancel()
            raise
        finally:
            if timer is not None:
                timer.cancel()
        self.plan: pb.Plan = first.plan
        self.motion_number: int = first.motion_number
        self.timing: pb.MoveTiming = first.timing
        self.speed: float = first.speed
        self.lease: pb.Lease | None = first.lease if first.HasField("lease") else None
        self._reader = threading.Thread(target=self._read, name="orientd move", daemon=True)
        self._reader.start()

    @property
    def progress(self) -> pb.MoveProgress | None:
        """The newest report; ``None`` before the first, which comes within 0.05 s."""
        return self._progress

    @property
    def is_done(self) -> bool:
        """Whether the motion has ended, in any way."""
        return self._summary is not None or self._error is not None

    def check_ends(self, paused: Collection[str]) -> None:
        """Check that it ends by itself soon, before the end of a ``with`` block waits for it.

        Args:
            paused: names of the devices that are paused.

        Raises:
            StateError: it does not.
        """
        progress, why = self._progress, ""
        if self.is_endless:
            why = "turns until it is stopped"
        elif self._has_start_time and (progress is None or not progress.path_time):
            why = "has a later start time"
        elif self.device in paused if self.device else paused:
            why = "is paused"
        if why and not self.is_done:
            raise StateError(
                f"motion {self.motion_number} {why}, so the end of `with` stopped it: call wait() "
                "or stop() before"
            )

    def wait(self, timeout: float | None = None, *, check: bool = True) -> pb.MoveSummary:
        """Wait until the motion has ended, and return its summary.

        Args:
            timeout: longest wait, s; the motion continues after it.
            check: whether to raise an error, which has the summary, if the motion was stopped or
                ended by a fault.  A motion that another one has replaced, or that was not on target
                in time, is no error: see ``outcome`` of its summary.

        Raises:
            MotionStopped: it was stopped, and *check* is true.
            MotionFault: a fault of the device ended it, and *check* is true.
            TimeoutError: it has not ended.
            OrientdError: the daemon was lost.
        """
        with self._news:
            if not self._news.wait_for(lambda: self.is_done, timeout):
                raise TimeoutError(f"motion {self.motion_number} continues after {timeout:g} s")
        self.is_told = True
        if self._summary is None:
            raise self._error or DaemonError("the daemon did not say how the motion ended")
        ended_early = _ENDED_EARLY.get(self._summary.outcome)
        if check and ended_early is not None:
            error = ended_early(f"motion {self.motion_number}: {ending(self._summary)}")
            error.summary = self._summary
            raise error
        return self._summary

    def cancel(self) -> None:
        """Stop the motion on its path; :meth:`wait` ends when it has come to rest.

        A waiting motion is removed from the queue, without effect on the running one.

        Raises:
            DaemonError: the daemon or the servo does not answer.
        """
        self.is_cancelled = True
        if not self.is_done:
            self._stop(self.motion_number)

    def abandon(self) -> None:
        """Close the call, which makes the daemon stop the motion on its path."""
        self._stream.cancel()
        self._reader.join()

    def __iter__(self) -> Iterator[pb.MoveProgress]:
        """Yield the reports as they arrive, until the motion has ended; slow readers miss some."""
        seen = 0
        while True:
            with self._news:
                while self._reports == seen and not self.is_done:
                    self._news.wait()
                seen, progress = self._reports, self._progress
            if self.is_done:
                return
            if progress is not None:
                yield progress

    def _read(self) -> None:
        try:
            for message in self._stream:
                self._take(message)
        except grpc.RpcError as error:
            lost = (
                f"lost the daemon during motion {self.motion_number}; the device brakes on its path"
            )
            self._end(self._explain(error, lost=lost))
        else:
            self._end(DaemonError("the daemon did not say how the motion ended"))

    def _take(self, message: pb.MoveResponse) -> None:
        event = message.WhichOneof("event")
        with self._news:
            if event == "progress":
                self._progress = message.progress
                self._reports += 1
            elif event == "summary":
                self._summary = message.summary
            self._news.notify_all()

    def _end(self, error: OrientdError) -> None:
        with self._news:
            self._error = error
            self._news.notify_all()
