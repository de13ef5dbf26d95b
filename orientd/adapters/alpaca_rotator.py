"""Alpaca's rotator: the roll of a device about its pointing axis."""

from __future__ import annotations

import math

from orientd.adapters.alpaca_device import AlpacaDevice, unavailable
from orientd.adapters.alpaca_mount import Mount, whole_turn
from orientd.adapters.alpaca_protocol import Member, Members, boolean, number
from orientd.errors import PlanError


class Rotator(AlpacaDevice):
    """A rotator.

    Its mechanical position is the roll, its position is the roll after a sync.  Both are 0 to 360
    degrees.  If the camera looks the same after half a turn, the rotator takes the nearer of two
    rolls, so it never turns by more than 90 degrees.
    """

    kind = "Rotator"
    state = ("IsMoving", "MechanicalPosition", "Position")

    def __init__(self, mount: Mount, *, is_symmetric: bool = False) -> None:
        """Serve the roll of *mount*.

        Args:
            mount: the device.
            is_symmetric: whether half a turn makes no difference.
        """
        self._is_symmetric = is_symmetric
        self._sign, self._offset = 1.0, 0.0
        self._is_moving = False
        super().__init__(mount)
        self._target = self._position()

    def own_gets(self) -> Members:
        """Return the properties of a rotator."""
        return {
            "canreverse": Member(lambda: True),
            "ismoving": Member(self._look),
            "mechanicalposition": Member(self._mechanical),
            "position": Member(self._position),
            "reverse": Member(lambda: self._sign < 0.0),
            "targetposition": Member(lambda: self._target),
            **unavailable("stepsize"),
        }

    def own_puts(self) -> Members:
        """Return the methods of a rotator."""
        place = {"Position": number}
        return {
            "halt": Member(self._halt),
            "move": Member(lambda angle: self._move(self._position() + angle), place),
            "moveabsolute": Member(self._move, place),
            "movemechanical": Member(self._move_mechanical, place),
            "reverse": Member(self._reverse, {"Reverse": boolean}),
            "sync": Member(self._sync, place),
        }

    def _mechanical(self) -> float:
        return whole_turn(self._mount.measured()[1])

    def _position(self) -> float:
        return whole_turn(self._sign * self._mount.measured()[1] + self._offset)

    def _look(self) -> bool:
        self._is_moving = self._is_moving and self._mount.is_moving()
        return self._is_moving

    def _move(self, position: float) -> None:
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

    def _move_mechanical(self, roll: float) -> None:
        with self._mount.lock:
            self._turn(roll)
            self._target = whole_turn(self._sign * roll + self._offset)

    def _turn(self, roll: float) -> None:
        self._mount.go(roll=roll)
        self._is_moving = True

    def _halt(self) -> None:
        self._mount.stop()
        self._target, self._is_moving = self._position(), False

    def _reverse(self, is_reversed: bool) -> None:
        """Count the other way round from now on; the position stays."""
        with self._mount.lock:
            position = self._position()
            self._sign = -1.0 if is_reversed else 1.0
            self._sync(position)

    def _sync(self, position: float) -> None:
        """Make the present position *position*, without a motion."""
        with self._mount.lock:
            self._offset = position - self._sign * self._mount.measured()[1]
            self._target = whole_turn(position)
