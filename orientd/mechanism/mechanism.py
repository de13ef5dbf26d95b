"""The contract of a mechanism: limited axes that pose a tool.

Plain floats only, since the servo process loads it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from array import array
from collections.abc import Iterable, Sequence
from math import ceil, floor, tau
from typing import NamedTuple, Protocol, runtime_checkable

from orientd.driver import AxisLimits, Joints, Quaternion, Vector3

_ROUNDING = 1e-9
"""Rounding of an angle at the end of a range, rad."""


class Reserve(NamedTuple):
    """Distance of the axes from one of their singularities.

    Attributes:
        name: of the singularity, as messages name it.
        value: the distance; 0 is singular.
        least: least distance on a planned path, same unit.
        least_followed: least distance while targets are followed.  It is larger, because a stop
            must begin before its end is known.
        unit: of the three.
        advice: how a motion can avoid the singularity.
    """

    name: str
    value: float
    least: float
    least_followed: float
    unit: str = "rad"
    advice: str = ""


class Rows:
    """Rows of floats in one piece of memory, as kernels take them, without NumPy.

    Attributes:
        flat: the numbers, row after row.
        view: the same with two dimensions; a slice of it has fewer rows.
    """

    __slots__ = ("flat", "view", "width")

    def __init__(self, count: int, width: int, numbers: Iterable[float] | bytes = b"") -> None:
        """Create *count* rows of *width* zeros, or of *numbers*, which may be those in memory."""
        self.width = width
        self.flat = array("d", numbers or bytes(8 * count * width))
        self.view = memoryview(self.flat).cast("B").cast("d", (count, width))

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.view)

    def __getitem__(self, row: int) -> tuple[float, ...]:
        """Return the numbers of a row."""
        return tuple(self.flat[row * self.width : (row + 1) * self.width])

    def __setitem__(self, row: int, numbers: Iterable[float]) -> None:
        """Write the numbers of a row."""
        self.flat[row * self.width : (row + 1) * self.width] = array("d", numbers)


class Mechanism(ABC):
    """Axes that pose a tool.

    The planner computes the joints of every record of a motion with :meth:`nearest`, starting from
    the device's joints.  It checks them against :attr:`axes` and :meth:`reserve`, and slows the
    motion down if an axis needs it.  If the request sets the times, the planner refuses the motion
    instead, with the axis, the value and the time.

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
        """Return the joints of every branch for a pose, rad, without whole turns.

        Args:
            q: orientation ``(w, x, y, z)``, tool to world.
            position: of the tool in the world, m.

        Returns:
            An empty sequence if the pose is out of reach.
        """

    def nearest(self, q: Quaternion, position: Vector3, near: Joints) -> Joints | None:
        """Return the joints for a pose on the branch and turns nearest to *near*, rad.

        The planner calls it for one record after the other, each time with the joints of the
        previous record.  Override it if continuing is faster than solving every branch, or if
        *near* must resolve a singular pose.

        Args:
            q: orientation ``(w, x, y, z)``, tool to world.
            position: of the tool in the world, m.
            near: joints of a pose close by, rad, unwrapped.

        Returns:
            ``None`` if the pose is out of reach.  The ranges of the axes are not checked.
        """
        turned = [
            tuple(a + tau * round((b - a) / tau) for a, b in zip(one, near, strict=True))
            for one in self.solutions(q, position)
        ]
        return min(turned, key=lambda one: _apart(one, near), default=None)

    def follow(self, poses: Rows, near: Joints, joints: Rows, count: int) -> int:
        """Write the joints for poses one after the other, each by :meth:`nearest`.

        Override it if the mechanism can follow many poses at once faster.

        Args:
            poses: orientation ``(w, x, y, z)`` and position, m: rows of 7.
            near: joints of a pose close to the first, rad, unwrapped.
            joints: receives them, rad: rows of as many as there are axes.
            count: number of poses.

        Returns:
            Number of poses before the first that is out of reach.
        """
        for row in range(count):
            w, x, y, z, *position = poses[row]
            a, b, c = position
            found = self.nearest((w, x, y, z), (a, b, c), near)
            if found is None:
                return row
            joints[row] = near = found
        return count

    def completed(self, q: Quaternion, position: Vector3, outer: float, wanted: Joints) -> Joints:  # noqa: ARG002 - most mechanisms need no more
        """Return the joints closest to a pose with the outermost axis elsewhere, rad.

        Args:
            q: orientation ``(w, x, y, z)``, tool to world.
            position: of the tool in the world, m.
            outer: angle of the outermost axis, rad.
            wanted: the joints for the exact pose, rad.

        Returns:
            Axis angles, of which the first one and any whole turns are ignored.
        """
        return wanted

    def home(self) -> Joints:
        """Return the joints at home, rad; empty if the mechanism has no home."""
        return ()

    def reserve(self, joints: Joints) -> Sequence[Reserve]:  # noqa: ARG002 - many mechanisms have no singularity to avoid
        """Return how far *joints*, in rad, are from each singularity."""
        return ()

    def reserves(self, joints: Rows, found: Rows, count: int) -> None:
        """Write the values of :meth:`reserve` for rows of joints.

        Args:
            joints: rad.
            found: receives them: rows of as many as there are singularities.
            count: number of rows.
        """
        for row in range(count):
            found[row] = [one.value for one in self.reserve(joints[row])]

    def outline(self, joints: Joints) -> Sequence[Sequence[Vector3]]:  # noqa: ARG002 - drawing is optional
        """Return the shape as lines from point to point, m, for drawing; empty if there is none.

        Args:
            joints: angles of the axes, rad.
        """
        return ()


@runtime_checkable
class Mechanical(Protocol):
    """A driver whose device has a mechanism: orientd then plans for its axes."""

    def mechanism(self, *, may_ask: bool) -> Mechanism | None:
        """Return the mechanism of the device; ``None`` to plan without its axes.

        The planner calls it for every plan, and the daemon before targets are followed, on a driver
        that is not open.  The servo calls it on an enabled driver.  A driver should cache answers
        of the device.

        Args:
            may_ask: whether to ask the device; otherwise the options alone decide.

        Raises:
            LinkError: the device does not answer.
            PlanError: the options are not sufficient.
        """


def refusal(mechanism: Mechanism, q: Quaternion, position: Vector3, joints: Joints) -> str:
    """Return why a device cannot reach a target, or an empty string.

    Args:
        mechanism: the device's mechanism.
        q: tool orientation.
        position: tool position, m.
        joints: current joints, rad.
    """
    found = mechanism.nearest(q, position, joints)
    if found is None:
        return "the device does not reach there"
    for axis, angle in zip(mechanism.axes, found, strict=True):
        if not axis.low <= angle <= axis.high:
            most = axis.high if angle > axis.high else axis.low
            return (
                f"{axis.name} would have to turn to {angle:.4g} rad, its range ends at {most:.4g}"
            )
    for one in mechanism.reserve(found):
        if one.value < one.least_followed:
            return (
                f"the {one.name} is {one.value:.3g} {one.unit} from its singularity there, the "
                f"least is {one.least_followed:g}"
            )
    return ""


def inside(axes: Sequence[AxisLimits], joints: Joints, near: Joints) -> Joints | None:
    """Return *joints* on the turns nearest to *near* inside the ranges of *axes*, if any.

    Args:
        axes: limits of the axes.
        joints: rad, without whole turns.
        near: rad, unwrapped.
    """
    found = []
    for axis, angle, aim in zip(axes, joints, near, strict=True):
        low, high = axis.low - _ROUNDING, axis.high + _ROUNDING
        least, most = ceil((low - angle) / tau), floor((high - angle) / tau)
        if least > most:
            return None
        turned = angle + tau * min(max(round((aim - angle) / tau), least), most)
        found.append(min(max(turned, axis.low), axis.high))
    return tuple(found)


def _apart(one: Joints, other: Joints) -> float:
    return max(abs(a - b) for a, b in zip(one, other, strict=True))
