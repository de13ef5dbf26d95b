"""The keep-out cones of a device as its servo keeps them: their current directions.

The servo reads the wall clock for cones that move, about ten times a second.  A step of the wall
clock must not make the device jump.  So a direction never turns faster than :data:`MOST_DRIFT`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from math import atan2, degrees, sqrt

from orientd.driver import Quaternion, Vector3
from orientd.floats import cross, dot, norm, plus, rotate
from orientd.keep_out import KeepOut
from orientd.mechanism.mechanism import Rows

REFRESH = 0.1
"""Time between two looks at the wall clock, s."""

MOST_DRIFT = 0.0175
"""Largest angular velocity of a cone's direction, rad/s: one degree a second."""

SLACK = 5e-5
"""Angle inside a cone that the guard tolerates, rad: 0.003 degrees, for a cone that moves."""

SAME_ANGLE = 1e-12
"""Largest difference of equal angles, rad: poses of joints have that much rounding."""


class KeepOutCones:
    """The cones of a device.

    Attributes:
        cones: as configured.
        directions: their current directions in the world.
        turned: angle by which they have turned so far, all together, rad.
        rate: current angular velocity of the fastest one, rad/s.
    """

    def __init__(
        self,
        cones: Sequence[KeepOut],
        period: float,
        unix_ns: Callable[[], int] = lambda: time.time_ns(),
    ) -> None:
        """Create it for one :meth:`tick` per *period* seconds; *unix_ns* is the wall clock."""
        self.cones = tuple(cones)
        self._unix_ns = unix_ns
        now_ns = unix_ns()
        self.directions = [one.direction_at(now_ns) for one in cones]
        self._moving = [place for place, one in enumerate(cones) if one.fastest]
        self._every = max(1, round(REFRESH / period))
        self._most = self._every * period * MOST_DRIFT
        self._count = 0
        self.turned = self.rate = 0.0
        # Those of the last orientation, which several ask for in a cycle.
        self._q: Quaternion | None = None
        self._found: list[float] = []

    def tick(self) -> None:
        """Follow the directions that move; call it once a cycle."""
        if not self._moving:
            return
        self._count += 1
        if self._count % self._every:
            return
        now_ns, fastest = self._unix_ns(), 0.0
        for place in self._moving:
            before = self.directions[place]
            after = _nearer(before, self.cones[place].direction_at(now_ns), self._most)
            self.directions[place] = after
            fastest = max(fastest, norm(plus(after, before, -1.0)))
        self._q = None
        self.turned += fastest
        self.rate = fastest * MOST_DRIFT / self._most

    def clearances(self, q: Quaternion) -> list[float]:
        """Return the angles from the tool's axis to the edges at *q*, rad; negative inside."""
        if q is self._q:
            return self._found
        found, axis, pointing = [], None, (0.0, 0.0, 0.0)
        for one, (a, b, c) in zip(self.cones, self.directions, strict=True):
            if one.axis is not axis:
                axis = one.axis
                pointing = rotate(q, axis)
            x, y, z = pointing
            u, v, w = y * c - z * b, z * a - x * c, x * b - y * a
            angle = atan2(sqrt(u * u + v * v + w * w), a * x + b * y + c * z)
            found.append(angle - one.half_angle)
        self._q, self._found = q, found
        return found

    def rows(self, q: Quaternion, reserve: float) -> Rows:
        """Return the cones for the stops of axes from *q* on, see ``kernels/c/chain.h``.

        Stops keep the angle *reserve* outside, rad.  The tool may be nearer already.  Then stops
        come no nearer, and inside of a cone each step of them leads outwards (:meth:`intrusion`).
        """
        found = Rows(len(self.cones), 7)
        each = zip(self.cones, self.directions, self.clearances(q), strict=True)
        for row, (one, direction, clearance) in enumerate(each):
            kept = min(reserve, max(clearance, -SLACK))
            found[row] = (*one.axis, *direction, one.half_angle + kept)
        return found

    def intrusion(self, before: Quaternion, q: Quaternion, slack: float = SLACK) -> str:
        """Return into which cone the step between two orientations leads, and how far inside.

        Empty if it leads into none.  Inside a cone, a step outwards leads into none.

        Args:
            before: orientation before the step.
            q: orientation after it.
            slack: depth that is tolerated, rad; negative to keep farther away.
        """
        found, earlier = self.clearances(q), self.clearances(before)
        for one, clearance, last in zip(self.cones, found, earlier, strict=True):
            if clearance < -slack and clearance < last - SAME_ANGLE:
                depth = max(degrees(-clearance), 0.0)
                return f"{depth:.3g} deg inside the keep-out cone {one.name!r}"
        return ""


class Room:
    """A lower bound of the angle to the nearest cone, which saves most looks at far cones.

    Args:
        cones: the cones.
    """

    def __init__(self, cones: KeepOutCones) -> None:
        self._cones = cones
        self._least = self._turned = 0.0

    def forget(self) -> None:
        """Know nothing any more: the tool may be anywhere."""
        self._least = 0.0

    def shrink(self, angle: float) -> None:
        """Account for a cycle in which the tool turned by at most *angle*, rad."""
        self._least -= angle

    def is_within(self, q: Quaternion, distance: float) -> bool:
        """Return whether a cone is nearer than *distance*, rad, at the current orientation *q*."""
        turned = self._cones.turned
        self._least -= turned - self._turned
        self._turned = turned
        if self._least <= distance:
            self._least = min(self._cones.clearances(q))
        return self._least <= distance


def _nearer(before: Vector3, wanted: Vector3, most: float) -> Vector3:
    """Return a unit vector turned towards another one by at most *most*, rad."""
    angle = atan2(norm(cross(before, wanted)), dot(before, wanted))
    if angle <= most:
        return wanted
    # A chord is enough for a step this small; opposite directions need any side.
    aside = plus(wanted, before, -dot(before, wanted))
    if norm(aside) < 1e-9:
        aside = cross(before, (1.0, 0.0, 0.0) if abs(before[0]) < 0.9 else (0.0, 1.0, 0.0))
    turned = plus(before, aside, most / norm(aside))
    return plus((0.0, 0.0, 0.0), turned, 1.0 / norm(turned))
