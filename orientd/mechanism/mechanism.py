"""What a mechanism is to the planner and to the servo: axes with limits that pose a tool.

Plain floats only, since the servo process loads it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence

from orientd.driver import AxisLimits, Joints, Quaternion, Vector3


class Mechanism(ABC):
    """Axes that pose a tool.

    Attributes:
        axes: limits of every axis, from the base to the tool.
    """

    axes: tuple[AxisLimits, ...]

    @abstractmethod
    def forward(self, joints: Joints) -> tuple[Quaternion, Vector3]:
        """Return the tool's orientation ``(w, x, y, z)`` and position in the world.

        Args:
            joints: angles of the axes, rad.

        Returns:
            The position is in m, and the origin if the axes only turn the tool.
        """

    @abstractmethod
    def solutions(self, q: Quaternion, position: Vector3) -> Sequence[Joints]:
        """Return the joints of every branch that pose the tool so, rad; whole turns aside.

        Args:
            q: orientation ``(w, x, y, z)``, tool to world.
            position: of the tool in the world, m.

        Returns:
            Nothing if the pose is out of reach.
        """

    def reserve(self, joints: Joints) -> Mapping[str, tuple[float, float]]:  # noqa: ARG002 - many mechanisms have no singularity that they must not pass
        """Return how far the axes are from each singularity, and how far they must be, by name."""
        return {}

    def outline(self, joints: Joints) -> Sequence[Sequence[Vector3]]:  # noqa: ARG002 - not every mechanism is drawn
        """Return the shape as lines from point to point, m, for a picture; empty if there is none.

        Args:
            joints: angles of the axes, rad.
        """
        return ()
