"""Lead the tool's axis around keep-out cones towards its target.

A target inside a cone is held at the nearest point of the edge.  If the direct path to the target
crosses a cone, the axis follows the shortest route around; see :mod:`orientd.keep_out.tangents`.
Each axis keeps to the side on which it passes its first cone, unless the other one is much shorter.
Everything is computed in the frame of the tool at the last setpoint, and again every few cycles,
since targets move.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, inf, pi, sin, sqrt, tau

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
from orientd.keep_out.tangents import Circle, Cosine, Route, Side, shortest_route, towards
from orientd.servo.keep_out_cones import KeepOutCones

_TOUCHING = 1e-6
"""Angle by which a path that only touches an edge may seem to cross it, rad."""

_KEPT = 0.8
"""The side changes if the route on the other side is shorter than this share of the present one."""

_INSIDE = 1e-7
"""Distance of a route from an end of it that is at an edge or inside, rad."""

_SERVES = 0.01
"""Time for which a path serves while its end is far, s."""

_FAR = 0.1
"""Length from which on a path is long, rad."""

_OUT = 4e-4
"""Distance inside the edge from which on the axis turns straight outwards, rad."""


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
        self._sides: dict[Vector3, Side] = {}
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
                Circle(rotate_back(q, direction), one.half_angle + reserve)
                for one, direction in zip(self._cones.cones, self._cones.directions, strict=True)
                if one.axis == axis
            ]
            wanted = rotate_back(q, rotate(target, axis))
            first = _first_on(axis, unit, size, circles)
            if first >= 0 or _inside(wanted, circles) >= 0:
                return self._around(axis, wanted, multiply(conjugate(q), target), circles)
        self._sides.clear()
        return None

    def _around(
        self,
        axis: Vector3,
        wanted: Vector3,
        relative: Quaternion,
        circles: Sequence[Circle],
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
        self, axis: Vector3, wanted: Vector3, circles: Sequence[Circle]
    ) -> tuple[float, Vector3, int]:
        """Return length and unit tangent of the path to *wanted*, and the first cone on it.

        The length is infinite if there is no path.
        """
        out = _outwards(axis, circles)
        heading, distance = towards(axis, wanted)
        first = _first_on(axis, cross(axis, heading), distance, circles)
        if first < 0:
            self._sides.pop(axis, None)
            return distance, heading, -1
        route = self._route(axis, wanted, circles)
        if route is None:
            return inf, heading, first
        heading, share = route.heading, min(norm(out), 1.0)
        if share > 0.0:
            heading = combine(heading, 1.0 - share, out, 1.0)
            heading = plus(ZERO, heading, 1.0 / norm(heading))
        return route.length, heading, first

    def _route(self, axis: Vector3, wanted: Vector3, circles: Sequence[Circle]) -> Route | None:
        """Return the route to *wanted*, on the present side if it is not much longer there."""
        # A circle around an end of the route shrinks, so that this end is outside.
        edges = [
            Circle(one.centre, max(min(one.radius, near - _INSIDE), 0.0))
            for one in circles
            for near in [min(towards(end, one.centre)[1] for end in (axis, wanted))]
        ]
        found = shortest_route(axis, wanted, edges)
        if found is None:
            return None
        side = self._sides.pop(axis, None)
        if side is not None and side not in found.sides[:1]:
            place, sense = side
            kept = shortest_route(axis, wanted, edges, banned=[(place, -sense)])
            if kept is not None and found.length >= _KEPT * kept.length:
                found = kept
        if found.sides:
            self._sides[axis] = found.sides[0]
        return found


def _outwards(p: Vector3, circles: Sequence[Circle]) -> Vector3:
    """Return a tangent at *p* out of the circles that it is in: longer the deeper, at most 1."""
    total = ZERO
    for one in circles:
        tangent, distance = towards(p, one.centre)
        if distance < one.radius:
            total = plus(total, tangent, -min((one.radius - distance) / _OUT, 1.0))
    return total


def _first_on(p: Vector3, u: Vector3, angle: float, circles: Sequence[Circle]) -> int:
    """Return the first circle that *p* enters when it turns about *u* by *angle*; -1 if none.

    If *p* is inside of a circle already, it enters that by coming nearer to its centre.
    """
    first, place = angle, -1
    for k, one in enumerate(circles):
        reach = one.radius + angle
        if reach < pi and dot(p, one.centre) < cos(reach):
            continue
        arc = Cosine(p, u, one.centre)
        most = cos(one.radius - _TOUCHING)
        begin = arc.k0 + arc.k1
        if arc.largest(angle) > max(most, begin + 1e-12):
            since = 0.0 if begin >= most else arc.first(most)
            if since < first or place < 0:
                first, place = since, k
    return place


def _inside(p: Vector3, circles: Sequence[Circle], slack: float = _TOUCHING) -> int:
    """Return the circle in which *p* is the deepest, -1 if in none."""
    deepest, place = slack, -1
    for k, one in enumerate(circles):
        if dot(p, one.centre) > cos(one.radius):
            depth = one.radius - towards(p, one.centre)[1]
            if depth > deepest:
                deepest, place = depth, k
    return place


def _nearest_outside(p: Vector3, circles: Sequence[Circle]) -> Vector3:
    """Return the direction nearest to *p* outside of all circles; *p* if there is none."""
    candidates = []
    for one in circles:
        tangent, distance = towards(p, one.centre)
        if distance < one.radius:
            turn = distance - one.radius
            candidates.append(combine(p, cos(turn), tangent, sin(turn)))
    for k, one in enumerate(circles):
        for other in circles[:k]:
            candidates += _corners(one, other)
    outside = [one for one in candidates if _inside(one, circles, 1e-5) < 0]
    return max(outside, key=lambda one: dot(one, p), default=p)


def _corners(one: Circle, other: Circle) -> list[Vector3]:
    """Return the points where two circles meet: none or two."""
    c = dot(one.centre, other.centre)
    left = 1.0 - c * c
    if left < 1e-12:
        return []
    a = (cos(one.radius) - c * cos(other.radius)) / left
    b = (cos(other.radius) - c * cos(one.radius)) / left
    middle = combine(one.centre, a, other.centre, b)
    height = 1.0 - dot(middle, middle)
    if height <= 0.0:
        return []
    aside = plus(ZERO, cross(one.centre, other.centre), sqrt(height / left))
    return [plus(middle, aside, 1.0), plus(middle, aside, -1.0)]


def _swing(p: Vector3, goal: Vector3) -> Quaternion:
    """Return the smallest rotation that turns one unit vector into another."""
    x, y, z = cross(p, goal)
    w = 1.0 + dot(p, goal)
    size = sqrt(w * w + x * x + y * y + z * z)
    if size < 1e-9:
        x, y, z = cross(p, towards(p, goal)[0])
        return (0.0, x, y, z)
    return (w / size, x / size, y / size, z / size)
