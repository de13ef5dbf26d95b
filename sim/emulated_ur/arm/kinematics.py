"""Forward and inverse kinematics of the emulated arms, in plain Python floats.

The inverse is the closed form of Hawkins, *Analytic Inverse Kinematics for the Universal Robots*
(2013).  Arc tangents replace the arc cosines of the wrist, because they keep their precision near a
straight wrist.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from emulated_ur.arm.transforms import Transform, multiply

if TYPE_CHECKING:
    from emulated_ur.arm.models import Model

Joints = tuple[float, ...]

TWISTS = (0.5 * math.pi, 0.0, 0.0, 0.5 * math.pi, -0.5 * math.pi, 0.0)
"""Alpha of the six joints of every model, rad."""

# Below this sine of the fifth joint the axes of the fourth and sixth are nearly the same.  Then
# only the sum of the two angles is defined, and the sixth stays.
_STRAIGHT_WRIST = 1e-7


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


class Kinematics:
    """Where the joints of a model of arm bring its flange, and back."""

    def __init__(self, model: Model) -> None:
        self._ranges = model.ranges
        # Offset along z, length along x, and the twist about x as its cosine and sine.
        self._links = tuple(
            (d, a, 0.0 if twist else 1.0, math.sin(twist))
            for d, a, twist in zip(model.d, model.a, TWISTS, strict=True)
        )
        self._d1, _, _, self._d4, self._d5, self._d6 = model.d
        self._a2, self._a3 = model.a[1:3]

    def frames(self, q: Sequence[float]) -> list[Transform]:
        """Return the six frames from the first link to the flange, in base coordinates."""
        chain: list[Transform] = []
        at: Transform | None = None
        for angle, (d, a, ca, sa) in zip(q, self._links, strict=True):
            c, s = math.cos(angle), math.sin(angle)
            link = (c, -s * ca, s * sa, a * c, s, c * ca, -c * sa, a * s, 0.0, sa, ca, d)
            at = link if at is None else multiply(at, link)
            chain.append(at)
        return chain

    def forward(self, q: Sequence[float]) -> Transform:
        """Return the flange in base coordinates for joint angles *q* (rad)."""
        return self.frames(q)[-1]

    def inverse(self, flange: Transform, near: Sequence[float]) -> Joints | None:
        """Return the joint angles that reach *flange*, nearest to *near*; rad.

        The branch of *near* comes first and is used if it is close, so that a path stays on one
        branch. Otherwise the nearest of all eight is used.

        Returns:
            Six angles within the joint range, or ``None`` if the arm does not reach it.
        """
        best: Joints | None = None
        least = math.inf
        for candidate in self._branches(flange, near):
            turned = tuple(
                _nearest_turn(*each) for each in zip(candidate, near, self._ranges, strict=True)
            )
            distance = max(abs(a - b) for a, b in zip(turned, near, strict=True))
            if distance < 0.05:
                return turned
            if distance < least:
                best, least = turned, distance
        return best

    def _branches(self, flange: Transform, near: Sequence[float]) -> Iterator[Joints]:
        """Yield the solutions, those with the signs of *near* first."""
        d4, a2, a3 = self._d4, self._a2, self._a3
        r00, r01, r02, x, r10, r11, r12, y, _, _, r22, z = flange
        wx, wy, wz = x - self._d6 * r02, y - self._d6 * r12, z - self._d6 * r22
        reach = math.hypot(wx, wy)
        if reach < d4:
            return
        toward = math.atan2(wy, wx) + 0.5 * math.pi
        opening = math.atan2(math.sqrt(reach * reach - d4 * d4), d4)
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
                # The fifth joint's axis is the negative y axis of frame 5; it leads back to 4.
                qx = wx + self._d5 * (r00 * s6 + r01 * c6)
                qy = wy + self._d5 * (r10 * s6 + r11 * c6)
                qz = wz + self._d5 * (r20 * s6 + r21 * c6)
                px, pz = c1 * qx + s1 * qy, qz - self._d1
                square = px * px + pz * pz
                cosine3 = (square - a2 * a2 - a3 * a3) / (2.0 * a2 * a3)
                if abs(cosine3) > 1.0:
                    continue
                sine3 = math.sqrt(1.0 - cosine3 * cosine3)
                sum234 = math.atan2(x4[2], c1 * x4[0] + s1 * x4[1])
                for elbow in (elbow_first, -elbow_first):
                    q3 = math.atan2(elbow * sine3, cosine3)
                    q2 = math.atan2(pz, px) - math.atan2(a3 * elbow * sine3, a2 + a3 * cosine3)
                    yield (q1, q2, q3, sum234 - q2 - q3, q5, q6)


def _nearest_turn(angle: float, seed: float, most: float) -> float:
    turned = angle + math.tau * round((seed - angle) / math.tau)
    if turned > most:
        return turned - math.tau
    if turned < -most:
        return turned + math.tau
    return turned
