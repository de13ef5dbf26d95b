"""The tool on the arm's flange: its poses, its speeds, and its inverse kinematics."""

from __future__ import annotations

from collections.abc import Sequence

from emulated_ur.arm.arm import Arm, Mode
from emulated_ur.arm.kinematics import Joints, speed
from emulated_ur.arm.transforms import Pose, Transform, from_pose, inverse, moved, multiply, to_pose


class UnreachableError(Exception):
    """A pose that no joint angles reach; it ends a program."""


class Tool:
    """The tool centre point that an arm carries.

    Attributes:
        offset: pose of the tool centre point in the flange.
    """

    def __init__(self, arm: Arm) -> None:
        self.offset: Pose = (0.0,) * 6
        self._arm = arm
        self._poses: dict[str, Pose] = {}
        self._last_solution: tuple[Pose, Pose, Joints] | None = None

    def forget_poses(self) -> None:
        """Drop the values computed for the last tick."""
        self._poses.clear()

    def at(self, q: Sequence[float], offset: Pose | None = None) -> Transform:
        """Return the tool for joint angles *q*, or one with another offset."""
        flange = self._arm.kinematics.forward(q)
        return multiply(flange, from_pose(self.offset if offset is None else offset))

    def find_joints(
        self,
        pose: Sequence[float],
        near: Sequence[float] | None = None,
        offset: Sequence[float] | None = None,
    ) -> Joints | None:
        """Return the joint angles for a pose of the tool, or ``None`` out of reach.

        By default *near* is the last result, so that a stream of poses gives joint angles without
        jumps.
        """
        offset = self.offset if offset is None else tuple(offset)
        key = (tuple(pose), offset)
        if near is None:
            near = self._arm.target_q
            if self._arm.mode is Mode.SERVO and self._last_solution is not None:
                if self._last_solution[:2] == key:
                    return self._last_solution[2]
                near = self._last_solution[2]
        flange = multiply(from_pose(pose), inverse(from_pose(offset)))
        q = self._arm.kinematics.inverse(flange, near)
        self._last_solution = None if q is None else (*key, q)
        return q

    def joints_at(self, pose: Sequence[float], *how: Sequence[float] | None) -> Joints:
        """Return the result of :meth:`find_joints`.

        Raises:
            UnreachableError: the arm does not reach it, which ends a program.
        """
        q = self.find_joints(pose, *how)
        if q is None:
            raise UnreachableError(f"get_inverse_kin: no solution for {tuple(pose)}")
        return q

    def pose_ahead(self, speeds: Sequence[float], dt: float) -> Pose:
        """Return the commanded pose *dt* seconds on, at tool *speeds* (m/s and rad/s)."""
        step = [rate * dt for rate in speeds]
        return to_pose(moved(self.at(self._arm.target_q), step[:3], step[3:]))

    def pose(self, which: str) -> Pose:
        """Return one of the four poses and speeds of the tool, computed once a tick.

        Args:
            which: ``actual_TCP_pose``, ``actual_TCP_speed``, ``target_TCP_pose`` or
                ``target_TCP_speed``.
        """
        if which not in self._poses:
            source = which[:6]
            q = self._arm.actual_q if source == "actual" else self._arm.target_q
            qd = self._arm.actual_qd if source == "actual" else self._arm.target_qd
            chain = self._arm.kinematics.frames(q)
            tool = multiply(chain[-1], from_pose(self.offset))
            self._poses[f"{source}_TCP_pose"] = to_pose(tool)
            self._poses[f"{source}_TCP_speed"] = speed(chain, qd, tool[3::4])
        return self._poses[which]
