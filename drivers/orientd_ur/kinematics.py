r"""Forward and inverse kinematics of a UR arm's flange, on plain floats.

The published arm has a geometric solution, joint by joint:

- The fifth frame lies :math:`d_6` behind the flange, and off the plane of shoulder and elbow by
  :math:`d_4`, which gives the base angle.
- The tool's axis relative to that plane gives the second wrist angle.  The plane seen from the
  tool gives the third.
- The rest is a triangle of upper arm and forearm in the plane.

Two choices each at shoulder, wrist and elbow make eight solutions.  At a straight second wrist the
first and third turn about the same axis; there the third keeps its angle.

An arm's own calibration differs from the published table by some tenths of a millimetre, and its
axes are not quite parallel.  Its joints come from an iteration: solve the published arm for a pose
shifted by the present error.  Each round is a thousand times closer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from math import atan2, cos, hypot, inf, pi, sin, sqrt, tau
from typing import NamedTuple

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import conjugate, multiply, plus, rotate_back
from orientd_ur.pose import Pose

Six = tuple[float, float, float, float, float, float]
_Axes = tuple[Vector3, Vector3, Vector3]

_STRAIGHT = 1e-7
_SAME_BRANCH = 0.1
# A calibration of tenths of a millimetre needs three rounds, away from singularities.  After a last
# change of this size the error is a thousand times smaller.
_ROUNDS = 25
_SETTLED = 1e-10
_NONE: Six = (0.0,) * 6


class Table(NamedTuple):
    """Denavit-Hartenberg parameters, joint by joint: rad and m."""

    theta: Six
    a: Six
    d: Six
    alpha: Six


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
        self.links = links
        self.is_calibrated = calibration is not None
        self._published = _columns(links.table)
        self._own = _columns(calibration) if calibration is not None else self._published

    def forward(self, joints: Sequence[float]) -> Pose:
        """Return the pose of the flange in the base for *joints*, rad."""
        return _flange(self._own, joints)

    def frames(self, joints: Sequence[float]) -> tuple[Vector3, ...]:
        """Return the origins of the base and of the six published frames in their order, m."""
        return ZERO, *(position for _, position in _frames(self._published, joints))

    def inverse(self, pose: Pose, near: Sequence[float]) -> Six | None:
        """Return the joints for the flange at *pose*, nearest to *near*, rad.

        This is the solution on the branch of *near* if it is close, otherwise the nearest of all.

        Returns:
            Angles beyond the joints' range if only a jump would lead back into it; ``None`` if the
            arm does not reach the pose.
        """
        best, least = None, inf
        # Near *near*, the error of the published table is nearly constant.
        goal = self._goal(pose, near)
        for found in self._branches(goal, self._branch(goal, near), near[5]):
            found = nearest_turns(found, near)
            distance = max(abs(a - b) for a, b in zip(found, near, strict=True))
            if distance < least:
                best, least = found, distance
            if distance < _SAME_BRANCH:
                break
        return best and self._settled(pose, best)

    def solutions(self, pose: Pose) -> list[Six]:
        """Return the joints of every branch for the flange at *pose*, rad."""
        every = self._branches(pose, (1.0, 1.0, 1.0), 0.0)
        own = (self._settled(pose, one) for one in every)
        return [one for one in own if one is not None]

    def _goal(self, pose: Pose, joints: Sequence[float]) -> Pose:
        """Return the pose of the published arm for which this arm reaches *pose* near *joints*."""
        if not self.is_calibrated:
            return pose
        (own_q, own), (q, position) = _flange(self._own, joints), _flange(self._published, joints)
        turn = multiply(pose[0], conjugate(own_q))
        moved = rotate_back(conjugate(turn), plus(position, own, -1.0))
        return multiply(turn, q), plus(pose[1], moved, 1.0)

    def _settled(self, pose: Pose, found: Six) -> Six | None:
        """Return the joints of this individual arm, from those of the published one."""
        for _ in range(_ROUNDS if self.is_calibrated else 0):
            goal = self._goal(pose, found)
            better = self._solve(goal, self._branch(goal, found), found[5])
            if better is None:
                return None
            better = nearest_turns(better, found)
            step = max(abs(a - b) for a, b in zip(better, found, strict=True))
            found = better
            if step < _SETTLED:
                break
        return found

    def _branch(self, pose: Pose, near: Sequence[float]) -> Vector3:
        """Return the signs of shoulder, wrist and elbow of the branch of *near* at *pose*."""
        x, y, _ = _wrist(pose, self.links.d6)
        return (
            1.0 if sin(near[0] - 0.5 * pi - atan2(y, x)) >= 0.0 else -1.0,
            1.0 if sin(near[4]) >= 0.0 else -1.0,
            1.0 if sin(near[2]) >= 0.0 else -1.0,
        )

    def _branches(self, pose: Pose, first: Vector3, last_q6: float) -> Iterator[Six]:
        """Yield the joints of the published arm on every branch, the *first* signs first."""
        for flips in product((1.0, -1.0), repeat=3):
            shoulder, wrist, elbow = (s * flip for s, flip in zip(first, flips, strict=True))
            found = self._solve(pose, (shoulder, wrist, elbow), last_q6)
            if found is not None:
                yield found

    def _solve(self, pose: Pose, signs: Vector3, last_q6: float) -> Six | None:
        """Return the joints of the published arm on one branch, rad; ``None`` if out of reach."""
        shoulder, wrist, elbow = signs
        d1, upper_arm, forearm, d4, d5, _ = self.links
        (r00, r10, r20), (r01, r11, r21), (r02, r12, _) = _axes(pose[0])
        x, y, z = _wrist(pose, self.links.d6)
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
        # The third side of the triangle, compared with the two others extended and folded.
        side = hypot(px, pz)
        stretched, folded = upper_arm + forearm, upper_arm - forearm
        above, below = (stretched - side) * (stretched + side), (side - folded) * (side + folded)
        if above < 0.0 or below < 0.0:
            return None
        q3 = elbow * 2.0 * atan2(sqrt(above), sqrt(below))
        q2 = atan2(-pz, -px) - atan2(forearm * sin(q3), upper_arm + forearm * cos(q3))
        return (q1, q2, q3, bend - q2 - q3, q5, q6)


def nearest_turns(angles: Sequence[float], near: Sequence[float]) -> Six:
    """Return *angles* plus the whole turns that bring each nearest to that of *near*, rad."""
    return tuple(  # type: ignore[return-value] # six of them, from six
        angle + tau * round((seed - angle) / tau) for angle, seed in zip(angles, near, strict=True)
    )


def _axes(q: Quaternion) -> _Axes:
    """Return the world axes rotated by *q*: the columns of its matrix."""
    w, x, y, z = q
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    )


def _quaternion(axes: _Axes) -> Quaternion:
    """Return the unit quaternion that rotates the world axes to these, by its largest component."""
    (r00, r10, r20), (r01, r11, r21), (r02, r12, r22) = axes
    four = (1 + r00 + r11 + r22, 1 + r00 - r11 - r22, 1 - r00 + r11 - r22, 1 - r00 - r11 + r22)
    largest = four.index(max(four))
    s = 0.5 / sqrt(four[largest])
    rows = (
        (four[0], r21 - r12, r02 - r20, r10 - r01),
        (r21 - r12, four[1], r01 + r10, r02 + r20),
        (r02 - r20, r01 + r10, four[2], r12 + r21),
        (r10 - r01, r02 + r20, r12 + r21, four[3]),
    )
    w, x, y, z = rows[largest]
    return (s * w, s * x, s * y, s * z)


def _wrist(pose: Pose, d6: float) -> Vector3:
    """Return the origin of the fifth frame, m."""
    _, _, axis = _axes(pose[0])
    return plus(pose[1], axis, -d6)


def _columns(table: Table) -> tuple[tuple[float, ...], ...]:
    """Return a table joint by joint, with cosine and sine of the twist."""
    twists = zip(map(cos, table.alpha), map(sin, table.alpha), strict=True)
    rest = zip(table.theta, table.a, table.d, strict=True)
    return tuple((*one, *twist) for one, twist in zip(rest, twists, strict=True))


def _frames(
    columns: Sequence[Sequence[float]], joints: Sequence[float]
) -> Iterator[tuple[_Axes, Vector3]]:
    """Yield the frame of each joint in the base, by its Denavit-Hartenberg parameters."""
    xx, xy, xz, yx, yy, yz, zx, zy, zz = 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    px = py = pz = 0.0
    # Component by component for speed: a calibrated arm is solved for every record of a path.
    for (theta, a, d, ca, sa), joint in zip(columns, joints, strict=True):
        c, s = cos(theta + joint), sin(theta + joint)
        vx, vy, vz = yx * c - xx * s, yy * c - xy * s, yz * c - xz * s
        xx, xy, xz = xx * c + yx * s, xy * c + yy * s, xz * c + yz * s
        px, py, pz = px + zx * d + xx * a, py + zy * d + xy * a, pz + zz * d + xz * a
        yx, yy, yz = vx * ca + zx * sa, vy * ca + zy * sa, vz * ca + zz * sa
        zx, zy, zz = zx * ca - vx * sa, zy * ca - vy * sa, zz * ca - vz * sa
        yield ((xx, xy, xz), (yx, yy, yz), (zx, zy, zz)), (px, py, pz)


def _flange(columns: Sequence[Sequence[float]], joints: Sequence[float]) -> Pose:
    *_, (axes, position) = _frames(columns, joints)
    return _quaternion(axes), position
