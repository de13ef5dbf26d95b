r"""Forward and inverse kinematics of the UR5e, on plain floats.

Denavit-Hartenberg parameters: Universal Robots, "DH Parameters for calculations of kinematics and
dynamics" (UR5e).  The arm is solved as geometry, joint by joint:

- the fifth frame lies :math:`d_6` behind the flange, and off the plane of shoulder and elbow by
  :math:`d_4`, which gives the base angle;
- the tool's axis against that plane gives the second wrist angle, and the plane seen from the tool
  the third;
- what is left is a triangle of upper arm and forearm in the plane.

Two choices each at shoulder, wrist and elbow make eight solutions.  At a straight second wrist the
first and third turn about the same axis; there the third keeps its angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from math import acos, atan2, cos, hypot, inf, pi, sin, sqrt, tau

from orientd.driver import Quaternion, Vector3

Joints = tuple[float, float, float, float, float, float]
Matrix = tuple[Vector3, Vector3, Vector3]

JOINT_NAMES = ("base", "shoulder", "elbow", "wrist 1", "wrist 2", "wrist 3")
JOINT_SPEED = pi
"""Largest speed of every joint of a UR5e, rad/s."""
JOINT_RANGE = tau
"""Every joint turns so far either way, rad."""

_D1, _D4, _D5, _D6 = 0.1625, 0.1333, 0.0997, 0.0996
_UPPER_ARM, _FOREARM = 0.425, 0.3922

_STRAIGHT = 1e-7
_SAME_BRANCH = 0.1


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


def forward(joints: Sequence[float]) -> tuple[Matrix, Vector3]:
    """Return the flange's rotation and position (m) in the base for *joints* (rad)."""
    q1, q2, q3, q4, q5, q6 = joints
    c1, s1 = cos(q1), sin(q1)
    # The plane of shoulder and elbow is spanned by u (outward) and z; n is normal to it.
    u, n = (c1, s1, 0.0), (s1, -c1, 0.0)
    bend = q2 + q3 + q4
    along = -_UPPER_ARM * cos(q2) - _FOREARM * cos(q2 + q3) + _D5 * sin(bend)
    height = _D1 - _UPPER_ARM * sin(q2) - _FOREARM * sin(q2 + q3) - _D5 * cos(bend)
    # The axes of the fourth frame, then those of the flange.
    x4 = (u[0] * cos(bend), u[1] * cos(bend), sin(bend))
    y4 = (u[0] * sin(bend), u[1] * sin(bend), -cos(bend))
    c5, s5, c6, s6 = cos(q5), sin(q5), cos(q6), sin(q6)
    axis = _mix(n, c5, x4, -s5)
    x5 = _mix(x4, c5, n, s5)
    x6, y6 = _mix(x5, c6, y4, -s6), _mix(x5, -s6, y4, -c6)
    position = (
        u[0] * along + n[0] * _D4 + axis[0] * _D6,
        u[1] * along + n[1] * _D4 + axis[1] * _D6,
        height + axis[2] * _D6,
    )
    return ((x6[0], y6[0], axis[0]), (x6[1], y6[1], axis[1]), (x6[2], y6[2], axis[2])), position


def frames(joints: Sequence[float]) -> tuple[Vector3, ...]:
    """Return the origins of the base, of the six Denavit-Hartenberg frames in their order (m)."""
    q1, q2, q3, q4, _, _ = joints
    u, n = (cos(q1), sin(q1), 0.0), (sin(q1), -cos(q1), 0.0)
    bend = q2 + q3 + q4
    _, flange = forward(joints)
    shoulder = (0.0, 0.0, _D1)
    elbow = _beside(shoulder, u, -_UPPER_ARM * cos(q2), -_UPPER_ARM * sin(q2))
    forearm_end = _beside(elbow, u, -_FOREARM * cos(q2 + q3), -_FOREARM * sin(q2 + q3))
    wrist_1 = _beside(forearm_end, n, _D4, 0.0)
    wrist_2 = _beside(wrist_1, u, _D5 * sin(bend), -_D5 * cos(bend))
    return (0.0, 0.0, 0.0), shoulder, elbow, forearm_end, wrist_1, wrist_2, flange


def inverse(rotation: Matrix, position: Vector3, near: Sequence[float]) -> Joints | None:
    """Return the joints that bring the flange to *rotation* and *position*, nearest to *near*.

    The solution on the branch of *near* is taken when it is close by, else the nearest of all.

    Returns:
        Angles in rad, beyond the joints' range where only a jump would lead back into it; ``None``
        where the arm does not reach.
    """
    best, least = None, inf
    signs = (
        _shoulder_sign(rotation, position, near),
        1.0 if sin(near[4]) >= 0.0 else -1.0,
        1.0 if sin(near[2]) >= 0.0 else -1.0,
    )
    for flips in product((1.0, -1.0), repeat=3):
        shoulder, wrist, elbow = (s * f for s, f in zip(signs, flips, strict=True))
        found = _solve(rotation, position, shoulder, wrist, elbow, near[5])
        if found is None:
            continue
        turned = tuple(_near(angle, seed) for angle, seed in zip(found, near, strict=True))
        distance = max(abs(a - b) for a, b in zip(turned, near, strict=True))
        if distance < least:
            best, least = turned, distance
        if distance < _SAME_BRANCH:
            break
    return best  # type: ignore[return-value] # six of them, from six


def reserve(joints: Sequence[float]) -> dict[str, float]:
    """Return how far *joints* are from each kind of singularity; 0 is singular.

    ``wrist`` and ``elbow`` are sines of the bend there; ``shoulder`` is how far the fifth frame
    is from the cylinder about the base axis that it cannot enter, in m.
    """
    _, q2, q3, q4, q5, _ = joints
    bend = q2 + q3 + q4
    along = -_UPPER_ARM * cos(q2) - _FOREARM * cos(q2 + q3) + _D5 * sin(bend)
    return {"wrist": abs(sin(q5)), "elbow": abs(sin(q3)), "shoulder": abs(along)}


def _solve(
    rotation: Matrix, position: Vector3, shoulder: float, wrist: float, elbow: float, last_q6: float
) -> Joints | None:
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = rotation
    x, y, z = position[0] - _D6 * r02, position[1] - _D6 * r12, position[2] - _D6 * r22
    reach = hypot(x, y)
    if reach < _D4:
        return None
    q1 = atan2(y, x) + shoulder * acos(_D4 / reach) + 0.5 * pi
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
    px = (x * c1 + y * s1) + _D5 * outward
    pz = z - _D1 + _D5 * az
    cosine3 = (px * px + pz * pz - _UPPER_ARM**2 - _FOREARM**2) / (2.0 * _UPPER_ARM * _FOREARM)
    if abs(cosine3) > 1.0:
        return None
    q3 = atan2(elbow * sqrt(1.0 - cosine3 * cosine3), cosine3)
    q2 = atan2(-pz, -px) - atan2(_FOREARM * sin(q3), _UPPER_ARM + _FOREARM * cosine3)
    return (q1, q2, q3, bend - q2 - q3, q5, q6)


def _shoulder_sign(rotation: Matrix, position: Vector3, near: Sequence[float]) -> float:
    x = position[0] - _D6 * rotation[0][2]
    y = position[1] - _D6 * rotation[1][2]
    return 1.0 if sin(near[0] - 0.5 * pi - atan2(y, x)) >= 0.0 else -1.0


def _near(angle: float, seed: float) -> float:
    return angle + tau * round((seed - angle) / tau)


def _beside(point: Vector3, direction: Vector3, along: float, up: float) -> Vector3:
    x, y, z = _mix(point, 1.0, direction, along)
    return (x, y, z + up)


def _mix(a: Vector3, s: float, b: Vector3, t: float) -> Vector3:
    return (a[0] * s + b[0] * t, a[1] * s + b[1] * t, a[2] * s + b[2] * t)
