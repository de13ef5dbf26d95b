"""Teleoperate a device with a clutch: it follows the hand relative to its own pose."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Self

from orientd.client.target_messages import Frame, orientation_of, vector_of
from orientd.driver import ZERO, Vector3
from orientd.driver import Quaternion as Orientation
from orientd.errors import RequestError
from orientd.floats import (
    combine,
    conjugate,
    difference,
    exp,
    multiply,
    normalize,
    plus,
    rotate_back,
)
from orientd.rotation import Quaternion

if TYPE_CHECKING:
    from orientd.client.tracking import Tracking

LONGEST_REST = 60.0
"""Time to live of the last target, at which the device rests, s."""


class Clutch:
    """Move the device with the hand; a context manager that releases the clutch at its end.

    The first pose of the hand moves nothing.  From then on the device turns by *scale* times each
    turn of the hand, and moves by *scale* times its displacement.  Between two clutches the hand
    may move freely, because the next clutch begins at the pose of the device.

    Attributes:
        q: target orientation, ``(w, x, y, z)``.
        position: target position, m.
    """

    def __init__(
        self,
        tracking: Tracking,
        start: tuple[Orientation, Vector3],
        *,
        scale: float,
        frame: Frame,
        time_to_live: float,
    ) -> None:
        """Engage at *start*, an orientation and a position (m); see :meth:`.Tracking.engage`.

        Raises:
            RequestError: a setting is out of range.
        """
        if not 0.0 < scale < math.inf:
            raise RequestError("scale", f"expected more than 0, got {scale!r}")
        if frame not in ("body", "world"):
            raise RequestError("frame", f"expected 'body' or 'world', got {frame!r}")
        self.q, self.position = start
        self._tracking, self._scale, self._is_world = tracking, scale, frame == "world"
        self._time_to_live = time_to_live
        self._hand: tuple[Orientation, Vector3 | None] | None = None
        self._expires = -math.inf

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    @property
    def holds(self) -> bool:
        """Whether the device still follows this clutch."""
        return time.monotonic() < self._expires

    def move(self, hand: object, *, position: Vector3 | None = None) -> None:
        """Follow the hand; return at once.  A pose that is not finite is skipped.

        Args:
            hand: its orientation, in a form that :meth:`.Tracking.aim` takes.
            position: of the hand, m; in every call or in none.

        Raises:
            RequestError: the pose is not well formed.
            OrientdError: tracking has ended.
        """
        q = orientation_of(hand, "hand")
        place = None if position is None else vector_of(position, "position")
        if not all(map(math.isfinite, (*q, *(place or ())))):
            return
        q, before = normalize(q), self._hand
        self._hand = q, place
        if before is not None:
            self._follow(*before, q, place)
        self._aim(None, self._time_to_live, place is not None)

    def _follow(
        self, q0: Orientation, p0: Vector3 | None, q: Orientation, p: Vector3 | None
    ) -> None:
        """Turn and move the target as the hand moved from its last pose to the present one."""
        scale, tool = self._scale, self.q
        if self._is_world:
            turn = difference(conjugate(q0), conjugate(q))
            self.q = normalize(multiply(exp(plus(ZERO, turn, -scale)), tool))
        else:
            self.q = normalize(multiply(tool, exp(plus(ZERO, difference(q0, q), scale))))
        if p is not None and p0 is not None:
            displacement = combine(p, scale, p0, -scale)
            if not self._is_world:
                displacement = rotate_back(conjugate(tool), rotate_back(q0, displacement))
            self.position = plus(self.position, displacement, 1.0)

    def release(self) -> None:
        """Release the clutch: the device comes to rest at its present target.

        If the time to live of the last pose has expired, the device already rests and stays there.
        """
        if self._hand is not None and self.holds:
            _, position = self._hand
            self._aim(ZERO, LONGEST_REST, position is not None)
        self._hand = None

    def _aim(self, velocity: Vector3 | None, time_to_live: float, has_position: bool) -> None:
        w, x, y, z = self.q
        self._tracking.aim(
            Quaternion(w=w, x=x, y=y, z=z),
            angular_velocity=velocity,
            time_to_live=time_to_live,
            position=self.position if has_position else None,
        )
        self._expires = time.monotonic() + time_to_live
