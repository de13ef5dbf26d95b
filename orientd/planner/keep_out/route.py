r"""Paths between two orientations around keep-out cones: on the sphere, then on the group.

The axis of the tool moves on the sphere, and the tool may also turn about that axis, which no cone
notices.  Along a route of the length *L* on the sphere, a twist :math:`\tau` spread evenly makes a
path of the length :math:`\sqrt{L^2 + \tau^2}`, counted from parallel transport.  The shortest path
among the cones bends the route on the sphere in addition, if that shortens the twist.  Relaxation
finds it: every point moves to the middle of its neighbours, then out of the cones.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from orientd.driver import Vector3
from orientd.keep_out.tangents import Circle, Route, shortest_route
from orientd.planner.keep_out.clearance import angles, unit
from orientd.rotation import Floats, angle, between, exp, log, multiply, rotate, slerp

POINTS = 17
"""Points of a relaxed path, both ends included."""

_SWEEPS = 40
_POLE = 1e-9
_TOUCH = math.radians(0.6)
"""Distance from an obstacle up to which a path is in contact with it, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class Obstacle:
    """A cone as the search for a route sees it.

    Attributes:
        axis: of the tool, unit vector, shape ``(3,)``.
        direction: in the world, unit vector, shape ``(3,)``.
        radius: angle to stay away, rad.
    """

    axis: Floats
    direction: Floats
    radius: float

    def depth(self, q: Floats) -> Floats:
        """Return how far inside orientations are, rad; negative outside, shape ``(n,)``."""
        found: Floats = self.radius - angles(rotate(q, self.axis), self.direction)
        return found

    def pushed(self, q: Floats, far: Floats) -> Floats:
        """Return orientations turned away from the direction by angles in rad, shape ``(n, 4)``."""
        points = rotate(q, self.axis)
        normal = np.cross(self.direction, points)
        size = np.linalg.norm(normal, axis=-1, keepdims=True)
        if np.any(size < _POLE):
            # At the direction itself every side is the same.
            spare = np.cross(self.direction, np.eye(3)[int(np.argmin(np.abs(self.direction)))])
            normal = np.where(size < _POLE, spare, normal)
            size = np.linalg.norm(normal, axis=-1, keepdims=True)
        return multiply(exp(normal / size * np.asarray(far)[..., None]), q)


def shortest_path(
    q0: Floats,
    q1: Floats,
    obstacles: Sequence[Obstacle],
    axis: Floats,
    *,
    is_roll_free: bool = False,
) -> Floats | None:
    """Return the shortest path found from one orientation to another outside of obstacles.

    Args:
        q0: the first orientation.
        q1: the last one.
        obstacles: both ends are outside of them.
        axis: of the tool, to lead around the obstacles of this axis.
        is_roll_free: whether the path may end with any turn about the axis.

    Returns:
        Shape ``(POINTS, 4)``; ``None`` if there is no route.
    """
    circles = [Circle(_vector(one.direction), one.radius) for one in obstacles if one.axis is axis]
    end = None if is_roll_free else q1
    found = (
        _relaxed(_lifted(q0, end, axis, np.array(route.points())), obstacles)
        for route in _routes(_vector(rotate(q0, axis)), _vector(rotate(q1, axis)), circles)
    )
    return min(found, key=_length, default=None)


def _routes(begin: Vector3, end: Vector3, circles: Sequence[Circle]) -> Iterator[Route]:
    """Yield the shortest route, and those that pass one of its circles on the other side."""
    first = shortest_route(begin, end, circles)
    if first is None:
        return
    yield first
    for side in first.sides:
        other = shortest_route(begin, end, circles, banned=(side,))
        if other is not None:
            yield other


def _vector(values: Floats) -> Vector3:
    x, y, z = values.tolist()
    return x, y, z


def _length(path: Floats) -> float:
    return float(np.sum(angle(path[:-1], path[1:])))


def _lifted(q0: Floats, q1: Floats | None, axis: Floats, points: Floats) -> Floats:
    """Return orientations along points on the sphere with the twist spread evenly.

    Without a last orientation *q1* there is no twist.
    """
    steps = _least_turns(points[:-1], points[1:])
    carried = [q0]
    for step in steps:
        carried.append(multiply(step, carried[-1]))
    along = np.array(carried)
    far = np.concatenate([[0.0], np.cumsum(angles(points[:-1], points[1:]))])
    share = far / far[-1] if far[-1] > 0.0 else np.linspace(0.0, 1.0, len(far))
    if q1 is None:
        return _resampled(along, along[-1])
    twist = float(log(between(along[-1], q1)) @ axis)
    return _resampled(multiply(along, exp(twist * share[:, None] * axis)), q1)


def _least_turns(a: Floats, b: Floats) -> Floats:
    half = unit(a + b)
    return np.concatenate([np.sum(a * half, axis=1)[:, None], np.cross(a, half)], axis=1)


def _resampled(path: Floats, last: Floats) -> Floats:
    """Return :data:`POINTS` orientations at equal distances along a path that ends at *last*."""
    steps = angle(path[:-1], path[1:])
    far = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.linspace(0.0, far[-1], POINTS)
    place = np.clip(np.searchsorted(far, wanted, side="right") - 1, 0, len(steps) - 1)
    share = (wanted - far[place]) / np.maximum(steps[place], 1e-12)
    found = slerp(path[place], path[place + 1], share)
    found[-1] = last if float(found[-1] @ last) >= 0.0 else -last
    return found


def _relaxed(path: Floats, obstacles: Sequence[Obstacle]) -> Floats:
    """Return a path shortened as far as obstacles permit."""
    path = _aligned(path)
    for sweep in range(_SWEEPS):
        inner = slice(1 + sweep % 2, len(path) - 1, 2)
        before = path[sweep % 2 : len(path) - 2 : 2]
        after = path[2 + sweep % 2 :: 2]
        # Over-relaxation: twice the step to the middle would oscillate.
        middle = unit(before + after)
        moved = unit(path[inner] + 1.7 * (middle - path[inner]))
        path[inner] = outside(moved, obstacles)
    return path


def outside(q: Floats, obstacles: Sequence[Obstacle]) -> Floats:
    """Return orientations moved out of obstacles by the least turns, shape ``(n, 4)``."""
    for _ in range(2 if len(obstacles) > 1 else 1):
        for one in obstacles:
            depth = one.depth(q)
            inside = depth > 0.0
            if inside.any():
                q = q.copy()
                q[inside] = one.pushed(q[inside], depth[inside])
    return q


def _aligned(path: Floats) -> Floats:
    """Return a path with continuous signs."""
    signs = np.where(np.sum(path[:-1] * path[1:], axis=1) < 0.0, -1.0, 1.0)
    found: Floats = path * np.concatenate([[1.0], np.cumprod(signs)])[:, None]
    return found


def keyframes_along(path: Floats, obstacles: Sequence[Obstacle]) -> list[Floats]:
    """Return the fewest keyframes that lead a spline along a path: in the middle of each contact.

    A path without contact has one.
    """
    is_near = np.max([one.depth(path) for one in obstacles], axis=0) > -_TOUCH
    is_near[[0, -1]] = False
    edges = np.flatnonzero(np.diff(np.concatenate([[0], is_near.astype(int), [0]])))
    found: list[Floats] = []
    for place in (0.5 * (edges[::2] + edges[1::2] - 1)).tolist():
        low = min(int(place), POINTS - 2)
        found.append(slerp(path[low], path[low + 1], place - low))
    return found or [path[POINTS // 2]]
