"""Orientation to axis angles and back, one at a time, in plain floats: what a cycle needs.

The formulas are those of :mod:`orientd_dynamixel.kinematics`, which has the reasons; the tests hold
the two against each other.  Here each orientation is answered by the angles nearest to the last
commanded ones, over branches and whole turns, so a planned path comes out as it was planned.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from orientd.driver import Quaternion, Vector3
from orientd.floats import conjugate, multiply, normalize

Matrix = tuple[float, ...]
"""Nine numbers, row by row."""

_LOCK = 1e-6
_MADE = 1e-4
"""Up to this error two axes have made an orientation: between records it is off by less, rad."""
_TURN = 2 * math.pi


def matrix_of(q: Quaternion) -> Matrix:
    """Return the rotation matrix of a quaternion that need not be of quite unit norm."""
    w, x, y, z = q
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return (
        1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y),
        s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x),
        s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y),
    )  # fmt: skip


def near(angle: float, reference: float) -> float:
    """Return *angle* with as many whole turns as bring it nearest to *reference*."""
    return angle + _TURN * round((reference - angle) / _TURN)


def _split(m: Matrix, i: int, j: int, k: int) -> tuple[float, float, float]:
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    a = math.atan2(-sign * m[3 * j + k], m[3 * k + k])
    b = math.atan2(sign * m[3 * i + k], math.hypot(m[3 * j + k], m[3 * k + k]))
    c = math.atan2(-sign * m[3 * i + j], m[3 * i + i])
    return a, b, c


def _turned_back(m: Matrix, i: int, angle: float) -> Matrix:
    u, v = (i + 1) % 3, (i + 2) % 3
    cos, sin = math.cos(angle), math.sin(angle)
    turned = list(m)
    for column in range(3):
        a, b = m[3 * u + column], m[3 * v + column]
        turned[3 * u + column] = cos * a + sin * b
        turned[3 * v + column] = cos * b - sin * a
    return tuple(turned)


class AxisTracker:
    """Follow orientations with a gimbal's axes.

    Attributes:
        angles: axis angles last commanded, rad, unwrapped.
    """

    def __init__(
        self, order: str, mount: Quaternion, tool: Quaternion, *, is_pointing: bool = False
    ) -> None:
        self._axes = tuple("XYZ".index(letter) for letter in order)
        self._mount, self._tool = mount, tool
        self._mount_back, self._tool_back = conjugate(mount), conjugate(tool)
        self._is_pointing = is_pointing
        i, j = self._axes[:2]
        self._inner = self._axes[2] if len(self._axes) == 3 else 3 - i - j
        self.angles: tuple[float, ...] = (0.0,) * len(self._axes)

    def forward(self, angles: Sequence[float]) -> Quaternion:
        """Return the tool's orientation in the world."""
        q = self._mount
        for axis, angle in zip(self._axes, angles, strict=True):
            half = 0.5 * angle
            turn = [math.cos(half), 0.0, 0.0, 0.0]
            turn[1 + axis] = math.sin(half)
            q = multiply(q, (turn[0], turn[1], turn[2], turn[3]))
        return normalize(multiply(q, self._tool))

    def omega_body(self, angles: Sequence[float], rates: Sequence[float]) -> Vector3:
        """Return the tool's angular velocity in its own coordinates, rad/s."""
        # Walk from the tool to the base: each axis is seen through those inside it.
        wx = wy = wz = 0.0
        seen = self._tool_back
        for axis, angle, rate in reversed(list(zip(self._axes, angles, rates, strict=True))):
            m = matrix_of(seen)
            wx += rate * m[axis]
            wy += rate * m[3 + axis]
            wz += rate * m[6 + axis]
            half = -0.5 * angle
            turn = [math.cos(half), 0.0, 0.0, 0.0]
            turn[1 + axis] = math.sin(half)
            seen = multiply(seen, (turn[0], turn[1], turn[2], turn[3]))
        return (wx, wy, wz)

    def branches(self, q: Quaternion) -> list[tuple[float, ...]]:
        """Return the axis angles that make *q*, or its direction, rad, whole turns aside."""
        m = matrix_of(multiply(multiply(self._mount_back, q), self._tool_back))
        outer = self._outer(m)
        return [(outer + turn, *self._rest(m, outer + turn)) for turn in (0.0, math.pi)]

    def is_at_pole(self, q: Quaternion) -> bool:
        """Return whether outer and inner angle turn about one line at *q*."""
        m = matrix_of(multiply(multiply(self._mount_back, q), self._tool_back))
        i, t = self._axes[0], self._inner
        return math.hypot(m[3 * ((i + 1) % 3) + t], m[3 * ((i + 2) % 3) + t]) < _LOCK

    def outer_at_pole(self, q: Quaternion, inner: float) -> float:
        """Return the outer angle that makes *q*, at the pole, with the inner one given, rad."""
        m = matrix_of(multiply(multiply(self._mount_back, q), self._tool_back))
        return self._outer_at_pole(m, inner)

    def inner(self, q: Quaternion, outer: float) -> tuple[float, ...]:
        """Return the angles of the other axes that come nearest to *q* with the outer one given."""
        m = matrix_of(multiply(multiply(self._mount_back, q), self._tool_back))
        return self._rest(m, outer)

    def solve(self, q: Quaternion) -> tuple[tuple[float, ...], float]:
        """Return the axis angles for *q* nearest to :attr:`angles`, and the angle missed.

        Changes nothing.

        Returns:
            Angles in rad, unwrapped, and the error in rad, 0 for three axes.
        """
        m = matrix_of(multiply(multiply(self._mount_back, q), self._tool_back))
        last = self.angles
        if len(self._axes) == 2:
            i, j = self._axes
            a, missing, b = _split(m, i, 3 - i - j, j)
            # What two axes make says all of them, at the pole too.
            if not self._is_pointing or abs(missing) < _MADE:
                return (near(a, last[0]), near(b, last[1])), abs(missing)
        outer = self._outer(m)
        best: tuple[float, ...] = ()
        least = math.inf
        for turn in (0.0, math.pi):
            first = near(outer + turn, last[0])
            inner = self._rest(m, first)
            angles = (first, *(near(a, b) for a, b in zip(inner, last[1:], strict=True)))
            travel = max(abs(a - b) for a, b in zip(angles, last, strict=True))
            if travel < least:
                best, least = angles, travel
        return best, 0.0

    def _outer(self, m: Matrix) -> float:
        i, j = self._axes[:2]
        t = self._inner
        u, v = m[3 * ((i + 1) % 3) + t], m[3 * ((i + 2) % 3) + t]
        if math.hypot(u, v) < _LOCK:
            return self._outer_at_pole(m, self.angles[-1])
        return math.atan2(v, u) if j == (i + 2) % 3 else math.atan2(-u, v)

    def _outer_at_pole(self, m: Matrix, inner: float) -> float:
        if len(self._axes) == 2:
            return self.angles[0]
        i, j = self._axes[:2]
        t = self._inner
        transposed = (m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8])
        turned = _turned_back(transposed, t, -inner)
        u, v = turned[3 * j + (i + 1) % 3], turned[3 * j + (i + 2) % 3]
        return math.atan2(v, u) if j == (i + 1) % 3 else math.atan2(-u, v)

    def _rest(self, m: Matrix, outer: float) -> tuple[float, ...]:
        i, j = self._axes[:2]
        t = self._inner
        turned = _turned_back(m, i, outer)
        if len(self._axes) == 3:
            b, _, c = _split(turned, j, 3 - j - t, t)
            return b, c
        u, v = turned[3 * ((j + 1) % 3) + t], turned[3 * ((j + 2) % 3) + t]
        return (math.atan2(v, u) if t == (j + 1) % 3 else math.atan2(-u, v),)
