r"""Shortest routes on the sphere around circles: tangent, arc at an edge, tangent.

Directions are unit vectors.  A great circle with the normal *n* passes a circle with the centre *c*
and the radius :math:`\rho` as a tangent if :math:`n \cdot c = \pm\sin\rho`, on its left or on its
right.  A point is a circle of radius 0.  The shortest route among circles consists of such tangents
and of arcs of the circles (Laumond, 1987, for the plane).  So the graph of all tangents that no
circle blocks holds it, and the search is exact: a gap of any width is found.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from orientd.rotation import Floats

_TOUCHING = 1e-9  # rad; a tangent touches its own circles
_PARALLEL = 1e-12  # square of the sine of the angle between two centres
_STEP = math.radians(2.0)

Side = tuple[int, int]
"""A circle by its index, and 1 with the circle on the left, -1 with it on the right."""


@dataclass(frozen=True, slots=True, eq=False)
class Circle:
    """A circle on the sphere that a route stays out of.

    Attributes:
        centre: unit vector, shape ``(3,)``.
        radius: rad, from 0 to below a quarter turn.
    """

    centre: Floats
    radius: float


@dataclass(frozen=True, slots=True, eq=False)
class _Arc:
    """A part of a route: a turn of a point about an axis.

    Attributes:
        begin: the first point.
        axis: unit vector; the turn is positive about it.
        turn: rad.
        length: on the sphere, rad.
        side: the circle that it follows; ``None`` for a tangent.
    """

    begin: Floats
    axis: Floats
    turn: float
    length: float
    side: Side | None = None

    def points(self) -> Floats:
        """Return points along the arc without its last, shape ``(n, 3)``."""
        count = max(1, math.ceil(self.length / _STEP))
        angles = self.turn * np.arange(count)[:, None] / count
        along = self.axis * float(self.axis @ self.begin)
        across = self.begin - along
        return along + np.cos(angles) * across + np.sin(angles) * np.cross(self.axis, across)


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """A route on the sphere.

    Attributes:
        points: along it, at most two degrees apart, both ends included, shape ``(n, 3)``.
        length: rad.
        sides: the circles that it follows.
    """

    points: Floats
    length: float
    sides: tuple[Side, ...]


def shortest_route(
    begin: Floats, end: Floats, circles: Sequence[Circle], banned: Collection[Side] = ()
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
    if float(begin @ end) < -1.0 + 1e-12:
        # Every great circle leads to the opposite point: the graph needs one.
        across = np.cross(begin, np.eye(3)[int(np.argmin(np.abs(begin)))])
        end = end + 1e-7 * across
        end = end / np.linalg.norm(end)
    points = [Circle(begin, 0.0), Circle(end, 0.0)]
    every = [*circles, *points]
    first, last = (len(circles), 1), (len(circles) + 1, 1)
    leaving: dict[int, list[tuple[int, _Arc]]] = {}
    places: list[tuple[Side, Floats]] = [(first, begin), (last, end)]
    for tangent, here, there in _tangents(every, banned):
        ends = []
        for side, point in (here, there):
            if side in (first, last):
                ends.append((first, last).index(side))
            else:
                ends.append(len(places))
                places.append((side, point))
        leaving.setdefault(ends[0], []).append((ends[1], tangent))
    for one, other, arc in _edges(places, circles):
        leaving.setdefault(one, []).append((other, arc))
    return _search(leaving)


def _search(leaving: dict[int, list[tuple[int, _Arc]]]) -> Route | None:
    """Return the shortest route from place 0 to place 1 (Dijkstra, 1959)."""
    best, came = {0: 0.0}, dict[int, tuple[int, _Arc]]()
    queue = [(0.0, 0)]
    while queue:
        length, here = heapq.heappop(queue)
        if here == 1:
            break
        if length > best[here]:
            continue
        for there, arc in leaving.get(here, ()):
            longer = length + arc.length
            if longer < best.get(there, math.inf):
                best[there], came[there] = longer, (here, arc)
                heapq.heappush(queue, (longer, there))
    if 1 not in came:
        return None
    arcs, place = [], 1
    while place:
        place, arc = came[place]
        arcs.append(arc)
    arcs.reverse()
    last = arcs[-1]
    end = _Arc(last.begin, last.axis, last.turn, 0.0)
    final = _turned(end.begin, end.axis, end.turn)[None]
    points = np.concatenate([*(arc.points() for arc in arcs), final])
    sides = tuple(arc.side for arc in arcs if arc.side is not None)
    return Route(points, best[1], tuple(dict.fromkeys(sides)))


def _turned(point: Floats, axis: Floats, angle: float) -> Floats:
    along = axis * float(axis @ point)
    across = point - along
    found: Floats = along + math.cos(angle) * across + math.sin(angle) * np.cross(axis, across)
    return found


Touch = tuple[Side, Floats]
"""A circle's side, and the point where a tangent touches it."""


def _tangents(
    every: Sequence[Circle], banned: Collection[Side]
) -> Iterator[tuple[_Arc, Touch, Touch]]:
    """Yield the tangents from one circle to another that no third one blocks.

    The last two of *every* are points: the first of them is only left, the second only reached.
    """
    count = len(every)
    centres = np.array([one.centre for one in every])
    radii = np.array([one.radius for one in every])
    signs = [(1, -1)] * (count - 2) + [(1,)] * 2
    for i, j in product(range(count), range(count)):
        if i == j or i == count - 1 or j == count - 2:
            continue
        a, b = centres[i], centres[j]
        cosine = float(a @ b)
        square = 1.0 - cosine * cosine
        if square < _PARALLEL:
            continue
        across = np.cross(a, b)
        for s, t in product(signs[i], signs[j]):
            if (i, s) in banned or (j, t) in banned:
                continue
            u, v = s * math.sin(radii[i]), t * math.sin(radii[j])
            x, y = (u - cosine * v) / square, (v - cosine * u) / square
            rest = 1.0 - (x * u + y * v)
            if rest < 0.0:
                continue
            for sign in (1.0, -1.0):
                normal = x * a + y * b + sign * math.sqrt(rest / square) * across
                here, there = _unit(a - u * normal), _unit(b - v * normal)
                turn = _angle_about(normal, here, there)
                if turn > math.pi + _TOUCHING:
                    continue
                others = np.array([k for k in range(count - 2) if k not in (i, j)], dtype=np.intp)
                if _is_blocked(normal, here, there, turn, centres[others], radii[others]):
                    continue
                yield _Arc(here, normal, turn, turn), ((i, s), here), ((j, t), there)


def _is_blocked(
    normal: Floats, here: Floats, there: Floats, turn: float, centres: Floats, radii: Floats
) -> bool:
    """Return whether a great arc enters a circle."""
    if not len(centres):
        return False
    inside = np.cos(np.maximum(radii - _TOUCHING, 0.0))
    if np.any(centres @ here > inside) or np.any(centres @ there > inside):
        return True
    heights = centres @ normal
    is_near = np.arcsin(np.minimum(np.abs(heights), 1.0)) < radii - _TOUCHING
    for k in np.flatnonzero(is_near):
        foot = _unit(centres[k] - heights[k] * normal)
        if _angle_about(normal, here, foot) < turn:
            return True
    return False


def _edges(
    places: Sequence[tuple[Side, Floats]], circles: Sequence[Circle]
) -> Iterator[tuple[int, int, _Arc]]:
    """Yield the arcs of circles from each place to the next one in its sense."""
    by_side: dict[Side, list[int]] = {}
    for index, (side, _) in enumerate(places[2:], 2):
        by_side.setdefault(side, []).append(index)
    for (i, sense), indices in by_side.items():
        circle = circles[i]
        axis = sense * circle.centre
        origin = places[indices[0]][1]
        angles = {one: _angle_about(axis, origin, places[one][1]) for one in indices}
        indices.sort(key=angles.__getitem__)
        gaps = list(_gaps(axis, origin, circle, [one for k, one in enumerate(circles) if k != i]))
        if None in gaps:
            continue
        for one, other in zip(indices, [*indices[1:], indices[0]], strict=True):
            turn = (angles[other] - angles[one]) % (2.0 * math.pi)
            begin = angles[one]
            if any(_meets(begin, turn, gap) for gap in gaps if gap is not None):
                continue
            length = turn * math.sin(circle.radius)
            yield one, other, _Arc(places[one][1], axis, turn, length, (i, sense))


def _gaps(
    axis: Floats, origin: Floats, circle: Circle, others: Sequence[Circle]
) -> Iterator[tuple[float, float] | None]:
    """Yield the parts of a circle inside of others: begin and width; ``None`` for all of it."""
    for other in others:
        apart = math.acos(max(-1.0, min(1.0, float(circle.centre @ other.centre))))
        if apart >= circle.radius + other.radius - _TOUCHING:
            continue
        if apart + circle.radius <= other.radius + _TOUCHING:
            yield None
            continue
        if apart + other.radius <= circle.radius:
            continue
        cosine = (math.cos(other.radius) - math.cos(circle.radius) * math.cos(apart)) / (
            math.sin(circle.radius) * math.sin(apart)
        )
        half = math.acos(max(-1.0, min(1.0, cosine)))
        middle = _angle_about(axis, origin, other.centre)
        yield middle - half, 2.0 * half


def _meets(begin: float, turn: float, gap: tuple[float, float]) -> bool:
    """Return whether an arc of a circle enters a part of it."""
    whole = 2.0 * math.pi
    return (gap[0] - begin) % whole < turn - _TOUCHING or (
        begin - gap[0] + _TOUCHING
    ) % whole < gap[1] - _TOUCHING


def _angle_about(axis: Floats, first: Floats, second: Floats) -> float:
    """Return the turn about *axis* from one direction to another, from 0 to a whole turn."""
    u = first - axis * float(axis @ first)
    v = second - axis * float(axis @ second)
    angle = math.atan2(float(axis @ np.cross(u, v)), float(u @ v))
    return angle if angle >= -_TOUCHING else angle + 2.0 * math.pi


def _unit(vector: Floats) -> Floats:
    found: Floats = vector / np.linalg.norm(vector)
    return found
