"""Forward and inverse kinematics of a UR arm's flange; ``kernels/c/arms.h`` has the mathematics."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
from math import cos, pi, sin
from typing import NamedTuple

from orientd.driver import IDENTITY, ZERO, Joints, Vector3
from orientd.mechanism.mechanism import Rows
from orientd_ur.pose import Pose

Six = tuple[float, float, float, float, float, float]

_BRANCHES = 8
_NONE: Six = (0.0,) * 6
BARE: Pose = (IDENTITY, ZERO)
"""The tool of a flange without one."""


class Table(NamedTuple):
    """Denavit-Hartenberg parameters, joint by joint: rad and m."""

    theta: Six
    a: Six
    d: Six
    alpha: Six

    def rows(self) -> Iterator[float]:
        """Yield theta, a, d, and cosine and sine of alpha of each joint."""
        for theta, a, d, alpha in zip(*self, strict=True):
            yield from (theta, a, d, cos(alpha), sin(alpha))


class Links(NamedTuple):
    """Published lengths of an arm, m; upper arm and forearm are positive, unlike in the tables."""

    d1: float
    upper_arm: float
    forearm: float
    d4: float
    d5: float
    d6: float

    @property
    def table(self) -> Table:
        """The table of an arm with these lengths."""
        return Table(
            theta=_NONE,
            a=(0.0, -self.upper_arm, -self.forearm, 0.0, 0.0, 0.0),
            d=(self.d1, 0.0, 0.0, self.d4, self.d5, self.d6),
            alpha=(0.5 * pi, 0.0, 0.0, 0.5 * pi, -0.5 * pi, 0.0),
        )


class Kinematics:
    """The kinematics of one arm.

    Args:
        links: its published lengths.
        calibration: its own parameters, if they are known.
    """

    def __init__(self, links: Links, calibration: Table | None = None) -> None:
        # Only here: who describes the driver loads no kernels.
        from orientd import kernels

        self._kernels = kernels
        self.links = links
        self.is_calibrated = calibration is not None
        own = calibration.rows() if calibration is not None else ()
        self._arm = array("d", (*links, *links.table.rows(), *own))

    def forward(self, joints: Sequence[float]) -> Pose:
        """Return the pose of the flange in the base for *joints*, rad."""
        return self._frames(joints, is_own=True)[-1]

    def frames(self, joints: Sequence[float]) -> tuple[Vector3, ...]:
        """Return the origins of the base and of the six published frames in their order, m."""
        return ZERO, *(position for _, position in self._frames(joints, is_own=False))

    def inverse(self, pose: Pose, near: Joints, tool: Pose = BARE) -> Joints | None:
        """Return the joints for *tool* of the flange at *pose*, nearest to *near*, rad.

        This is the solution on the branch of *near* if it is close, otherwise the nearest of all.

        Returns:
            Angles beyond the joints' range if only a jump would lead back into it; ``None`` if the
            arm does not reach the pose.
        """
        joints = Rows(1, 6)
        reached = self.follow(Rows(1, 7, _numbers(pose)), near, joints, 1, tool)
        return joints[0] if reached else None

    def solutions(self, pose: Pose, tool: Pose = BARE) -> list[Joints]:
        """Return the joints of every branch for *tool* of the flange at *pose*, rad."""
        joints = Rows(_BRANCHES, 6)
        count = self._kernels.solve_arm(self._arm, _numbers(tool), _numbers(pose), joints.view)
        return [joints[row] for row in range(count)]

    def follow(self, poses: Rows, near: Joints, joints: Rows, count: int, tool: Pose) -> int:
        """Write the joints for *tool* at *poses* as :meth:`.Mechanism.follow` does."""
        chosen, last = poses.view[:count], array("d", near)
        return self._kernels.follow_arm(self._arm, _numbers(tool), chosen, last, joints.view)

    def reserves(self, joints: Rows, found: Rows, count: int) -> None:
        """Write the distances from the singularities of wrist, elbow and shoulder."""
        self._kernels.reserve_arm(self._arm, joints.view[:count], found.view)

    def _frames(self, joints: Sequence[float], *, is_own: bool) -> list[Pose]:
        """Return the pose of each joint's frame in the base, by its own table or as published."""
        poses = Rows(6, 7)
        self._kernels.place_arm(self._arm, is_own, array("d", joints), poses.view)
        return [
            ((w, x, y, z), (a, b, c)) for w, x, y, z, a, b, c in map(poses.__getitem__, range(6))
        ]


def _numbers(pose: Pose) -> array[float]:
    return array("d", (*pose[0], *pose[1]))
