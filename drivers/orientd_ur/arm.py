"""An arm as a mechanism: its joints, its tool, and the published models.

Sources:

- Link lengths: Universal Robots, "DH Parameters for calculations of kinematics and dynamics"; the
  same values as ``config/*/default_kinematics.yaml`` of Universal_Robots_ROS2_Description
  (2221ec0).  UR7e and UR12e have the arms of UR5e and UR10e.  The UR15's lengths are from the
  first source only; :math:`a_2 + a_3 + d_5` is its reach of 1.300 m, as for every other model.
- Speeds and ranges: the user manuals, through ``config/*/joint_limits.yaml`` of the same package,
  without the half-turn range of the elbow, which that file has for planners.  The UR15's speeds are
  those of its data sheet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, radians, tau

from orientd.driver import AxisLimits, Joints, Quaternion, Vector3
from orientd.floats import conjugate, multiply, plus, rotate_back
from orientd.mechanism.mechanism import Mechanism, Reserve, Rows
from orientd_ur.kinematics import BARE, Kinematics, Links, Six
from orientd_ur.pose import Pose

JOINT_NAMES = ("base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3")

FASTEST_CHANGE = 40.0
"""Largest acceleration of a joint, rad/s^2.

``ur_rtde`` accepts no more from a program, and controllers report this value.
"""

# Closer than this, a joint turns many times faster than the tool on any path.
_LEAST = 0.02


@dataclass(frozen=True, eq=False)
class Arm(Mechanism):
    """One arm with its tool; world coordinates are those of its base.

    Attributes:
        name: of its model.
        kinematics: of this individual arm if its calibration is known, otherwise of the model.
        axes: limits of its joints.
        tool: pose of the tool in the flange.
        start: start joints of plans made without the robot, rad.
    """

    name: str
    kinematics: Kinematics
    axes: tuple[AxisLimits, ...]
    tool: Pose = BARE
    start: Joints = ()

    def seen(self, joints: Joints, pose: Pose) -> Arm:
        """Return this arm with the tool that is at *pose* with *joints*, rad.

        A deviation of the arm's own lengths becomes part of that tool.
        """
        q, position = self.kinematics.forward(joints)
        offset = rotate_back(q, plus(pose[1], position, -1.0))
        return replace(self, tool=(multiply(conjugate(q), pose[0]), offset))

    def slower(self, acceleration: float) -> Arm:
        """Return this arm with the acceleration of every joint limited, rad/s^2."""
        axes = (
            axis._replace(acceleration=min(axis.acceleration, acceleration)) for axis in self.axes
        )
        return replace(self, axes=tuple(axes))

    def home(self) -> Joints:
        """Return the start joints of plans made without the robot, rad."""
        return self.start

    def forward(self, joints: Joints) -> tuple[Quaternion, Vector3]:
        """Return the pose of the tool in the base for *joints*, rad."""
        q, position = self.kinematics.forward(joints)
        turn, offset = self.tool
        return multiply(q, turn), _beside(position, q, offset)

    def solutions(self, q: Quaternion, position: Vector3) -> Sequence[Joints]:
        """Return the joints of every branch, rad; wrist 3 is at 0 if wrist 2 is straight."""
        return self.kinematics.solutions((q, position), self.tool)

    def nearest(self, q: Quaternion, position: Vector3, near: Joints) -> Joints | None:
        """Return the joints on the branch of *near* if close, otherwise the nearest, rad."""
        return self.kinematics.inverse((q, position), near, self.tool)

    def follow(self, poses: Rows, near: Joints, joints: Rows, count: int) -> int:
        """Write the joints for *poses* one after the other, as :meth:`nearest` finds them."""
        return self.kinematics.follow(poses, near, joints, count, self.tool)

    def reserves(self, joints: Rows, found: Rows, count: int) -> None:
        """Write the distances of rows of joints from each kind of singularity."""
        self.kinematics.reserves(joints, found, count)

    def reserve(self, joints: Joints) -> Sequence[Reserve]:
        """Return the distance of *joints* from each kind of singularity; 0 is singular.

        ``wrist`` and ``elbow`` are sines of their bend.  ``shoulder`` is the distance of the fifth
        frame from the cylinder about the base axis that it cannot enter, in m.
        """
        found = Rows(1, 3)
        self.reserves(Rows(1, 6, joints), found, 1)
        wrist, elbow, shoulder = found[0]
        return (
            Reserve("wrist", wrist, _LEAST, 0.05, "rad",
                    "begin with wrist 2 bent, or turn about another axis"),
            Reserve("elbow", elbow, _LEAST, 0.1, "rad", "move the tool nearer to the base"),
            Reserve("shoulder", shoulder, _LEAST, 0.05, "m",
                    "move the tool away from the axis of the base"),
        )  # fmt: skip

    def outline(self, joints: Joints) -> Sequence[Sequence[Vector3]]:
        """Return the links from the base to the flange, m."""
        return (self.kinematics.frames(joints),) if len(joints) == len(JOINT_NAMES) else ()


def _beside(point: Vector3, q: Quaternion, offset: Vector3) -> Vector3:
    """Return the point that is *offset* away from *point* in the coordinates of *q*."""
    return plus(point, rotate_back(conjugate(q), offset), 1.0)


@dataclass(frozen=True, slots=True)
class ArmModel:
    """One model of arm.

    Attributes:
        name: in lower case, as in ``ur10e``.
        links: its lengths.
        speeds: largest speed of each joint, rad/s.
        ranges: how far each joint turns in either direction, rad.
    """

    name: str
    links: Links
    speeds: Six
    ranges: Six

    def arm(self) -> Arm:
        """Return the arm with its published values."""
        limits = zip(JOINT_NAMES, self.ranges, self.speeds, strict=True)
        axes = (AxisLimits(name, -most, most, v, FASTEST_CHANGE) for name, most, v in limits)
        return Arm(self.name, Kinematics(self.links), tuple(axes))


_WHOLE_TURNS: Six = (tau, tau, tau, tau, tau, tau)
_ENDLESS_WRIST: Six = (tau, tau, tau, tau, tau, inf)


def _model(name: str, links: Sequence[float], degrees: Sequence[float], ranges: Six) -> ArmModel:
    base, shoulder, elbow, wrists = map(radians, degrees)
    return ArmModel(name, Links(*links), (base, shoulder, elbow, wrists, wrists, wrists), ranges)


_UR5E = (0.1625, 0.425, 0.3922, 0.1333, 0.0997, 0.0996)
_UR10E = (0.1807, 0.6127, 0.57155, 0.17415, 0.11985, 0.11655)
_SMALL, _MEDIUM = (180, 180, 180, 360), (180, 180, 180, 180)
_LARGE, _HEAVY = (120, 120, 180, 180), (120, 120, 150, 210)

MODELS: dict[str, ArmModel] = {
    model.name: model
    for model in (
        _model("ur3", (0.1519, 0.24365, 0.21325, 0.11235, 0.08535, 0.0819), _SMALL, _ENDLESS_WRIST),
        _model("ur5", (0.089159, 0.425, 0.39225, 0.10915, 0.09465, 0.0823), _MEDIUM, _WHOLE_TURNS),
        _model("ur10", (0.1273, 0.612, 0.5723, 0.163941, 0.1157, 0.0922), _LARGE, _WHOLE_TURNS),
        _model(
            "ur3e", (0.15185, 0.24355, 0.2132, 0.13105, 0.08535, 0.0921), _SMALL, _ENDLESS_WRIST
        ),
        _model("ur5e", _UR5E, _MEDIUM, _WHOLE_TURNS),
        _model("ur7e", _UR5E, _MEDIUM, _WHOLE_TURNS),
        _model("ur10e", _UR10E, _LARGE, _WHOLE_TURNS),
        _model("ur12e", _UR10E, _LARGE, _WHOLE_TURNS),
        _model("ur16e", (0.1807, 0.4784, 0.36, 0.17415, 0.11985, 0.11655), _LARGE, _WHOLE_TURNS),
        _model(
            "ur15",
            (0.2186, 0.6475, 0.5164, 0.1824, 0.1361, 0.1434),
            (180, 180, 240, 300),
            _WHOLE_TURNS,
        ),
        _model("ur20", (0.2363, 0.862, 0.7287, 0.201, 0.1593, 0.1543), _HEAVY, _WHOLE_TURNS),
        _model("ur30", (0.2363, 0.637, 0.5037, 0.201, 0.1593, 0.1543), _HEAVY, _WHOLE_TURNS),
    )
}
"""The published arms by name."""
