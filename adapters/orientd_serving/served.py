"""The device behind an adapter: one lease, one session of targets or one motion at a time.

And the warnings of requests that an adapter denies.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from typing import Protocol, Self, TypeVar, Unpack

from orientd.client.motion_text import RequestFields
from orientd.client.move_handle import MoveHandle
from orientd.client.playing import Playing
from orientd.client.robot import Robot
from orientd.driver import Quaternion as Components
from orientd.errors import LeaseError, OrientdError, StateError, UnknownNameError
from orientd.protocol import control_pb2 as pb
from orientd.rotation import Quaternion

_LONGEST_STOP = 10.0
"""Longest wait for a motion to stop at the end, s."""

_MOST_WARNINGS = 5
"""Most warnings in a second."""

Begun = TypeVar("Begun")


class Adapter(Protocol):
    """A server for programs of one protocol.

    Attributes:
        endpoint: where it serves, for people: ``127.0.0.1:4533``.
    """

    endpoint: str

    def serve(self) -> None:
        """Serve until the process is interrupted.

        Raises:
            OrientdError: it cannot serve any longer.
        """

    def close(self) -> None:
        """Close every socket; return when no thread of the adapter commands the device."""


class Served:
    """A device of a daemon for the threads of an adapter; a context manager.

    The end of the context brings the device to rest.  The lease is taken with the first command.

    Attributes:
        robot: the connection to the daemon.
        name: of the device.
        lock: held during every command, so that one follows another.
    """

    def __init__(self, robot: Robot, device: str = "") -> None:
        """Find the device.

        Args:
            robot: the connection to the daemon; its owner closes it.
            device: its name; it may be empty if the daemon has only one.

        Raises:
            UnknownNameError: the daemon has no such device, or several.
            DaemonError: no daemon answers.
        """
        names = list(robot.state().devices)
        if not device and len(names) == 1:
            device = names[0]
        if device not in names:
            raise UnknownNameError("device", f"expected one of {', '.join(names)}, got {device!r}")
        self.robot, self.name = robot, device
        self.lock = threading.RLock()
        self._is_closed = False
        self._tracking: Playing | None = None
        self._moving: MoveHandle | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with self.lock:
            self._is_closed = True
        self.rest()

    def report(self) -> pb.DeviceReport:
        """Return the newest state of the device; its ``cycle`` has the setpoint and the feedback.

        Raises:
            DaemonError: no daemon answers.
        """
        return self.robot.state().devices[self.name]

    def enable(self) -> None:
        """Clear a fault of the device, and enable it.

        Raises:
            OrientdError: the daemon refuses it.
        """
        state = self.report().state
        if state == pb.STATE_FAULT:
            self.robot.reset(self.name)
        elif state == pb.STATE_IDLE:
            self.robot.enable(self.name)

    def track(self) -> Playing:
        """Return the session of targets or chunks of poses; begin one if there is none.

        It replaces a running motion without a step in velocity.  The servo knows a chunk ahead, so
        a delay of this process does not disturb the motion.

        Raises:
            OrientdError: the daemon refuses it.
        """
        with self.lock:
            self._check_open()
            tracking = self._tracking
            if tracking is not None:
                try:
                    tracking.raise_if_ended()
                except OrientdError:
                    tracking = None
            if tracking is None:
                tracking = self._leased(lambda: self.robot.play(device=self.name))
            self._tracking, self._moving = tracking, None
            return tracking

    def move(
        self,
        keyframes: Iterable[object] | pb.Plan,
        *,
        start_time: float | None = None,
        **fields: Unpack[RequestFields],
    ) -> MoveHandle:
        """Begin a motion, in place of a running one or once the device has stopped following.

        Args:
            keyframes: see :meth:`.Robot.move`; or a plan from the current state of the device.
            start_time: Unix time in s; ``None`` for now.
            fields: of the motion.

        Raises:
            OrientdError: the daemon refuses it.
        """
        with self.lock:
            self._check_open()
            self.end_tracking()
            self._moving = self._leased(
                lambda: self.robot.move(
                    keyframes, device=self.name, start_time=start_time, **fields
                )
            )
            return self._moving

    def end_tracking(self) -> None:
        """Send no more targets, and wait until the device has come to rest."""
        with self.lock:
            tracking, self._tracking = self._tracking, None
            if tracking is not None:
                with contextlib.suppress(OrientdError):  # another error may have ended it before
                    tracking.close()

    def stop(self) -> None:
        """Stop the device on its path, also if another client moves it.

        Raises:
            OrientdError: the servo does not answer, or no daemon does.
        """
        # Without the lock: a command that plans must not delay a stop.
        self.robot.stop(self.name)
        self.end_tracking()

    def rest(self) -> None:
        """Bring the device to rest if this adapter moves it, and return then."""
        self.end_tracking()
        with self.lock, contextlib.suppress(OrientdError, TimeoutError):
            if self._moving is not None:
                self._moving.cancel()
                self._moving.wait(_LONGEST_STOP, check=False)

    def _leased(self, command: Callable[[], Begun]) -> Begun:
        """Return the result of a command, which takes the lease again if it was lost.

        A daemon that has restarted knows no leases.

        Raises:
            OrientdError: the daemon refuses the command, or another client holds the lease.
        """
        try:
            return command()
        except LeaseError:
            self.robot.release_lease(self.name)
            return command()

    def _check_open(self) -> None:
        """Check that this context has not ended: a late thread must not move the device again.

        Raises:
            StateError: it has.
        """
        if self._is_closed:
            raise StateError("the server has ended")


class Denials:
    """Warnings of denied requests, few enough to read: a program repeats its mistake.

    It may be called by several threads.
    """

    def __init__(self, warn: Callable[[str], None]) -> None:
        """Begin without a warning.

        Args:
            warn: takes each warning, one line.
        """
        self._warn, self._last = warn, ""
        self._times: deque[float] = deque(maxlen=_MOST_WARNINGS)
        self._lock = threading.Lock()

    def __call__(self, problem: str) -> None:
        """Warn of a problem, unless it is the last one again, or one of many in a second."""
        with self._lock:
            now = time.monotonic()
            is_flood = len(self._times) == _MOST_WARNINGS and now < self._times[0] + 1.0
            if problem == self._last or is_flood:
                return
            self._last = problem
            self._times.append(now)
        self._warn(problem)


def named(q: Components) -> Quaternion:
    """Return a quaternion ``(w, x, y, z)`` with named components."""
    w, x, y, z = q
    return Quaternion(w=w, x=x, y=y, z=z)
