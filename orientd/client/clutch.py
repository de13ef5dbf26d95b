"""Teleoperate a device with a clutch: it follows the hand relative to its own pose.

A clutch takes hold at the pose that the device keeps.  That is the last target of the clutch before
it, or the pose at which the device rests.  So engaging moves nothing, wherever the hand is.
"""

from __future__ import annotations

import math
import threading
import time
from typing import TYPE_CHECKING, Self

from orientd.client.target_messages import (
    Frame,
    check_life,
    is_in_world,
    orientation_of,
    vector_of,
)
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
from orientd.protocol import control_pb2 as pb
from orientd.protocol.targets import pose_problem
from orientd.protocol.values import to_quaternion, to_vector
from orientd.rotation import Quaternion

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from orientd.client.tracking import Tracking

Pose = tuple[Orientation, Vector3]

LONGEST_REST = 60.0
"""Time to live of the last target, at which the device rests, s."""

_BRIEF = 0.05
"""Time to live of a target that only ends what the device follows, s."""

_STILL = 1e-6
"""Motion below which the device rests: rad/s, and m between two reports."""


class Anchor:
    """The pose at which a clutch takes hold.

    Attributes:
        newest: pose of the newest report.
        owner: the clutch that sent the newest target; ``None`` if that came from elsewhere.
        is_moving: whether the device moves, or may not have got the newest target yet, or that
            target still counts.
        rests: whether the device has not moved for 0.05 s, and has had time to get the newest
            target.
    """

    def __init__(self, report: pb.TrackResponse) -> None:
        """Begin with the first *report* of a session."""
        self._lock = threading.Lock()
        self.newest = _pose_of(report)
        self.owner: Clutch | None = None
        self._held = self.newest
        self._until = self._noted = -math.inf
        self._moved_ns = -math.inf
        self.is_moving, self.rests = True, False
        self.note(report)

    def note(self, report: pb.TrackResponse) -> None:
        """Take a report of the device."""
        before, self.newest = self.newest, _pose_of(report)
        is_turning = math.hypot(*to_vector(report.omega_body)) > _STILL
        is_shifting = math.dist(self.newest[1], before[1]) > _STILL
        with self._lock:
            # A report from before the end of the newest target does not count.
            now, is_moving = time.monotonic(), is_turning or is_shifting
            self.is_moving = is_moving or now < self._until
            if is_moving:
                self._moved_ns = report.time_ns
            # A device that turns back stands still in one report, and is not at rest.
            is_still = report.time_ns >= self._moved_ns + 1e9 * _BRIEF
            self.rests = is_still and now >= self._noted + _BRIEF

    def hold(self, owner: Clutch, pose: Pose, time_to_live: float) -> None:
        """Note a target of a clutch, and how long it counts, s."""
        with self._lock:
            self.owner, self._held = owner, pose
            self._expect(time_to_live)

    def lose(self) -> None:
        """Note a target or a chunk that no clutch has sent."""
        with self._lock:
            self.owner = None
            self._expect(_BRIEF)

    def _expect(self, time_to_live: float) -> None:
        """Note that a target has been sent, which counts for some seconds."""
        self._noted = time.monotonic()
        self._until = self._noted + time_to_live
        self.is_moving, self.rests = True, False

    @property
    def is_held(self) -> bool:
        """Whether the newest target is one of a clutch, and still counts."""
        return self.owner is not None and time.monotonic() < self._until

    def pose(self) -> Pose | None:
        """Return the pose that the device keeps; ``None`` while it comes to rest."""
        with self._lock:
            if self.is_held:
                return self._held
            return None if self.is_moving else self.newest


class Clutch:
    """Move the device with the hand; a context manager that releases the clutch at its end.

    The first pose of the hand moves nothing.  From then on the device turns by *scale* times each
    turn of the hand, and moves by *scale* times its displacement.  Between two clutches the hand
    may move freely, because the next clutch begins at the pose of the device.  It takes hold as
    soon as the device rests; engaging brakes a device that moves.

    Attributes:
        q: target orientation, ``(w, x, y, z)``.
        position: target position, m.
        skipped: number of skipped poses of the hand.
    """

    def __init__(
        self,
        tracking: Tracking,
        anchor: Anchor,
        *,
        scale: float,
        frame: Frame,
        time_to_live: float,
    ) -> None:
        """Engage where *anchor* says; see :meth:`.Tracking.engage`.

        Raises:
            RequestError: a setting is out of range.
        """
        if not isinstance(scale, int | float) or not 0.0 < scale < math.inf:
            step = "with 1 the device turns as far as the hand"
            raise RequestError("scale", f"expected a number above 0, got {scale!r}; {step}")
        check_life("time_to_live", time_to_live)
        self.skipped = 0
        self.q, self.position = anchor.newest
        self._tracking, self._anchor = tracking, anchor
        self._scale, self._is_world = scale, is_in_world(frame, "frame")
        self._time_to_live = time_to_live
        self._hand: tuple[Orientation, Vector3 | None] | None = None
        self._has_position: bool | None = None
        self._has_braked = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    @property
    def holds(self) -> bool:
        """Whether the device still follows this clutch."""
        return self._anchor.owner is self and self._anchor.is_held

    def move(self, hand: object, *, position: ArrayLike | None = None) -> None:
        """Follow the hand; return at once.

        The clutch skips and counts a pose that is not finite, not of unit norm or out of range.
        If no pose has come for the time to live, the next one engages again, and moves nothing.

        Args:
            hand: its orientation, in a form that :meth:`.Tracking.aim` takes.
            position: of the hand, shape ``(3,)``, m; in every call or in none.

        Raises:
            RequestError: the pose is not well formed, or has a position where others had none.
            OrientdError: tracking has ended.
        """
        q = orientation_of(hand, "hand")
        place = None if position is None else vector_of(position, "position")
        if pose_problem(q, None, place):
            self.skipped += 1
            return
        if self._has_position not in (None, place is not None):
            came = "none" if place is None else f"{place} after none"
            raise RequestError("position", f"expected in every call or in none, got {came}")
        self._has_position = place is not None
        start, before = self._anchor.pose(), self._hand if self.holds else None
        if start is None:
            self._brake()
            return
        q = normalize(q)
        self._hand, (self.q, self.position) = (q, place), start
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
        """Release the clutch: the device comes to rest at its current target.

        If the time to live of the last pose has expired, the device already rests and stays there.
        """
        if self._hand is not None and self.holds:
            _, position = self._hand
            self._aim(ZERO, LONGEST_REST, position is not None)
        self._hand = None

    def _brake(self) -> None:
        """Have the device come to rest if it follows anything but a clutch."""
        if self._has_braked or self._anchor.owner is not None:
            return
        self._has_braked = True
        self.q, self.position = self._anchor.newest
        self._send(ZERO, _BRIEF, None)

    def _aim(self, velocity: Vector3 | None, time_to_live: float, has_position: bool) -> None:
        self._send(velocity, time_to_live, self.position if has_position else None)
        self._anchor.hold(self, (self.q, self.position), time_to_live)

    def _send(
        self, velocity: Vector3 | None, time_to_live: float, position: Vector3 | None
    ) -> None:
        w, x, y, z = self.q
        self._tracking.aim(
            Quaternion(w=w, x=x, y=y, z=z),
            angular_velocity=velocity,
            time_to_live=time_to_live,
            position=position,
        )


def _pose_of(report: pb.TrackResponse) -> Pose:
    return to_quaternion(report.q), to_vector(report.position)
