"""Lead the tool's axis around keep-out cones towards its target.

A target inside a cone is held at the nearest point of the edge.  If the direct path to the target
crosses a cone, the axis follows the edge: a great circle that touches the edge, an arc of the edge,
a great circle to the target.  Of both sides the shorter one is taken, and kept.  Everything is
computed in the frame of the tool at the last setpoint, and again every few cycles, since targets
move.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import acos, atan2, cos, inf, pi, sin, sqrt, tan, tau
from typing import NamedTuple

from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import (
    combine,
    conjugate,
    cross,
    difference,
    dot,
    multiply,
    norm,
    plus,
    rotate,
    rotate_back,
)
from orientd.servo.keep_out_cones import KeepOutCones

_TOUCHING = 1e-6
"""Angle by which a path that only touches an edge may seem to cross it, rad."""

_KEPT = 0.8
"""The side changes if the path on the other side is shorter than this share of the present one."""

_FARTHEST = 4.0 * pi
"""Length of a path that leads nowhere, rad."""

_SERVES = 0.01
"""Time for which a path serves while its end is far, s."""

_FAR = 0.1
"""Length from which on a path is long, rad."""

_OUT = 4e-4
"""Distance inside the edge from which on the axis turns straight outwards, rad."""


class Arc:
    """The cosine between an axis that turns about *u* and a direction, over the angle of the turn.

    Args:
        p: unit vector that turns.
        u: unit vector of the axis of the turn.
        d: unit vector of the direction.
    """

    __slots__ = ("k0", "k1", "k2")

    def __init__(self, p: Vector3, u: Vector3, d: Vector3) -> None:
        # Written out: a cycle near cones needs some twenty of them.
        x, y, z = p
        a, b, c = u
        e, f, g = d
        self.k0 = (a * x + b * y + c * z) * (a * e + b * f + c * g)
        self.k1 = x * e + y * f + z * g - self.k0
        self.k2 = (b * z - c * y) * e + (c * x - a * z) * f + (a * y - b * x) * g

    def at(self, angle: float) -> float:
        """Return the cosine after a turn by *angle*."""
        return self.k0 + self.k1 * cos(angle) + self.k2 * sin(angle)

    def largest(self, angle: float) -> float:
        """Return its largest value on a turn by *angle*, at most 2 pi, without the beginning."""
        top = atan2(self.k2, self.k1)
        if (top if top >= 0.0 else top + tau) < angle:
            return self.k0 + sqrt(self.k1 * self.k1 + self.k2 * self.k2)
        return self.at(angle)

    def first(self, cosine: float) -> float:
        """Return the angle at which *cosine* is reached from below; zero if it is exceeded."""
        height = sqrt(self.k1 * self.k1 + self.k2 * self.k2)
        if self.k0 + self.k1 >= cosine:
            return 0.0
        share = (cosine - self.k0) / height
        return max(atan2(self.k2, self.k1) % tau - acos(min(share, 1.0)), 0.0)


class _Circle(NamedTuple):
    """The edge of a cone: a direction in the frame of the tool, and the angle to it, rad."""

    direction: Vector3
    angle: float


class Detour:
    """Paths around the cones of a device.

    Attributes:
        held: place of the cone that keeps the tool from its target; -1 if none does.
    """

    def __init__(self, cones: KeepOutCones, period: float) -> None:
        """Create it for one :meth:`turn` per *period* seconds around *cones*."""
        self._cones = cones
        self._more = round(_SERVES / period) - 1
        self.forget()

    def forget(self) -> None:
        """Begin without a preferred side."""
        self.held = -1
        self._side = 0.0
        self._fresh = 0
        self._ahead: Vector3 | None = None

    def turn(self, q: Quaternion, target: Quaternion, reserve: float) -> Vector3 | None:
        """Return a rotation vector to aim along, rad: the length is that of the whole path.

        Args:
            q: orientation at the last setpoint.
            target: wanted orientation.
            reserve: angle from a cone at which targets are held, and along which detours lead, rad.

        Returns:
            The vector in the frame of the tool; ``None`` if the direct path is free.
        """
        if self._fresh > 0:
            self._fresh -= 1
            return None if self._ahead is None else rotate_back(q, self._ahead)
        found = self._turn(q, target, reserve)
        if norm(difference(q, target) if found is None else found) > _FAR:
            self._fresh = self._more
            self._ahead = None if found is None else rotate(q, found)
        return found

    def _turn(self, q: Quaternion, target: Quaternion, reserve: float) -> Vector3 | None:
        """Return the result of :meth:`turn` for the current orientation."""
        direct = difference(q, target)
        size = norm(direct)
        unit = plus(ZERO, direct, 1.0 / size) if size > 0.0 else (1.0, 0.0, 0.0)
        self.held = -1
        for axis in dict.fromkeys(one.axis for one in self._cones.cones):
            circles = [
                _Circle(rotate_back(q, direction), one.half_angle + reserve)
                for one, direction in zip(self._cones.cones, self._cones.directions, strict=True)
                if one.axis == axis
            ]
            wanted = rotate_back(q, rotate(target, axis))
            first = _first_on(axis, unit, size, circles)
            if first >= 0 or _inside(wanted, circles) >= 0:
                return self._around(axis, wanted, multiply(conjugate(q), target), circles)
        self._side = 0.0
        return None

    def _around(
        self,
        axis: Vector3,
        wanted: Vector3,
        relative: Quaternion,
        circles: Sequence[_Circle],
    ) -> Vector3:
        """Return the rotation vector to aim along, for cones of one *axis* of the tool.

        *wanted* is the direction for that axis and *relative* the orientation of the target, both
        in the frame of the tool.
        """
        held = _inside(wanted, circles)
        if held >= 0:
            outside = _nearest_outside(wanted, circles)
            relative = multiply(_swing(wanted, outside), relative)
            wanted = outside
        length, heading, first = self._path(axis, wanted, circles)
        self.held = held if length < inf else first
        # The rest of the turn is about the axis itself.
        w, *vector = multiply(conjugate(_swing(axis, wanted)), relative)
        x, y, z = vector
        twist = 2.0 * atan2(dot((x, y, z), axis), w)
        twist -= tau * round(twist / tau)
        if length == inf:
            length = 0.0
        return combine(cross(axis, heading), length, axis, twist)

    def _path(
        self, axis: Vector3, wanted: Vector3, circles: Sequence[_Circle]
    ) -> tuple[float, Vector3, int]:
        """Return length and unit tangent of the path to *wanted*, and the first cone on it.

        The length is infinite if there is no path.
        """
        out = _outwards(axis, circles)
        heading, distance = _towards(axis, wanted)
        first = _first_on(axis, cross(axis, heading), distance, circles)
        if first < 0:
            self._side = 0.0
            return distance, heading, -1
        sides = {side: _walk(axis, wanted, circles, side) for side in (1.0, -1.0)}
        preferred = self._side or 1.0
        if sides[-preferred][0] < (_KEPT if self._side else 1.0) * sides[preferred][0]:
            preferred = -preferred
        self._side = preferred
        length, heading = sides[preferred]
        share = min(norm(out), 1.0)
        if share > 0.0:
            heading = combine(heading, 1.0 - share, out, 1.0)
            heading = plus(ZERO, heading, 1.0 / norm(heading))
        return length, heading, first


def _towards(p: Vector3, goal: Vector3) -> tuple[Vector3, float]:
    """Return the unit tangent at *p* of the great circle to *goal*, and the angle."""
    along = dot(p, goal)
    tangent = plus(goal, p, -along)
    size = norm(tangent)
    if size < 1e-12:
        tangent = cross(p, (1.0, 0.0, 0.0) if abs(p[0]) < 0.9 else (0.0, 1.0, 0.0))
    return plus(ZERO, tangent, 1.0 / norm(tangent)), atan2(size, along)


def _outwards(p: Vector3, circles: Sequence[_Circle]) -> Vector3:
    """Return a tangent at *p* out of the circles that it is in: longer the deeper, at most 1."""
    total = ZERO
    for one in circles:
        tangent, distance = _towards(p, one.direction)
        if distance < one.angle:
            total = plus(total, tangent, -min((one.angle - distance) / _OUT, 1.0))
    return total


def _first_on(
    p: Vector3, u: Vector3, angle: float, circles: Sequence[_Circle], skip: int = -1
) -> int:
    """Return the first circle that *p* enters when it turns about *u* by *angle*; -1 if none.

    If *p* is inside of a circle already, it enters that by coming nearer to its centre.
    """
    first, place = angle, -1
    for k, one in enumerate(circles):
        reach = one.angle + angle
        if k == skip or (reach < pi and dot(p, one.direction) < cos(reach)):
            continue
        arc = Arc(p, u, one.direction)
        most = cos(one.angle - _TOUCHING)
        begin = arc.k0 + arc.k1
        if arc.largest(angle) > max(most, begin + 1e-12):
            since = 0.0 if begin >= most else arc.first(most)
            if since < first or place < 0:
                first, place = since, k
    return place


def _inside(p: Vector3, circles: Sequence[_Circle], slack: float = _TOUCHING) -> int:
    """Return the circle in which *p* is the deepest, -1 if in none."""
    deepest, place = slack, -1
    for k, one in enumerate(circles):
        if dot(p, one.direction) > cos(one.angle):
            depth = one.angle - _towards(p, one.direction)[1]
            if depth > deepest:
                deepest, place = depth, k
    return place


def _nearest_outside(p: Vector3, circles: Sequence[_Circle]) -> Vector3:
    """Return the direction nearest to *p* outside of all circles; *p* if there is none."""
    candidates = []
    for one in circles:
        tangent, distance = _towards(p, one.direction)
        if distance < one.angle:
            turn = distance - one.angle
            candidates.append(combine(p, cos(turn), tangent, sin(turn)))
    for k, one in enumerate(circles):
        for other in circles[:k]:
            candidates += _corners(one, other)
    outside = [one for one in candidates if _inside(one, circles, 1e-5) < 0]
    return max(outside, key=lambda one: dot(one, p), default=p)


def _corners(one: _Circle, other: _Circle) -> list[Vector3]:
    """Return the points where two circles meet: none or two."""
    c = dot(one.direction, other.direction)
    left = 1.0 - c * c
    if left < 1e-12:
        return []
    a = (cos(one.angle) - c * cos(other.angle)) / left
    b = (cos(other.angle) - c * cos(one.angle)) / left
    middle = combine(one.direction, a, other.direction, b)
    height = 1.0 - dot(middle, middle)
    if height <= 0.0:
        return []
    aside = plus(ZERO, cross(one.direction, other.direction), sqrt(height / left))
    return [plus(middle, aside, 1.0), plus(middle, aside, -1.0)]


def _swing(p: Vector3, goal: Vector3) -> Quaternion:
    """Return the smallest rotation that turns one unit vector into another."""
    x, y, z = cross(p, goal)
    w = 1.0 + dot(p, goal)
    size = sqrt(w * w + x * x + y * y + z * z)
    if size < 1e-9:
        x, y, z = cross(p, _towards(p, goal)[0])
        return (0.0, x, y, z)
    return (w / size, x / size, y / size, z / size)


def _walk(
    start: Vector3, goal: Vector3, circles: Sequence[_Circle], side: float
) -> tuple[float, Vector3]:
    """Return length and first tangent of the path that follows the edges on one *side*.

    Args:
        start: where the axis is.
        goal: where it shall go, outside of all circles.
        circles: the edges.
        side: 1 to turn about their centres by the right hand, -1 by the left.

    Returns:
        The length, rad, infinite if there is no path; and the unit tangent at *start*.
    """
    first: Vector3 | None = None
    here, length, on, is_on = start, 0.0, -1, False
    for _ in range(4 * len(circles) + 4):
        heading, rest = _towards(here, goal)
        blocking = _first_on(here, cross(here, heading), rest, circles)
        if blocking < 0:
            return length + rest, first or heading
        if not is_on:
            on = blocking
            # Of circles that overlap, the one whose touching great circle is free.
            for _ in circles:
                tangent, distance = _touching(here, circles[on], side)
                other = _first_on(here, cross(here, tangent), distance, circles, on)
                if other < 0:
                    break
                on = other
            if distance > _TOUCHING:
                first = first or tangent
                length += distance
                here = combine(here, cos(distance), tangent, sin(distance))
            is_on = True
            continue
        one = circles[on]
        centre = plus(ZERO, one.direction, side)
        angle = _leaving(here, goal, one, side)
        other = _first_on(here, centre, angle, circles, on)
        if other >= 0:
            met = circles[other]
            angle = Arc(here, centre, met.direction).first(cos(met.angle))
        if angle > _TOUCHING:
            along = cross(centre, here)
            radius = norm(along)
            first = first or plus(ZERO, along, 1.0 / radius)
            length += angle * radius
            here = rotated(here, centre, angle)
        on, is_on = (other, True) if other >= 0 else (-1, False)
        if length > _FARTHEST:
            break
    return inf, first or heading


def _touching(p: Vector3, one: _Circle, side: float) -> tuple[Vector3, float]:
    """Return the unit tangent at *p* of the great circle that touches a circle, and the angle.

    At the edge or inside of it, the angle is zero, and the tangent is along the edge.
    """
    tangent, distance = _towards(p, one.direction)
    aside = plus(ZERO, cross(p, tangent), -side)
    if distance <= one.angle or sin(distance) <= sin(one.angle):
        return aside, 0.0
    sine = sin(one.angle) / sin(distance)
    tangent = combine(tangent, sqrt(1.0 - sine * sine), aside, sine)
    return tangent, acos(min(cos(distance) / cos(one.angle), 1.0))


def _leaving(p: Vector3, goal: Vector3, one: _Circle, side: float) -> float:
    """Return the angle about a circle's centre from *p* to where the path to *goal* leaves it."""
    d = one.direction
    c, distance = dot(d, goal), _towards(goal, d)[1]
    azimuth = atan2(side * dot(d, cross(p, goal)), dot(p, goal) - dot(p, d) * c) % tau
    if distance <= one.angle or one.angle >= 0.5 * pi:
        return azimuth
    return max(azimuth - acos(max(min(tan(one.angle) / tan(distance), 1.0), -1.0)), 0.0)


def rotated(v: Vector3, u: Vector3, angle: float) -> Vector3:
    """Return *v* turned by *angle* about the unit vector *u*."""
    c, s = cos(angle), sin(angle)
    return plus(combine(v, c, cross(u, v), s), u, dot(u, v) * (1.0 - c))
