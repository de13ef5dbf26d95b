r"""Gimbals: axis angles to orientation and back, both branches, for floats and for arrays.

A gimbal turns about two or three of the coordinate axes, named from the base to the tool by capital
letters: ``ZYX`` is yaw, pitch, roll.  Its rotation matrix is :math:`R = R_i(a) R_j(b) R_k(c)`.  A
two-axis gimbal points the axis that it cannot turn about.

The formulas rest on one observation.  Let :math:`d = R e_t` be the direction of the innermost
axis, or of the pointing axis of a two-axis gimbal.  For a given outer angle *a*, the best *b* and
*c* leave exactly the error :math:`\arcsin |e_j \cdot R_i(-a) d|`.  This error is the middle angle
of :math:`R_i(-a) R` decomposed in the order *j*, missing axis, *t*.  So the outer angle alone
determines the error.  Its exact values lie half a turn apart: those are the two branches.

The formulas work component by component, so a component may be a float or an array of floats.  The
servo loads this module, so it has no NumPy.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

from orientd.driver import IDENTITY, ZERO, AxisLimits, Joints, Quaternion, Vector3
from orientd.floats import conjugate, multiply, normalize
from orientd.mechanism.mechanism import Mechanism

Number = Any
"""A float, or an array of floats."""
Components = Any
"""An ordered sequence of numbers: a tuple, or an array along its first axis."""
Matrix = Components
"""The nine components of a rotation matrix, row by row."""

LOCK = 1e-6
"""Sine of the distance from the pole below which outer and inner axis are parallel."""
_MADE = 1e-4
"""Largest error, rad, at which two axes make an orientation; between records it is smaller."""
_TURN = 2.0 * math.pi

_OUTERMOST, _GAP = 0.15, 0.03
"""Radius of the outer ends of the pins and distance between rings, m, for drawing only."""
_CORNERS = 24


class Functions(NamedTuple):
    """The functions of the formulas, for floats or for arrays."""

    sin: Callable[[Number], Number]
    cos: Callable[[Number], Number]
    atan2: Callable[[Number, Number], Number]
    hypot: Callable[[Number, Number], Number]


OF_FLOATS = Functions(math.sin, math.cos, math.atan2, math.hypot)


def near(angle: float, reference: float) -> float:
    """Return *angle* plus the whole turns that bring it nearest to *reference*."""
    return angle + _TURN * round((reference - angle) / _TURN)


@dataclass(frozen=True)
class Kinematics:
    """The kinematics of a gimbal.

    Attributes:
        order: the axes from base to tool, for example ``ZYX``, ``ZXY`` or ``ZY``.
        mount: orientation ``(w, x, y, z)`` of the base in the world.
        tool: orientation of the tool on the innermost axis.
        functions: for floats or for arrays.

    Raises:
        ValueError: *order* is not a valid order of axes.
    """

    order: str = "ZYX"
    mount: Quaternion = IDENTITY
    tool: Quaternion = IDENTITY
    functions: Functions = OF_FLOATS

    def __post_init__(self) -> None:
        letters = self.order
        if len(letters) not in {2, 3} or any(letter not in "XYZ" for letter in letters):
            raise ValueError(f"order must be two or three of X, Y and Z, got {letters!r}")
        if any(a == b for a, b in pairwise(letters)):
            raise ValueError(f"order must not name an axis twice in a row, got {letters!r}")

    @property
    def axes(self) -> tuple[int, ...]:
        """The axes as numbers, 0 is X."""
        return tuple("XYZ".index(letter) for letter in self.order)

    @property
    def inner_axis(self) -> int:
        """The innermost of three axes, or the pointing axis of a two-axis gimbal."""
        axes = self.axes
        return axes[2] if len(axes) == 3 else 3 - axes[0] - axes[1]

    def orientation(self, joints: Components) -> tuple[Number, Number, Number, Number]:
        """Return the tool's orientation in the world for axis angles in rad."""
        q = self.mount
        for axis, angle in zip(self.axes, joints, strict=True):
            q = self._turned_about(q, axis, angle)
        return multiply(q, self.tool)

    def omega_body(self, joints: Components, rates: Components) -> tuple[Number, Number, Number]:
        """Return the tool's angular velocity in its own coordinates, rad/s."""
        # From the tool to the base: each axis is rotated by those inside it.
        wx = wy = wz = 0.0
        seen = conjugate(self.tool)
        for axis, angle, rate in reversed(list(zip(self.axes, joints, rates, strict=True))):
            m = matrix_of(seen)
            wx, wy, wz = wx + rate * m[axis], wy + rate * m[3 + axis], wz + rate * m[6 + axis]
            seen = self._turned_about(seen, axis, -angle)
        return wx, wy, wz

    def matrix(self, q: Components) -> Matrix:
        """Return the rotation that the axes alone must make for an orientation, as a matrix."""
        w, x, y, z = q
        back = multiply(conjugate(self.mount), (w, x, y, z))
        return matrix_of(multiply(back, conjugate(self.tool)))

    def pointing(self, m: Matrix) -> tuple[Number, Number]:
        """Return an exact outer angle, and the sine of the distance from the pole.

        The angle, in rad, is arbitrary at the pole.  Adding half turns keeps it exact.
        """
        i, j = self.axes[:2]
        t = self.inner_axis
        u, v = m[3 * ((i + 1) % 3) + t], m[3 * ((i + 2) % 3) + t]
        f = self.functions
        outer = f.atan2(v, u) if j == (i + 2) % 3 else f.atan2(-u, v)
        return outer, f.hypot(u, v)

    def inner(self, m: Matrix, outer: Number) -> tuple[tuple[Number, ...], Number]:
        """Return the best inner angles for a given outer one, and the remaining error, rad."""
        i, j = self.axes[:2]
        t, f = self.inner_axis, self.functions
        turned = self._turned_back(m, i, outer)
        if len(self.axes) == 3:
            b, missing, c = self.split(turned, j, 3 - j - t, t)
            return (b, c), abs(missing)
        u, v = turned[3 * ((j + 1) % 3) + t], turned[3 * ((j + 2) % 3) + t]
        b = f.atan2(v, u) if t == (j + 1) % 3 else f.atan2(-u, v)
        return (b,), f.atan2(abs(turned[3 * j + t]), f.hypot(u, v))

    def outer_at_pole(self, m: Matrix, inner: Number) -> Number:
        """Return the outer angle for an orientation at the pole with a given inner angle.

        For three axes only: two axes point to the pole with any outer angle.
        """
        i, j = self.axes[:2]
        f = self.functions
        # R R_k(-c) = R_i(a) R_j(b): if b keeps e_j fixed, its image gives a.
        transposed = (m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8])
        turned = self._turned_back(transposed, self.inner_axis, -inner)
        u, v = turned[3 * j + (i + 1) % 3], turned[3 * j + (i + 2) % 3]
        return f.atan2(v, u) if j == (i + 1) % 3 else f.atan2(-u, v)

    def manipulability(self, joints: Components) -> Number:
        r"""Return the least singular value of the map from axis rates; 0 is the pole.

        For three axes the map is the Jacobian, for two the part that moves the pointing axis.
        Neighbouring axes are at right angles.  So only the cosine *c* between the outermost and the
        innermost (or pointing) axis matters.  The squared singular values of the Jacobian are
        :math:`1 \pm c` and 1, those of the part are 1 and :math:`1 - c^2`.
        """
        sine, cosine = self.functions.cos(joints[1]), self.functions.sin(joints[1])
        if self.inner_axis == self.axes[0]:
            sine, cosine = cosine, sine
        return abs(sine) if len(self.axes) == 2 else abs(sine) / (1.0 + abs(cosine)) ** 0.5

    def split(self, m: Matrix, i: int, j: int, k: int) -> tuple[Number, Number, Number]:
        """Return the angles of ``R_i(a) R_j(b) R_k(c)``, three different axes, |b| <= 90 deg."""
        f, sign = self.functions, 1.0 if (j - i) % 3 == 1 else -1.0
        a = f.atan2(-sign * m[3 * j + k], m[3 * k + k])
        b = f.atan2(sign * m[3 * i + k], f.hypot(m[3 * j + k], m[3 * k + k]))
        c = f.atan2(-sign * m[3 * i + j], m[3 * i + i])
        return a, b, c

    def _turned_back(self, m: Matrix, i: int, angle: Number) -> Matrix:
        """Return the components of ``R_i(-angle) m``."""
        u, v = 3 * ((i + 1) % 3), 3 * ((i + 2) % 3)
        cos, sin = self.functions.cos(angle), self.functions.sin(angle)
        turned = list(m)
        for column in range(3):
            a, b = m[u + column], m[v + column]
            turned[u + column] = cos * a + sin * b
            turned[v + column] = cos * b - sin * a
        return turned

    def _turned_about(self, q: Quaternion, axis: int, angle: Number) -> Quaternion:
        """Return *q* followed by a turn by *angle* about a coordinate axis of its body."""
        i, j, k = axis + 1, (axis + 1) % 3 + 1, (axis + 2) % 3 + 1
        cos, sin = self.functions.cos(0.5 * angle), self.functions.sin(0.5 * angle)
        turned = [cos * q[0] - sin * q[i]] * 4
        turned[i] = cos * q[i] + sin * q[0]
        turned[j] = cos * q[j] + sin * q[k]
        turned[k] = cos * q[k] - sin * q[j]
        return (turned[0], turned[1], turned[2], turned[3])


def matrix_of(q: Quaternion) -> Matrix:
    """Return the rotation matrix of a quaternion of nearly unit norm."""
    w, x, y, z = q
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return (
        1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y),
        s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x),
        s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y),
    )  # fmt: skip


class Gimbal(Mechanism):
    """A gimbal of two or three axes, with limits.

    The planner chooses branches and turns over the whole path, passes the pole, and stops to slew
    if that is allowed.  The driver takes joints, because an orientation at the pole does not define
    them.

    Attributes:
        axes: limits of every axis, from the base to the tool.
        kinematics: kinematics of the axes, for floats.
        is_pointing: for two axes, whether only the direction of the pointing axis counts.
        roll_tolerance: largest error of whole orientations with two axes, rad.
        max_deviation: largest deviation from the path near a pole, rad.
        allow_slews: whether a path may stop while the axes change branch or unwind.  A path at
            times of the user does not stop; the axes leave it, slew, and rejoin it.
        on_target: error up to which a path counts as followed, rad.
    """

    def __init__(
        self,
        axes: Sequence[AxisLimits],
        *,
        order: str = "ZYX",
        mount: Quaternion = IDENTITY,
        tool: Quaternion = IDENTITY,
        is_pointing: bool = False,
        roll_tolerance: float = math.inf,
        max_deviation: float = 0.0,
        allow_slews: bool = False,
        on_target: float = math.radians(0.5),
    ) -> None:
        """Create a gimbal from the geometry of its axes.

        Args:
            axes: limits of every axis, from the base to the tool.
            order: the axes from base to tool.
            mount: orientation of the base in the world.
            tool: orientation of the tool on the innermost axis.
            is_pointing: see the attributes.
            roll_tolerance: see the attributes.
            max_deviation: see the attributes.
            allow_slews: see the attributes.
            on_target: see the attributes.

        Raises:
            ValueError: *order* is not a valid order of axes, or does not fit *axes*.
        """
        self.kinematics = Kinematics(order, normalize(mount), normalize(tool))
        if len(axes) != len(order):
            raise ValueError(f"axes must be {len(order)}, got {len(axes)}")
        self.axes = tuple(axes)
        self.is_pointing = is_pointing
        self.roll_tolerance = roll_tolerance
        self.max_deviation = max_deviation
        self.allow_slews = allow_slews
        self.on_target = on_target

    @property
    def is_fitting(self) -> bool:
        """Whether two axes must make whole orientations, which have three degrees of freedom."""
        return len(self.axes) == 2 and not self.is_pointing

    def forward(self, joints: Joints) -> tuple[Quaternion, Vector3]:
        """Return the orientation for axis angles in rad, and the origin."""
        return self.orientation(joints), ZERO

    def orientation(self, joints: Joints) -> Quaternion:
        """Return the tool's orientation in the world for axis angles in rad."""
        return normalize(self.kinematics.orientation(joints))

    def solutions(self, q: Quaternion, position: Vector3 = ZERO) -> list[Joints]:  # noqa: ARG002 - a gimbal only turns its tool
        """Return the axis angles of both branches, with an inner angle of 0 at the pole."""
        return self.branches(q, (0.0,) * len(self.axes))

    def branches(self, q: Quaternion, last: Joints) -> list[Joints]:
        """Return the axis angles for *q*, or for its direction, rad, without whole turns.

        Args:
            q: tool orientation.
            last: axis angles that decide at the pole: a three-axis gimbal keeps its innermost
                angle, a two-axis gimbal its outer angle.
        """
        m = self.kinematics.matrix(q)
        outer = self._outer(m, last)
        return [
            (outer + turn, *self.kinematics.inner(m, outer + turn)[0]) for turn in (0.0, math.pi)
        ]

    def nearest(self, q: Quaternion, position: Vector3, near: Joints) -> Joints:  # noqa: ARG002 - a gimbal only turns its tool
        """Return the best axis angles for *q*, nearest to *near*, rad, unwrapped."""
        return self.solve(q, near)[0]

    def completed(self, q: Quaternion, position: Vector3, outer: float, wanted: Joints) -> Joints:  # noqa: ARG002 - a gimbal only turns its tool
        """Return the best axis angles for *q*, or for its direction, with a given outer angle."""
        if self.is_fitting:
            return wanted
        return (outer, *self.kinematics.inner(self.kinematics.matrix(q), outer)[0])

    def solve(self, q: Quaternion, last: Joints) -> tuple[Joints, float]:
        """Return the axis angles for *q* nearest to *last*, and the remaining error.

        Returns:
            Angles in rad, unwrapped, and the error in rad, 0 for three axes.
        """
        if len(self.axes) == 2:
            i, j = self.kinematics.axes
            a, missing, b = self.kinematics.split(self.kinematics.matrix(q), i, 3 - i - j, j)
            # The orientation of two axes determines both, even at the pole.
            if not self.is_pointing or abs(missing) < _MADE:
                return (near(a, last[0]), near(b, last[1])), abs(missing)
        turned = [tuple(map(near, one, last)) for one in self.branches(q, last)]
        return min(turned, key=lambda one: _farthest(one, last)), 0.0

    def is_at_pole(self, q: Quaternion) -> bool:
        """Return whether outer and inner axis are parallel at *q*."""
        return bool(self.kinematics.pointing(self.kinematics.matrix(q))[1] < LOCK)

    def home(self) -> Joints:
        """Return zero for every axis, or the angle nearest to it within the limits, rad."""
        return tuple(min(max(0.0, axis.low), axis.high) for axis in self.axes)

    def outline(self, joints: Joints) -> list[list[Vector3]]:
        """Return two pins and a ring for each axis, from the base inwards, for drawing.

        Each ring carries the pins of the next axis, and lies in the plane of its own axis and the
        next one.  The innermost ring lies in the plane of its own axis and the tool's pointing
        axis.

        Args:
            joints: axis angles, rad.

        Returns:
            Lines about the origin, m; empty if *joints* do not fit the gimbal.
        """
        numbers = self.kinematics.axes
        if len(joints) != len(numbers):
            return []
        lines: list[list[Vector3]] = []
        for place, axis in enumerate(numbers):
            # Rotated by the axes so far.
            turned = (*joints[: place + 1], *(0.0,) * (len(numbers) - place - 1))
            bare = Kinematics(self.kinematics.order, self.kinematics.mount)
            m = matrix_of(bare.orientation(turned))
            inner = numbers[place + 1] if place + 1 < len(numbers) else (axis + 1) % 3
            own, other = m[axis::3], m[inner::3]
            outside = _OUTERMOST - place * _GAP
            radius = outside - _GAP
            around = [_TURN * corner / _CORNERS for corner in range(_CORNERS + 1)]
            lines += [
                [_at(own, outside, other, 0.0), _at(own, radius, other, 0.0)],
                [_at(own, -outside, other, 0.0), _at(own, -radius, other, 0.0)],
                [_at(own, radius * math.cos(a), other, radius * math.sin(a)) for a in around],
            ]
        return lines

    def _outer(self, m: Matrix, last: Joints) -> float:
        outer, sine = self.kinematics.pointing(m)
        if sine < LOCK:
            is_two = len(self.axes) == 2
            outer = last[0] if is_two else self.kinematics.outer_at_pole(m, last[-1])
        return float(outer)


def _farthest(one: Joints, other: Joints) -> float:
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def _at(own: Sequence[float], along: float, other: Sequence[float], aside: float) -> Vector3:
    x, y, z = (along * a + aside * b for a, b in zip(own, other, strict=True))
    return x, y, z
