"""A turn at a constant rate that goes on until it is stopped, as of a turntable.

Every motion has an end, so that it can be certified and a device comes to rest where nobody goes
on.  Halfway through each, the next takes over from it, at the same rate without a step.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from orientd.errors import OrientdError

if TYPE_CHECKING:
    from orientd.client.move_handle import MoveHandle
    from orientd.client.robot import Robot
    from orientd.protocol import control_pb2 as pb

SECONDS = 60.0
"""How long each motion turns at the rate; half of it is left when the next one is planned."""

_LOOK = 0.2
"""From one look at how far it is to the next, s."""


class EndlessTurn:
    """A turn that goes on until it is stopped.

    Attributes:
        plan: of its first motion.
        speed: of the device when it began; 1 is as planned.
        problem: why it did not go on; empty while it does, or where it was stopped.
    """

    def __init__(self, robot: Robot, rate: Sequence[float], **fields: Any) -> None:  # noqa: ANN401 - as of move
        """Begin.

        Args:
            robot: a connection, whose lease must outlast the turn.
            rate: rad/s.
            fields: as of :meth:`.Robot.turn`.

        Raises:
            OrientdError: as of :meth:`.Robot.move`, also where an axis cannot turn for as long as
                one motion of it.
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

    def wait(self, timeout: float | None = None) -> pb.MoveSummary:
        """Wait until the device has come to rest, and return how its last motion ended.

        Args:
            timeout: for how long at the most, s; it goes on after it.

        Raises:
            TimeoutError: it has not ended.
            OrientdError: the daemon was lost.
        """
        self._thread.join(timeout)
        if self._thread.is_alive():
            raise TimeoutError(f"the turn goes on after {timeout:g} s")
        return self._handle.wait(timeout)

    def cancel(self) -> None:
        """Stop it on its path; :meth:`wait` says when it has come to rest.

        Raises:
            DaemonError: the daemon or the servo does not answer.
        """
        self._ending.set()
        # At once; and what may have been about to take over as well.
        stopped = self._handle
        stopped.cancel()
        with self._renewing:
            if self._handle is not stopped:
                self._handle.cancel()

    def __iter__(self) -> Iterator[pb.MoveProgress]:
        """Yield the reports as they come, each of its motion."""
        handle = None
        while handle is not self._handle:
            handle = self._handle
            yield from handle
            with self._renewing:
                pass

    def _begin(self) -> MoveHandle:
        return self._robot.turn(self._rate, SECONDS, **self._fields)

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
            # What runs has half its time left, and then comes to rest.
            self.problem = str(error)
