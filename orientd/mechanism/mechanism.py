"""What a mechanism is to the planner and to the servo: axes with limits that pose a tool.

Plain floats only, since the servo process loads it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from math import ceil, floor, tau
from typing import NamedTuple, Protocol, runtime_checkable

from orientd.driver import AxisLimits, Joints, Quaternion, Vector3

EDGE = 1e-9
"""How far outside its range an axis is taken to be at the end of it, rad."""


class Reserve(NamedTuple):
    """How far the axes are from one of their singularities.

    Attributes:
        name: of the singularity, as messages name it.
        value: the distance; 0 is singular.
        least: how far the axes must be on a planned path, same unit.
        least_followed: how far they must be while targets are followed: a stop has to begin before
            it is known where it ends.
        unit: of the three.
        advice: how a motion stays away from it.
    """

    name: str
    value: float
    least: float
    least_followed: float
    unit: str = "rad"
    advice: str = ""


class Mechanism(ABC):
    """Axes that pose a tool.

    The planner makes the joints of every record of a motion by :meth:`nearest`, from where the
    device stands.  It holds them against :attr:`axes` and :meth:`reserve`, and runs the motion
    slower where an axis needs it.  A motion with times of its own is refused with the axis, the
    value and the time.

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

    def nearest(self, q: Quaternion, position: Vector3, near: Joints) -> Joints | None:
        """Return the joints that pose the tool so, on the branch and turns nearest to *near*, rad.

        The planner calls it for one record after the other, each time with the joints of the record
        before.  Override it where continuing is quicker than solving every branch, or where *near*
        has to say what a singular pose leaves open.

        Args:
            q: orientation ``(w, x, y, z)``, tool to world.
            position: of the tool in the world, m.
            near: joints of a pose close by, rad, unwrapped.

        Returns:
            ``None`` if the pose is out of reach.  The ranges of the axes are not looked at.
        """
        turned = [
            tuple(a + tau * round((b - a) / tau) for a, b in zip(one, near, strict=True))
            for one in self.solutions(q, position)
        ]
        return min(turned, key=lambda one: _apart(one, near), default=None)

    def completed(self, q: Quaternion, position: Vector3, outer: float, wanted: Joints) -> Joints:  # noqa: ARG002 - most mechanisms make no more of it
        """Return the joints that come nearest to a pose while the outermost axis is elsewhere, rad.

        Args:
            q: orientation ``(w, x, y, z)``, tool to world.
            position: of the tool in the world, m.
            outer: where the outermost axis is, rad.
            wanted: the joints that pose the tool so, rad.

        Returns:
            The first of them does not count, nor do whole turns.
        """
        return wanted

    def home(self) -> Joints:
        """Return the joints at home, rad; empty if the mechanism has no home."""
        return ()

    def reserve(self, joints: Joints) -> Sequence[Reserve]:  # noqa: ARG002 - many mechanisms have no singularity that they must not pass
        """Return how far *joints*, in rad, are from each singularity."""
        return ()

    def outline(self, joints: Joints) -> Sequence[Sequence[Vector3]]:  # noqa: ARG002 - not every mechanism is drawn
        """Return the shape as lines from point to point, m, for a picture; empty if there is none.

        Args:
            joints: angles of the axes, rad.
        """
        return ()


@runtime_checkable
class Mechanical(Protocol):
    """A driver whose device has a mechanism: the core then plans for its axes."""

    def mechanism(self, *, may_ask: bool) -> Mechanism | None:
        """Return the mechanism of the device; ``None`` to plan without its axes.

        The planner calls it for every plan and the daemon before targets are followed, on a driver
        that is not open; the servo on an enabled one.  A driver keeps what need not be asked again.

        Args:
            may_ask: whether the device may be asked; else the options alone say.

        Raises:
            LinkError: the device was asked and did not answer.
            PlanError: the options do not say enough.
        """


def inside(axes: Sequence[AxisLimits], joints: Joints, near: Joints) -> Joints | None:
    """Return *joints* on the turns inside the ranges of *axes* that are nearest to *near*, if any.

    Args:
        axes: their limits.
        joints: rad, whole turns aside.
        near: rad, unwrapped.
    """
    found = []
    for axis, angle, aim in zip(axes, joints, near, strict=True):
        least, most = ceil((axis.low - EDGE - angle) / tau), floor((axis.high + EDGE - angle) / tau)
        if least > most:
            return None
        turned = angle + tau * min(max(round((aim - angle) / tau), least), most)
        found.append(min(max(turned, axis.low), axis.high))
    return tuple(found)


def _apart(one: Joints, other: Joints) -> float:
    return max(abs(a - b) for a, b in zip(one, other, strict=True))
