"""A point of the path, as a record of the path ring describes it."""

from __future__ import annotations

from typing import Any, NamedTuple

from orientd.driver import Quaternion, Vector3


class PathPoint(NamedTuple):
    """A point of the path with its derivatives by path time.

    Attributes:
        q: orientation ``(w, x, y, z)``.
        omega_body: angular velocity, rad/s.
        alpha_body: angular acceleration, rad/s^2.
        position: m.
        velocity: m/s.
    """

    q: Quaternion
    omega_body: Vector3
    alpha_body: Vector3
    position: Vector3
    velocity: Vector3


def point_of(record: tuple[Any, ...]) -> PathPoint:
    """Return the point that a path record (its fields, in order) describes."""
    # Neither slices nor a call of PathPoint(): this happens every cycle.
    _, w, x, y, z, a, b, c, d, e, f, p, q, r, s, t, u = record
    parts = (w, x, y, z), (a, b, c), (d, e, f), (p, q, r), (s, t, u)
    return tuple.__new__(PathPoint, parts)
