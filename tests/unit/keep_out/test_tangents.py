"""Shortest routes on the sphere around circles."""

import math
import random
from itertools import pairwise

import pytest

from orientd.floats import dot
from orientd.keep_out.tangents import Circle, shortest_route

X, Z = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)


def direction(chance):
    vector = [chance.gauss(0.0, 1.0) for _ in range(3)]
    return tuple(one / math.hypot(*vector) for one in vector)


def angle(one, other):
    return math.acos(max(-1.0, min(1.0, dot(one, other))))


def scene(chance):
    """Return two directions, and up to six circles that both are outside of."""
    ends = direction(chance), direction(chance)
    circles = [
        Circle(direction(chance), chance.uniform(0.05, 0.7)) for _ in range(chance.randint(1, 6))
    ]
    return *ends, [
        one for one in circles if min(angle(end, one.centre) for end in ends) > one.radius + 1e-6
    ]


def test_a_free_way_is_a_great_circle():
    route = shortest_route(X, Z, [Circle((-1.0, 0.0, 0.0), 0.5)])
    assert route.length == pytest.approx(math.pi / 2, abs=1e-15)
    assert route.heading == pytest.approx(Z)
    assert route.sides == ()


@pytest.mark.parametrize("radius", [0.01, 0.3, 1.2])
def test_around_one_circle_it_is_two_tangents_and_an_arc(radius):
    far = 1.4
    begin = (math.cos(far), math.sin(far), 0.0)
    end = (math.cos(far), -math.sin(far), 0.0)
    route = shortest_route(begin, end, [Circle(X, radius)])
    # In the right triangle of the end, the centre and the point where the tangent touches.
    tangent = math.acos(math.cos(far) / math.cos(radius))
    corner = math.acos(math.tan(radius) / math.tan(far))
    arc = math.pi - 2.0 * corner
    assert route.length == pytest.approx(2.0 * tangent + arc * math.sin(radius), abs=1e-12)
    assert len(route.arcs) == 3


def test_it_stays_outside_of_every_circle_and_is_as_long_in_both_directions():
    chance, around = random.Random(1), 0
    for _ in range(500):
        begin, end, circles = scene(chance)
        route, back = shortest_route(begin, end, circles), shortest_route(end, begin, circles)
        assert (route is None) == (back is None)
        if route is None:
            continue
        around += len(route.arcs) > 1
        points = route.points()
        assert points[0] == pytest.approx(begin, abs=1e-12)
        assert points[-1] == pytest.approx(end, abs=1e-12)
        steps = [angle(*pair) for pair in pairwise(points)]
        assert max(steps) <= math.radians(2.0) + 1e-9
        for one in circles:
            assert min(angle(point, one.centre) for point in points) >= one.radius - 1e-7
        assert back.length == pytest.approx(route.length, abs=1e-12)
    assert around > 50


def test_it_leaves_an_edge_where_another_circle_lies_on_it():
    far, radius = 1.0, 0.5
    begin = (math.cos(far), math.sin(far), 0.0)
    end = (math.cos(far), -math.sin(far), 0.0)
    edge = math.cos(radius), math.sin(radius)
    bumps = [Circle((edge[0], 0.0, side * edge[1]), 0.1) for side in (1.0, -1.0)]
    smooth = shortest_route(begin, end, [Circle(X, radius)])
    route = shortest_route(begin, end, [Circle(X, radius), *bumps])
    assert route.length > smooth.length + 0.01
    for one in bumps:
        assert min(angle(point, one.centre) for point in route.points()) >= one.radius - 1e-7


def test_a_banned_side_leads_along_the_other_one():
    chance, longer = random.Random(3), 0
    for _ in range(400):
        begin, end, circles = scene(chance)
        route = shortest_route(begin, end, circles)
        if route is None or not route.sides:
            continue
        other = shortest_route(begin, end, circles, banned=route.sides[:1])
        if other is not None:
            assert route.sides[0] not in other.sides
            assert other.length >= route.length - 1e-12
            longer += other.length > route.length
    assert longer > 20


def test_circles_that_close_a_ring_leave_no_route():
    ring = [
        Circle((math.cos(angle), math.sin(angle), 0.0), 0.5)
        for angle in (k * math.pi / 4 for k in range(8))
    ]
    assert shortest_route(Z, (0.0, 0.0, -1.0), ring) is None
    assert shortest_route(Z, (0.0, 0.0, -1.0), ring[1:]) is not None
