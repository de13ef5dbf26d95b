"""Forward and inverse kinematics of the UR5e, in plain Python floats.

Denavit-Hartenberg parameters as Universal Robots publishes them ("DH Parameters for calculations
of kinematics and dynamics", UR5e).  The inverse is the closed form of Hawkins, *Analytic Inverse
Kinematics for the Universal Robots* (2013), with the arc cosines of the wrist replaced by arc
tangents, which keep their precision where the wrist is nearly straight.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from orientd_sim.ur.transforms import Transform, multiply

Joints = tuple[float, ...]

D1, A2, A3, D4, D5, D6 = 0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996

# Offset along z, length along x, and the twist about x as its cosine and sine.
_LINKS = (
    (D1, 0.0, 0.0, 1.0),
    (0.0, A2, 1.0, 0.0),
    (0.0, A3, 1.0, 0.0),
    (D4, 0.0, 0.0, 1.0),
    (D5, 0.0, 0.0, -1.0),
    (D6, 0.0, 1.0, 0.0),
)

JOINT_RANGE = 2.0 * math.pi
"""Every joint turns this far either way, rad."""

JOINT_SPEED = math.pi
"""Every joint turns at most this fast, rad/s (180 degrees a second)."""

# Below this sine of the fifth joint the axes of the fourth and sixth coincide for all that
# matters: only the sum of the two angles is defined, and the sixth keeps its place.
_STRAIGHT_WRIST = 1e-7


def frames(q: Sequence[float]) -> list[Transform]:
    """Return the six frames from the first link to the flange, in base coordinates."""
    chain: list[Transform] = []
    at: Transform | None = None
    for angle, (d, a, ca, sa) in zip(q, _LINKS, strict=True):
        c, s = math.cos(angle), math.sin(angle)
        link = (c, -s * ca, s * sa, a * c, s, c * ca, -c * sa, a * s, 0.0, sa, ca, d)
        at = link if at is None else multiply(at, link)
        chain.append(at)
    return chain


def forward(q: Sequence[float]) -> Transform:
    """Return the flange in base coordinates for joint angles *q* (rad)."""
    return frames(q)[-1]


def speed(
    chain: Sequence[Transform], qd: Sequence[float], point: Sequence[float]
) -> tuple[float, ...]:
    """Return the velocity of *point* and the angular velocity of the flange, base coordinates.

    Args:
        chain: the frames of :func:`frames`.
        qd: joint speeds, rad/s.
        point: base coordinates of the point that the flange carries, m.

    Returns:
        Six numbers: m/s, then rad/s.
    """
    vx = vy = vz = wx = wy = wz = 0.0
    px, py, pz = point
    zx, zy, zz = 0.0, 0.0, 1.0
    ox, oy, oz = 0.0, 0.0, 0.0
    for frame, rate in zip(chain, qd, strict=True):
        ax, ay, az = zx * rate, zy * rate, zz * rate
        rx, ry, rz = px - ox, py - oy, pz - oz
        vx += ay * rz - az * ry
        vy += az * rx - ax * rz
        vz += ax * ry - ay * rx
        wx += ax
        wy += ay
        wz += az
        zx, zy, zz = frame[2], frame[6], frame[10]
        ox, oy, oz = frame[3], frame[7], frame[11]
    return (vx, vy, vz, wx, wy, wz)


def inverse(flange: Transform, near: Sequence[float]) -> Joints | None:
    """Return the joint angles that reach *flange*, those nearest to *near*; rad.

    The branch *near* lies on is tried first and taken when it is close, so that a path is followed
    on one branch; otherwise the nearest of all eight is taken.

    Returns:
        Six angles within the joint range, or ``None`` where the arm does not reach.
    """
    best: Joints | None = None
    least = math.inf
    for candidate in _branches(flange, near):
        turned = tuple(
            _nearest_turn(angle, seed) for angle, seed in zip(candidate, near, strict=True)
        )
        distance = max(abs(a - b) for a, b in zip(turned, near, strict=True))
        if distance < 0.05:
            return turned
        if distance < least:
            best, least = turned, distance
    return best


def _nearest_turn(angle: float, seed: float) -> float:
    turned = angle + math.tau * round((seed - angle) / math.tau)
    if turned > JOINT_RANGE:
        return turned - math.tau
    if turned < -JOINT_RANGE:
        return turned + math.tau
    return turned


def _branches(flange: Transform, near: Sequence[float]) -> Iterator[Joints]:
    """Yield the solutions, those with the signs of *near* first."""
    r00, r01, r02, x, r10, r11, r12, y, _, _, r22, z = flange
    wx, wy, wz = x - D6 * r02, y - D6 * r12, z - D6 * r22
    reach = math.hypot(wx, wy)
    if reach < D4:
        return
    toward = math.atan2(wy, wx) + 0.5 * math.pi
    opening = math.atan2(math.sqrt(reach * reach - D4 * D4), D4)
    shoulders = sorted(
        (toward + opening, toward - opening), key=lambda angle: -math.cos(angle - near[0])
    )
    wrist_first = 1.0 if math.sin(near[4]) >= 0.0 else -1.0
    elbow_first = 1.0 if math.sin(near[2]) >= 0.0 else -1.0
    for q1 in shoulders:
        c1, s1 = math.cos(q1), math.sin(q1)
        along, across = r00 * s1 - r10 * c1, r01 * s1 - r11 * c1
        straightness = math.hypot(along, across)
        cosine5 = r02 * s1 - r12 * c1
        for wrist in (wrist_first, -wrist_first):
            q5 = math.atan2(wrist * straightness, cosine5)
            is_straight = straightness < _STRAIGHT_WRIST
            q6 = near[5] if is_straight else math.atan2(-across * wrist, along * wrist)
            # The frame of the fourth joint in the frame of the first.
            c5, s5, c6, s6 = math.cos(q5), math.sin(q5), math.cos(q6), math.sin(q6)
            # x axis of frame 4 = R06 (R46)^T x, with R46 = R45 R56.
            ax, ay, az = c5 * c6, -c5 * s6, -s5
            r20, r21 = flange[8], flange[9]
            x4 = (
                r00 * ax + r01 * ay + r02 * az,
                r10 * ax + r11 * ay + r12 * az,
                r20 * ax + r21 * ay + r22 * az,
            )
            # The fifth joint's axis is the negative y axis of frame 5; its length leads back to 4.
            qx = wx + D5 * (r00 * s6 + r01 * c6)
            qy = wy + D5 * (r10 * s6 + r11 * c6)
            qz = wz + D5 * (r20 * s6 + r21 * c6)
            px, pz = c1 * qx + s1 * qy, qz - D1
            square = px * px + pz * pz
            cosine3 = (square - A2 * A2 - A3 * A3) / (2.0 * A2 * A3)
            if abs(cosine3) > 1.0:
                continue
            sine3 = math.sqrt(1.0 - cosine3 * cosine3)
            sum234 = math.atan2(x4[2], c1 * x4[0] + s1 * x4[1])
            for elbow in (elbow_first, -elbow_first):
                q3 = math.atan2(elbow * sine3, cosine3)
                q2 = math.atan2(pz, px) - math.atan2(A3 * elbow * sine3, A2 + A3 * cosine3)
                yield (q1, q2, q3, sum234 - q2 - q3, q5, q6)
