"""Keep-out cones: directions in the world that an axis of the tool must not point at."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan2

from orientd.driver import Quaternion, Vector3
from orientd.floats import cross, dot, norm, rotate
from orientd.sun import Sun

FASTEST_SUN = 7.3e-5
"""Bound of the angular velocity of the sun's direction, rad/s."""

MOST_CONES = 8
"""Cones of a device, or of a motion."""


@dataclass(frozen=True, slots=True)
class KeepOut:
    """A cone around a direction that an axis of the tool stays outside of.

    The angle between the axis and the direction is never smaller than *half_angle*.  Planned paths
    avoid the *margin* too, but may start and end in it.

    Attributes:
        name: its name in messages.
        direction: unit vector in the device's base frame, or the sun.
        half_angle: angle between the direction and the edge of the cone, rad.
        margin: extra angle outside the edge, which paths avoid if possible, rad.
        axis: unit vector in the frame of the tool.
    """

    name: str
    direction: Vector3 | Sun
    half_angle: float
    margin: float = 0.0
    axis: Vector3 = (1.0, 0.0, 0.0)

    def direction_at(self, unix_ns: int) -> Vector3:
        """Return the unit vector of the cone's direction in the world at a Unix time in ns."""
        one = self.direction
        return one.direction(unix_ns) if isinstance(one, Sun) else one

    def frozen(self, unix_ns: int) -> KeepOut:
        """Return the cone with the direction that it has at a Unix time in ns."""
        return replace(self, direction=self.direction_at(unix_ns))

    def clearance(self, q: Quaternion, unix_ns: int) -> float:
        """Return the angle from the tool's axis to the edge of the cone, rad.

        Args:
            q: orientation ``(w, x, y, z)``, tool to world.
            unix_ns: time, ns since 1970-01-01 UTC; irrelevant for a fixed direction.

        Returns:
            At least minus *half_angle*, negative inside.
        """
        pointing, direction = rotate(q, self.axis), self.direction_at(unix_ns)
        return atan2(norm(cross(pointing, direction)), dot(pointing, direction)) - self.half_angle

    @property
    def fastest(self) -> float:
        """Bound of the angular velocity of the direction, rad/s."""
        return FASTEST_SUN if isinstance(self.direction, Sun) else 0.0
