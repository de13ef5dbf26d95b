"""A turn at a constant rate until it is stopped, like a turntable.

Every motion has an end, so that it can be certified and a device comes to rest if its client is
gone. Halfway through each motion, the next one takes over at the same rate, without a step.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from orientd.errors import LimitError, LimitKind, MotionStopped, OrientdError

if TYPE_CHECKING:
    from orientd.client.move_handle import MoveHandle
    from orientd.client.robot import Robot
    from orientd.protocol import control_pb2 as pb

SECONDS = 60.0
"""Duration of each motion at the rate; the next one is planned after half of it."""

_SHARE, _LEAST = 0.8, 0.5
"""Share of the time until an axis reaches the end of its range, and least time, of a motion, s."""

_LOOK = 0.2
"""Interval between two checks of the progress, s."""


class EndlessTurn:
    """A turn until it is stopped.

    Attributes:
        plan: of its first motion.
        speed: of the device at the start; 1 is as planned.
        problem: why it ended; empty while it continues, and after a stop.
    """

    def __init__(self, robot: Robot, rate: Sequence[float], **fields: Any) -> None:  # noqa: ANN401 - as of move
        """Start the turn.

        Args:
            robot: a connection, whose lease must outlast the turn.
            rate: rad/s.
            fields: as for :meth:`.Robot.turn`.

        Raises:
            OrientdError: as for :meth:`.Robot.move`.
        """
        self._robot, self._rate, self._fields = robot, rate, fields
        self._handle = self._begin()
        self.plan: pb.Plan = self._handle.plan
        self.speed = self._handle.speed
        self.problem = ""
        self._ending = threading.Event()
        self._renewing = threading.Lock()
        self._thread = threading.Thread(target=self._work, name="orientd turn", daemon=True)
        self._thread.start()

    def wait(self, timeout: float | None = None, *, check: bool = True) -> pb.MoveSummary:
        """Wait until the device has come to rest, and return the summary of its last motion.

        Args:
            timeout: longest wait, s; the turn continues after it.
            check: whether to raise an error, which has the summary, if a fault ended the turn.

        Raises:
            MotionFault: a fault of the device ended it, and *check* is true.
            TimeoutError: it has not ended.
            OrientdError: the daemon was lost.
        """
        self._thread.join(timeout)
        if self._thread.is_alive():
            raise TimeoutError(f"the turn continues after {timeout:g} s")
        with contextlib.suppress(MotionStopped):
            return self._handle.wait(timeout, check=check)
        return self._handle.wait(timeout, check=False)

    def cancel(self) -> None:
        """Stop it on its path; :meth:`wait` returns when it has come to rest.

        Raises:
            DaemonError: the daemon or the servo does not answer.
        """
        self._ending.set()
        # Stop at once, and also the motion that may be about to take over.
        stopped = self._handle
        stopped.cancel()
        with self._renewing:
            if self._handle is not stopped:
                self._handle.cancel()

    def __iter__(self) -> Iterator[pb.MoveProgress]:
        """Yield the reports of its motions as they arrive."""
        handle = None
        while handle is not self._handle:
            handle = self._handle
            yield from handle
            with self._renewing:
                pass

    def _begin(self) -> MoveHandle:
        """Begin the next motion, which is shorter near the end of the range of an axis."""
        seconds = SECONDS
        while True:
            try:
                handle = self._robot.turn(self._rate, seconds, **self._fields)
            except LimitError as error:
                seconds = _SHARE * min(seconds, error.time)
                if error.kind is not LimitKind.RANGE or seconds < _LEAST:
                    raise
            else:
                handle.is_endless = True
                return handle

    def _work(self) -> None:
        while not self._handle.is_done:
            progress = self._handle.progress
            is_far = progress is not None and progress.path_time > 0.5 * progress.duration
            if is_far and not self.problem and not self._ending.is_set():
                with self._renewing:
                    self._renew()
            with contextlib.suppress(TimeoutError, OrientdError):
                self._handle.wait(_LOOK)

    def _renew(self) -> None:
        try:
            self._handle = self._begin()
        except OrientdError as error:
            # The current motion has half its time left, and then comes to rest.
            self.problem = str(error)
