r"""Shortest routes on the sphere around circles: tangent, arc at an edge, tangent.

Directions are unit vectors.  A great circle with the normal *n* passes a circle with the centre *c*
and the radius :math:`\rho` as a tangent if :math:`n \cdot c = \pm\sin\rho`, on its left or on its
right.  A point is a circle of radius 0.  The shortest route among circles consists of such tangents
and of arcs of the circles (Laumond, 1987, for the plane).  So the graph of all tangents that no
circle blocks holds it, and the search is exact: a gap of any width is found.

The graph has the circles that a route has met so far.  The shortest route among these is the
shortest among all of them if it enters no other one.
"""

from __future__ import annotations

import heapq
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import count
from math import acos, atan2, ceil, cos, pi, sin, sqrt, tau
from typing import NamedTuple

from orientd.driver import ZERO, Vector3
from orientd.floats import combine, cross, dot, norm, plus

TOUCHING = 1e-9
"""Depth to which a way may enter a circle that it only touches, rad."""

_PARALLEL = 1e-12
"""Square of the sine of the angle between two centres below which they have no tangents."""

_STEP = pi / 90.0
"""Largest distance between two points of a route, rad."""

Side = tuple[int, int]
"""A circle by its index, and 1 with the circle on the left, -1 with it on the right."""


class Circle(NamedTuple):
    """A circle on the sphere that a route stays out of.

    Attributes:
        centre: unit vector.
        radius: rad, from 0 to below a quarter turn.
    """

    centre: Vector3
    radius: float


class Cosine:
    """The cosine between a direction that turns about an axis and a fixed one, over the angle.

    Args:
        p: unit vector that turns.
        u: unit vector of the axis of the turn.
        d: unit vector of the fixed direction.
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


class Arc(NamedTuple):
    """A part of a route: a turn of a point about an axis.

    Attributes:
        begin: the first point.
        axis: unit vector; the turn is positive about it.
        turn: rad.
        side: the circle that it follows; ``None`` for a tangent.
    """

    begin: Vector3
    axis: Vector3
    turn: float
    side: Side | None = None

    @property
    def length(self) -> float:
        """Length on the sphere, rad."""
        return self.turn if self.side is None else self.turn * norm(cross(self.axis, self.begin))

    def at(self, angle: float) -> Vector3:
        """Return the point after a turn by *angle*."""
        return rotated(self.begin, self.axis, angle)

    def enters(self, circle: Circle) -> bool:
        """Return whether it enters a circle behind its first point."""
        cosine = Cosine(self.begin, self.axis, circle.centre)
        return cosine.largest(self.turn) > cos(max(circle.radius - TOUCHING, 0.0))


class Route(NamedTuple):
    """A route on the sphere.

    Attributes:
        arcs: one after the other.
        length: rad.
    """

    arcs: tuple[Arc, ...]
    length: float

    @property
    def sides(self) -> tuple[Side, ...]:
        """The circles that it follows, in their order."""
        return tuple(dict.fromkeys(one.side for one in self.arcs if one.side is not None))

    @property
    def heading(self) -> Vector3:
        """The unit tangent at its first point; zero without a length."""
        for one in self.arcs:
            if one.turn > TOUCHING:
                along = cross(one.axis, one.begin)
                return plus(ZERO, along, 1.0 / norm(along))
        return ZERO

    def points(self) -> list[Vector3]:
        """Return points along it, at most two degrees apart, both ends included."""
        found = []
        for one in self.arcs:
            steps = max(1, ceil(one.length / _STEP))
            found += [one.at(one.turn * step / steps) for step in range(steps)]
        last = self.arcs[-1]
        return [*found, last.at(last.turn)]


def towards(p: Vector3, goal: Vector3) -> tuple[Vector3, float]:
    """Return the unit tangent at *p* of the great circle to *goal*, and the angle."""
    along = dot(p, goal)
    tangent = plus(goal, p, -along)
    size = norm(tangent)
    if size < 1e-12:
        tangent = cross(p, (1.0, 0.0, 0.0) if abs(p[0]) < 0.9 else (0.0, 1.0, 0.0))
    return plus(ZERO, tangent, 1.0 / norm(tangent)), atan2(size, along)


def rotated(v: Vector3, u: Vector3, angle: float) -> Vector3:
    """Return *v* turned by *angle* about the unit vector *u*."""
    c, s = cos(angle), sin(angle)
    return plus(combine(v, c, cross(u, v), s), u, dot(u, v) * (1.0 - c))


def shortest_route(
    begin: Vector3, end: Vector3, circles: Sequence[Circle], banned: Collection[Side] = ()
) -> Route | None:
    """Return the shortest route between two directions outside of circles.

    Args:
        begin: the first direction, outside of all circles.
        end: the last direction, outside of all circles.
        circles: to stay out of.
        banned: sides on which not to pass a circle.

    Returns:
        ``None`` if there is no route.
    """
    heading, distance = towards(begin, end)
    found: Route | None = Route((Arc(begin, cross(begin, heading), distance),), distance)
    graph = _Graph(begin, end, circles, banned)
    while found is not None:
        entered = [one for one in range(len(circles)) if graph.is_entered(found, one)]
        if not entered:
            return found
        graph.met += entered
        found = graph.shortest()
    return None


@dataclass(slots=True)
class _Graph:
    """The tangents between two directions and the circles that routes have met.

    Attributes:
        begin: the first direction.
        end: the last direction.
        circles: all of them.
        banned: sides on which not to pass a circle.
        met: indices of the circles that count.
    """

    begin: Vector3
    end: Vector3
    circles: Sequence[Circle]
    banned: Collection[Side]
    met: list[int] = field(default_factory=list)

    def is_entered(self, route: Route, index: int) -> bool:
        """Return whether a route enters a circle that it has not met."""
        return index not in self.met and any(one.enters(self.circles[index]) for one in route.arcs)

    def shortest(self) -> Route | None:
        """Return the shortest route around the circles met (Hart, Nilsson and Raphael, 1968)."""
        tangents: dict[Side | None, list[tuple[Arc, Side | None]]] = {}
        order, reached = count(), set[Arc]()
        queue: list[tuple[float, int, Route, Vector3, Side | None]] = [
            (0.0, next(order), Route((), 0.0), self.begin, None)
        ]
        while queue:
            _, _, route, here, side = heapq.heappop(queue)
            if route.arcs:
                if side is None:
                    return route
                if route.arcs[-1] in reached:
                    continue
                reached.add(route.arcs[-1])
            if side not in tangents:
                tangents[side] = list(self._tangents(side))
            for tangent, there in tangents[side]:
                if tangent in reached:
                    continue
                arcs: tuple[Arc, ...] = (tangent,)
                if side is not None:
                    axis = plus(ZERO, self.circles[side[0]].centre, side[1])
                    arc = Arc(here, axis, _turn(axis, here, tangent.begin), side)
                    if self._is_blocked(arc, side[:1]):
                        continue
                    arcs = arc, tangent
                length = route.length + sum(one.length for one in arcs)
                place = tangent.at(tangent.turn)
                longer = Route((*route.arcs, *arcs), length)
                least = length + towards(place, self.end)[1]
                heapq.heappush(queue, (least, next(order), longer, place, there))
        return None

    def _is_blocked(self, arc: Arc, but: Collection[int]) -> bool:
        """Return whether an arc enters one of the circles met, *but* for some."""
        return any(one not in but and arc.enters(self.circles[one]) for one in self.met)

    def _tangents(self, side: Side | None) -> Iterator[tuple[Arc, Side | None]]:
        """Yield the free tangents that leave a side, or the first direction, and where to."""
        index, sense = side or (-1, 1)
        here = Circle(self.begin, 0.0) if side is None else self.circles[index]
        ends: list[tuple[Circle, Side | None]] = [
            (self.circles[one], (one, s))
            for one in self.met
            for s in (1, -1)
            if one != index and (one, s) not in self.banned
        ]
        if side is not None:
            ends.append((Circle(self.end, 0.0), None))
        for there, other in ends:
            own = () if other is None else other[:1]
            for tangent in _common(here, sense, there, 1 if other is None else other[1]):
                if not self._is_blocked(tangent, (index, *own)):
                    yield tangent, other


def _common(here: Circle, s: int, there: Circle, t: int) -> Iterator[Arc]:
    """Yield the tangents from one circle to another, with these on their sides."""
    a, b = here.centre, there.centre
    cosine = dot(a, b)
    square = 1.0 - cosine * cosine
    if square < _PARALLEL:
        return
    u, v = s * sin(here.radius), t * sin(there.radius)
    x, y = (u - cosine * v) / square, (v - cosine * u) / square
    rest = 1.0 - (x * u + y * v)
    if rest < 0.0:
        return
    across = cross(a, b)
    for height in (sqrt(rest / square), -sqrt(rest / square)):
        normal = plus(combine(a, x, b, y), across, height)
        begin, end = plus(a, normal, -u), plus(b, normal, -v)
        begin = plus(ZERO, begin, 1.0 / norm(begin))
        turn = _turn(normal, begin, end)
        if turn <= pi + TOUCHING:
            yield Arc(begin, normal, turn)


def _turn(axis: Vector3, first: Vector3, second: Vector3) -> float:
    """Return the turn about *axis* from one direction to another, from 0 to a whole turn."""
    along = dot(first, second) - dot(axis, first) * dot(axis, second)
    angle = atan2(dot(axis, cross(first, second)), along)
    return max(angle, 0.0) if angle >= -TOUCHING else angle + tau
