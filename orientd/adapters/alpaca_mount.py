"""The device behind Alpaca's telescope and rotator: a direction and a roll, moved or followed."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable

from orientd.adapters.pointing import Direction, direction, orientation
from orientd.adapters.served import Served
from orientd.client import MoveHandle
from orientd.driver import Quaternion as Components
from orientd.errors import OrientdError
from orientd.floats import conjugate, difference, multiply
from orientd.protocol import control_pb2 as pb
from orientd.protocol import to_quaternion
from orientd.rotation import Quaternion

Path = Callable[[float], Direction]
"""The direction to follow, by the time of day, s."""

_INTERVAL = 0.05
"""From target to target of a followed direction, s."""

_TIME_TO_LIVE = 0.5
"""How long the device follows the last target if no other arrives, s."""

_ARRIVED_DEG = 0.05
"""Largest distance from a followed target at which the device has reached it, degrees."""


class Mount:
    """A device that points, rolls, and follows a moving direction.

    The roll is the turn about the pointing axis of the tool, from its level orientation.

    Attributes:
        served: the device.
        lock: held while a command changes the targets.
        problem: why the device no longer follows; empty while it does.
    """

    def __init__(self, served: Served, *, north: float) -> None:
        """Begin with the commanded direction and roll as targets.

        Args:
            served: the device.
            north: angle of north from the world's x axis, counted towards y, degrees.
        """
        self.served, self._north = served, north
        self.lock = threading.RLock()
        self.problem = ""
        self._target, self._roll = self.commanded()
        self._handle: MoveHandle | None = None
        self._path: Path | None = None
        self._ended = threading.Event()
        self._follower: threading.Thread | None = None

    def measured(self) -> tuple[Direction, float]:
        """Return the measured direction and roll, degrees; as commanded if nothing is measured.

        Raises:
            DaemonError: no daemon answers.
        """
        cycle = self.served.report().cycle
        q = cycle.feedback_q if cycle.HasField("feedback_q") else cycle.q
        return self._read(to_quaternion(q))

    def commanded(self) -> tuple[Direction, float]:
        """Return the commanded direction and roll, degrees.

        Raises:
            DaemonError: no daemon answers.
        """
        return self._read(to_quaternion(self.served.report().cycle.q))

    def is_moving(self) -> bool:
        """Return whether the device is on its way to a target.

        A followed target counts as reached when the device is there.
        """
        handle = self._handle
        if handle is not None and not handle.is_done:
            return True
        path = self._path
        if path is None:
            return False
        wanted = self._orientation(path(time.time()), self._roll)
        found = self.served.report().cycle
        apart = difference(to_quaternion(found.q), wanted)
        return math.degrees(math.hypot(*apart)) > _ARRIVED_DEG

    def go(self, target: Direction | None = None, roll: float | None = None) -> MoveHandle | None:
        """Move to a direction, a roll or both; return when the motion has begun.

        While a direction is followed, a new roll only changes the targets that are sent.

        Args:
            target: the present target by default, which is then not followed any more.
            roll: degrees; the present target by default.

        Returns:
            The motion; ``None`` if a direction is followed.

        Raises:
            OrientdError: the daemon refuses it; the targets stay as they were.
        """
        with self.lock:
            if target is None and self._path is not None and roll is not None:
                self._roll = roll
                return None
            self.unfollow()
            wanted = self._target if target is None else target
            angle = self._roll if roll is None else roll
            goal = _named(self._orientation(wanted, angle))
            self._handle = self.served.move([goal], approach=True)
            self._target, self._roll = wanted, angle
            return self._handle

    def follow(self, path: Path) -> None:
        """Follow a moving direction from now on, once a running motion has ended.

        Raises:
            OrientdError: the daemon refuses it.
        """
        with self.lock:
            self.unfollow()
            if self._handle is None or self._handle.is_done:
                self.served.track()
            self._path, self.problem, self._ended = path, "", threading.Event()
            self._follower = threading.Thread(
                target=self._follow, args=(path, self._ended), name="orientd follow", daemon=True
            )
            self._follower.start()

    def unfollow(self) -> None:
        """Follow no longer; return when the device that followed is at rest."""
        with self.lock:
            self._ended.set()
            follower, self._follower = self._follower, None
            if follower is not None:
                follower.join()
                self.served.end_tracking()
                self._target, _ = self.commanded()
            self._path = None

    def stop(self) -> None:
        """Stop the device on its path, and make the stop its target.

        Raises:
            OrientdError: the servo does not answer.
        """
        self._ended.set()
        self.served.stop()
        with self.lock:
            self.unfollow()
            if self._handle is not None:
                self._handle.wait()
            self._target, self._roll = self.commanded()

    def connect(self) -> None:
        """Clear a fault of the device, and enable it.

        Raises:
            OrientdError: the daemon refuses it.
        """
        with self.lock:
            state = self.served.report().state
            if state == pb.STATE_FAULT:
                self.served.robot.reset(self.served.name)
            elif state == pb.STATE_IDLE:
                self.served.robot.enable(self.served.name)

    def close(self) -> None:
        """Follow no longer."""
        self._ended.set()
        with self.lock, contextlib.suppress(OrientdError):
            self.unfollow()

    def _orientation(self, wanted: Direction, roll: float) -> Components:
        half = math.radians(0.5 * roll)
        return multiply(
            orientation(wanted, self._north), (math.cos(half), math.sin(half), 0.0, 0.0)
        )

    def _read(self, q: Components) -> tuple[Direction, float]:
        w, x, y, z = q
        ahead = (
            2.0 * (x * z - w * y),
            math.hypot(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z)),
        )
        found = direction(q, self._north)
        # A telescope has not tipped over: its elevation is at most 90 degrees.
        elevation = math.degrees(math.atan2(*ahead))
        azimuth = found.azimuth + 180.0 * (abs(found.elevation) > 90.0)
        upright = Direction(whole_turn(azimuth), elevation)
        w, x, _, _ = multiply(conjugate(orientation(upright, self._north)), q)
        return upright, math.remainder(math.degrees(2.0 * math.atan2(x, w)), 360.0)

    def _follow(self, path: Path, ended: threading.Event) -> None:
        """Send targets until the end, each with its angular velocity."""
        try:
            if self._handle is not None:
                while not self._handle.is_done and not ended.wait(_INTERVAL):
                    pass
            while not ended.is_set():
                now = time.time()
                q = self._orientation(path(now), self._roll)
                later = self._orientation(path(now + _INTERVAL), self._roll)
                x, y, z = difference(q, later)
                self.served.track().aim(
                    _named(q),
                    angular_velocity=(x / _INTERVAL, y / _INTERVAL, z / _INTERVAL),
                    time_to_live=_TIME_TO_LIVE,
                )
                ended.wait(_INTERVAL)
        except OrientdError as error:
            self.problem = str(error)
            self._path = None


def _named(q: Components) -> Quaternion:
    w, x, y, z = q
    return Quaternion(w=w, x=x, y=y, z=z)


def turning(start: Direction, begin: float, around: float, up: float) -> Path:
    """Return the directions of axes that move at constant rates, degrees/s."""

    def at(now: float) -> Direction:
        elevation = start.elevation + up * (now - begin)
        return Direction(start.azimuth + around * (now - begin), min(max(elevation, -90.0), 90.0))

    return at


def whole_turn(angle: float) -> float:
    """Return an angle as 0 or more and less than 360 degrees, also if it is barely negative."""
    return angle % 360.0 % 360.0
