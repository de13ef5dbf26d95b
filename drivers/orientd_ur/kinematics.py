r"""Forward and inverse kinematics of a UR arm, on plain floats.

Denavit-Hartenberg parameters are those of :mod:`orientd_ur.arm.models`; an arm is solved as
geometry, joint by joint:

- the fifth frame lies :math:`d_6` behind the flange, and off the plane of shoulder and elbow by
  :math:`d_4`, which gives the base angle;
- the tool's axis against that plane gives the second wrist angle, and the plane seen from the tool
  the third;
- what is left is a triangle of upper arm and forearm in the plane.

Two choices each at shoulder, wrist and elbow make eight solutions.  At a straight second wrist the
first and third turn about the same axis; there the third keeps its angle.

An arm's own calibration differs from the published table by some tenths of a millimetre, and its
axes are not quite parallel.  Its pose is the product of its own transforms; its joints are found by
solving the published arm for the pose that differs by as much, again and again: each round is a
thousand times closer.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from itertools import product
from math import atan2, cos, hypot, inf, pi, sin, sqrt, tau
from typing import NamedTuple

from orientd.driver import Quaternion, Vector3
from orientd.floats import combine

Six = tuple[float, float, float, float, float, float]
Joints = Six
Matrix = tuple[Vector3, Vector3, Vector3]
Pose = tuple[Matrix, Vector3]

JOINT_NAMES = ("base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3")

_STRAIGHT = 1e-7
_SAME_BRANCH = 0.1
# A calibration of tenths of a millimetre needs four rounds, away from singularities; what moved by
# this much last is a thousand times closer now.
_ROUNDS = 25
_SETTLED = 1e-10


class Links(NamedTuple):
    """Published lengths of an arm, m; upper arm and forearm are positive, unlike in the tables."""

    d1: float
    upper_arm: float
    forearm: float
    d4: float
    d5: float
    d6: float


class Calibration(NamedTuple):
    """The Denavit-Hartenberg parameters of one arm, joint by joint: rad and m."""

    theta: Six
    a: Six
    d: Six
    alpha: Six


def matrix(q: Quaternion) -> Matrix:
    """Return the rotation matrix of a unit quaternion, row by row."""
    w, x, y, z = q
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        (2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        (2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )


def quaternion(rotation: Matrix) -> Quaternion:
    """Return the unit quaternion of a rotation matrix, from its largest component."""
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rotation
    four = (1 + r00 + r11 + r22, 1 + r00 - r11 - r22, 1 - r00 + r11 - r22, 1 - r00 - r11 + r22)
    largest = four.index(max(four))
    s = 0.5 / sqrt(four[largest])
    if largest == 0:
        return (s * four[0], s * (r21 - r12), s * (r02 - r20), s * (r10 - r01))
    if largest == 1:
        return (s * (r21 - r12), s * four[1], s * (r01 + r10), s * (r02 + r20))
    if largest == 2:
        return (s * (r02 - r20), s * (r01 + r10), s * four[2], s * (r12 + r21))
    return (s * (r10 - r01), s * (r02 + r20), s * (r12 + r21), s * four[3])


class Kinematics:
    """The kinematics of one arm.

    Args:
        links: its published lengths.
        calibration: its own parameters, where they are known.
    """

    def __init__(self, links: Links, calibration: Calibration | None = None) -> None:
        self._links = links
        self._calibration = calibration

    @property
    def is_calibrated(self) -> bool:
        """Whether these are an arm's own parameters."""
        return self._calibration is not None

    def forward(self, joints: Sequence[float]) -> Pose:
        """Return the flange's rotation and position (m) in the base for *joints* (rad)."""
        if self._calibration is None:
            return self._published(joints)
        columns = zip(*self._calibration, joints, strict=True)
        return reduce(_times, (_transform(*column) for column in columns))

    def inverse(self, rotation: Matrix, position: Vector3, near: Sequence[float]) -> Joints | None:
        """Return the joints that bring the flange to *rotation* and *position*, nearest to *near*.

        The solution on the branch of *near* is taken when it is close by, else the nearest of all.

        Returns:
            Angles in rad, beyond the joints' range where only a jump would lead back into it;
            ``None`` where the arm does not reach.
        """
        found = self._solve_published(rotation, position, near)
        if self._calibration is None or found is None:
            return found
        for _ in range(_ROUNDS):
            # What the published arm would have to reach for this one to reach the pose.
            off = _times((rotation, position), _inverted(self.forward(found)))
            better = self._solve_published(*_times(off, self._published(found)), found)
            if better is None:
                return None
            moved = max(abs(a - b) for a, b in zip(better, found, strict=True))
            found = better
            if moved < _SETTLED:
                break
        return found

    def frames(self, joints: Sequence[float]) -> tuple[Vector3, ...]:
        """Return the origins of the base and of the six published frames in their order (m)."""
        d1, upper_arm, forearm, d4, d5, _ = self._links
        q1, q2, q3, q4, _, _ = joints
        u, n = (cos(q1), sin(q1), 0.0), (sin(q1), -cos(q1), 0.0)
        bend = q2 + q3 + q4
        _, flange = self._published(joints)
        shoulder = (0.0, 0.0, d1)
        elbow = _beside(shoulder, u, -upper_arm * cos(q2), -upper_arm * sin(q2))
        forearm_end = _beside(elbow, u, -forearm * cos(q2 + q3), -forearm * sin(q2 + q3))
        wrist_1 = _beside(forearm_end, n, d4, 0.0)
        wrist_2 = _beside(wrist_1, u, d5 * sin(bend), -d5 * cos(bend))
        return (0.0, 0.0, 0.0), shoulder, elbow, forearm_end, wrist_1, wrist_2, flange

    def reserve(self, joints: Sequence[float]) -> dict[str, float]:
        """Return how far *joints* are from each kind of singularity; 0 is singular.

        ``wrist`` and ``elbow`` are sines of the bend there; ``shoulder`` is how far the fifth frame
        is from the cylinder about the base axis that it cannot enter, in m.
        """
        _, q2, q3, q4, q5, _ = joints
        along = (
            -self._links.upper_arm * cos(q2)
            - self._links.forearm * cos(q2 + q3)
            + self._links.d5 * sin(q2 + q3 + q4)
        )
        return {"wrist": abs(sin(q5)), "elbow": abs(sin(q3)), "shoulder": abs(along)}

    def _published(self, joints: Sequence[float]) -> Pose:
        d1, upper_arm, forearm, d4, d5, d6 = self._links
        q1, q2, q3, q4, q5, q6 = joints
        c1, s1 = cos(q1), sin(q1)
        # The plane of shoulder and elbow is spanned by u (outward) and z; n is normal to it.
        u, n = (c1, s1, 0.0), (s1, -c1, 0.0)
        bend = q2 + q3 + q4
        along = -upper_arm * cos(q2) - forearm * cos(q2 + q3) + d5 * sin(bend)
        height = d1 - upper_arm * sin(q2) - forearm * sin(q2 + q3) - d5 * cos(bend)
        # The axes of the fourth frame, then those of the flange.
        x4 = (u[0] * cos(bend), u[1] * cos(bend), sin(bend))
        y4 = (u[0] * sin(bend), u[1] * sin(bend), -cos(bend))
        c5, s5, c6, s6 = cos(q5), sin(q5), cos(q6), sin(q6)
        axis = combine(n, c5, x4, -s5)
        x5 = combine(x4, c5, n, s5)
        x6, y6 = combine(x5, c6, y4, -s6), combine(x5, -s6, y4, -c6)
        position = (
            u[0] * along + n[0] * d4 + axis[0] * d6,
            u[1] * along + n[1] * d4 + axis[1] * d6,
            height + axis[2] * d6,
        )
        return ((x6[0], y6[0], axis[0]), (x6[1], y6[1], axis[1]), (x6[2], y6[2], axis[2])), position

    def _solve_published(
        self, rotation: Matrix, position: Vector3, near: Sequence[float]
    ) -> Joints | None:
        best, least = None, inf
        signs = (
            self._shoulder_sign(rotation, position, near),
            1.0 if sin(near[4]) >= 0.0 else -1.0,
            1.0 if sin(near[2]) >= 0.0 else -1.0,
        )
        for flips in product((1.0, -1.0), repeat=3):
            shoulder, wrist, elbow = (s * f for s, f in zip(signs, flips, strict=True))
            found = self._solve(rotation, position, shoulder, wrist, elbow, near[5])
            if found is None:
                continue
            turned = tuple(_near(angle, seed) for angle, seed in zip(found, near, strict=True))
            distance = max(abs(a - b) for a, b in zip(turned, near, strict=True))
            if distance < least:
                best, least = turned, distance
            if distance < _SAME_BRANCH:
                break
        return best  # type: ignore[return-value] # six of them, from six

    def _solve(
        self,
        rotation: Matrix,
        position: Vector3,
        shoulder: float,
        wrist: float,
        elbow: float,
        last_q6: float,
    ) -> Joints | None:
        d1, upper_arm, forearm, d4, d5, d6 = self._links
        (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rotation
        x, y, z = position[0] - d6 * r02, position[1] - d6 * r12, position[2] - d6 * r22
        reach = hypot(x, y)
        if reach < d4:
            return None
        q1 = atan2(y, x) + shoulder * atan2(sqrt((reach - d4) * (reach + d4)), d4) + 0.5 * pi
        c1, s1 = cos(q1), sin(q1)
        # The normal of the arm's plane, n = (s1, -c1, 0), in the flange's coordinates.
        nx, ny, nz = r00 * s1 - r10 * c1, r01 * s1 - r11 * c1, r02 * s1 - r12 * c1
        sine5 = hypot(nx, ny)
        q5 = atan2(wrist * sine5, nz)
        q6 = last_q6 if sine5 < _STRAIGHT else atan2(-wrist * ny, wrist * nx)
        c6, s6 = cos(q6), sin(q6)
        # y of the fourth frame, negative, from the flange; the plane's angle from it.
        ax, ay, az = r00 * s6 + r01 * c6, r10 * s6 + r11 * c6, r20 * s6 + r21 * c6
        outward = ax * c1 + ay * s1
        bend = atan2(-outward, az)
        px = (x * c1 + y * s1) + d5 * outward
        pz = z - d1 + d5 * az
        # The third side of the triangle, against its two sides stretched and folded.
        side = hypot(px, pz)
        stretched, folded = upper_arm + forearm, upper_arm - forearm
        above, below = (stretched - side) * (stretched + side), (side - folded) * (side + folded)
        if above < 0.0 or below < 0.0:
            return None
        q3 = elbow * 2.0 * atan2(sqrt(above), sqrt(below))
        q2 = atan2(-pz, -px) - atan2(forearm * sin(q3), upper_arm + forearm * cos(q3))
        return (q1, q2, q3, bend - q2 - q3, q5, q6)

    def _shoulder_sign(self, rotation: Matrix, position: Vector3, near: Sequence[float]) -> float:
        x = position[0] - self._links.d6 * rotation[0][2]
        y = position[1] - self._links.d6 * rotation[1][2]
        return 1.0 if sin(near[0] - 0.5 * pi - atan2(y, x)) >= 0.0 else -1.0


def _transform(theta: float, a: float, d: float, alpha: float, joint: float) -> Pose:
    """Return the transform of one joint from its Denavit-Hartenberg parameters."""
    c, s = cos(theta + joint), sin(theta + joint)
    ca, sa = cos(alpha), sin(alpha)
    return ((c, -s * ca, s * sa), (s, c * ca, -c * sa), (0.0, sa, ca)), (a * c, a * s, d)


def _times(first: Pose, then: Pose) -> Pose:
    """Return the pose of *then*, given in the coordinates of *first*."""
    (rows, origin), (other, offset) = first, then
    columns = tuple(zip(*other, strict=True))
    turned = tuple(
        tuple(sum(p * q for p, q in zip(row, column, strict=True)) for column in columns)
        for row in rows
    )
    at = tuple(
        o + sum(p * q for p, q in zip(row, offset, strict=True))
        for row, o in zip(rows, origin, strict=True)
    )
    return turned, at  # type: ignore[return-value] # three by three, and three


def _inverted(pose: Pose) -> Pose:
    rows, origin = pose
    back = tuple(zip(*rows, strict=True))
    at = tuple(-sum(p * q for p, q in zip(row, origin, strict=True)) for row in back)
    return back, at  # type: ignore[return-value] # three by three, and three


def _near(angle: float, seed: float) -> float:
    return angle + tau * round((seed - angle) / tau)


def _beside(point: Vector3, direction: Vector3, along: float, up: float) -> Vector3:
    x, y, z = combine(point, 1.0, direction, along)
    return (x, y, z + up)
