"""A device that points, rolls and follows a direction, and Alpaca's rotator, which is its roll."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

from orientd.client.move_handle import MoveHandle
from orientd.driver import Quaternion
from orientd.errors import OrientdError, PlanError
from orientd.floats import conjugate, difference, multiply, rotate
from orientd.protocol.values import to_quaternion
from orientd_alpaca.device import AlpacaDevice, check_range
from orientd_serving.pointing import Direction, direction, orientation
from orientd_serving.served import Served, named

Path = Callable[[float], Direction]
"""The direction to follow, by the time of day, s."""

_STEP = 0.03
"""Time between two poses of a followed direction, s."""

_POSES = 64

_INTERVAL = 0.3
"""Time after which the device gets the next poses, s."""

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
        handle, path = self._handle, self._path
        if handle is not None and not handle.is_done:
            return True
        if path is None:
            return False
        wanted = self._orientation(path(time.time()), self._roll)
        found = to_quaternion(self.served.report().cycle.q)
        return math.degrees(math.hypot(*difference(found, wanted))) > _ARRIVED_DEG

    def go(self, target: Direction | None = None, roll: float | None = None) -> None:
        """Move to a direction, a roll or both; return when the motion has begun.

        While a direction is followed, a new roll only changes the poses that are sent.

        Args:
            target: the current target by default, which is then not followed any more.
            roll: degrees; the current target by default.

        Raises:
            OrientdError: the daemon refuses it; the targets stay as they were.
        """
        with self.lock:
            if target is None and self._path is not None and roll is not None:
                self._roll = roll
                return
            self.unfollow()
            wanted = self._target if target is None else target
            angle = self._roll if roll is None else roll
            goal = named(self._orientation(wanted, angle))
            self._handle = self.served.move([goal], approach=True)
            self._target, self._roll = wanted, angle

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
                self._handle.wait(check=False)
            self._target, self._roll = self.commanded()

    def _orientation(self, wanted: Direction, roll: float) -> Quaternion:
        half = math.radians(0.5 * roll)
        return multiply(
            orientation(wanted, self._north), (math.cos(half), math.sin(half), 0.0, 0.0)
        )

    def _read(self, q: Quaternion) -> tuple[Direction, float]:
        """Return direction and roll of the tool; its elevation is at most 90 degrees."""
        found = direction(q, self._north)
        x, y, z = rotate(q, (1.0, 0.0, 0.0))
        azimuth = found.azimuth + 180.0 * (abs(found.elevation) > 90.0)
        upright = Direction(whole_turn(azimuth), math.degrees(math.atan2(z, math.hypot(x, y))))
        w, x, _, _ = multiply(conjugate(orientation(upright, self._north)), q)
        return upright, math.remainder(math.degrees(2.0 * math.atan2(x, w)), 360.0)

    def _follow(self, path: Path, ended: threading.Event) -> None:
        """Send the poses ahead until the end."""
        try:
            while self._handle is not None and not self._handle.is_done:
                if ended.wait(0.05):
                    return
            while not ended.is_set():
                start, now = time.monotonic(), time.time()
                directions = [path(now + k * _STEP) for k in range(_POSES)]
                poses = [named(self._orientation(one, self._roll)) for one in directions]
                self.served.track().chunk(poses, rate=1.0 / _STEP, start=start)
                ended.wait(_INTERVAL)
        except OrientdError as error:
            self.problem = str(error)
            self._path = None


def whole_turn(angle: float) -> float:
    """Return an angle as 0 or more and less than 360 degrees, also if it is barely negative."""
    return angle % 360.0 % 360.0


class Rotator(AlpacaDevice):
    """A rotator.

    Its mechanical position is the roll, its position is the roll after a sync.  Both are 0 to 360
    degrees.  If the camera looks the same after half a turn, the rotator takes the nearer of two
    rolls, so it never turns by more than 90 degrees.
    """

    kind = "Rotator"

    def __init__(self, mount: Mount, *, is_symmetric: bool = False) -> None:
        """Serve the roll of *mount*.

        Args:
            mount: the device.
            is_symmetric: whether half a turn makes no difference.
        """
        self._mount, self._is_symmetric = mount, is_symmetric
        self._sign, self._offset, self._is_moving = 1.0, 0.0, False
        self._target = math.nan
        gets = {
            "canreverse": True,
            "ismoving": self._look,
            "mechanicalposition": lambda: whole_turn(mount.measured()[1]),
            "position": self._position,
            "reverse": lambda: self._sign < 0.0,
            "targetposition": lambda: self._target,
        }
        puts = {
            "halt": self._halt,
            "move": self._move,
            "moveabsolute": self._move_absolute,
            "movemechanical": self._move_mechanical,
            "reverse": self._reverse,
            "sync": self._sync,
        }
        state = "IsMoving MechanicalPosition Position"
        super().__init__(mount.served, gets=gets, puts=puts, lacks="stepsize", state=state)
        self._target = self._position()

    def _position(self) -> float:
        return whole_turn(self._sign * self._mount.measured()[1] + self._offset)

    def _look(self) -> bool:
        self._is_moving = self._is_moving and self._mount.is_moving()
        return self._is_moving

    def _move(self, position: float) -> None:
        with self._mount.lock:
            self._move_to(self._position() + position)

    def _move_absolute(self, position: float) -> None:
        check_range("Position", position, 0.0, 360.0)
        self._move_to(position)

    def _move_to(self, position: float) -> None:
        """Turn to a position, to the nearer roll of two if they are equivalent."""
        with self._mount.lock:
            roll = self._sign * (position - self._offset)
            rolls = [roll, roll + 180.0] if self._is_symmetric else [roll]
            now = self._mount.commanded()[1]
            nearest, *others = sorted(rolls, key=lambda one: abs(math.remainder(one - now, 360.0)))
            try:
                self._turn(nearest)
            except PlanError:
                if not others:
                    raise
                # An axis ends before the nearer one.
                (nearest,) = others
                self._turn(nearest)
            # After half a turn more the position is still that which the client has asked for.
            self._offset = position - self._sign * nearest
            self._target = whole_turn(position)

    def _move_mechanical(self, position: float) -> None:
        check_range("Position", position, 0.0, 360.0)
        with self._mount.lock:
            self._turn(position)
            self._target = whole_turn(self._sign * position + self._offset)

    def _turn(self, roll: float) -> None:
        self._mount.go(roll=roll)
        self._is_moving = True

    def _halt(self) -> None:
        self._mount.stop()
        self._target, self._is_moving = self._position(), False

    def _reverse(self, reverse: bool) -> None:
        """Count the other way round from now on; the position stays."""
        with self._mount.lock:
            position = self._position()
            self._sign = -1.0 if reverse else 1.0
            self._sync(position)

    def _sync(self, position: float) -> None:
        """Make the present position *position*, without a motion."""
        check_range("Position", position, 0.0, 360.0)
        with self._mount.lock:
            self._offset = position - self._sign * self._mount.measured()[1]
            self._target = whole_turn(position)
