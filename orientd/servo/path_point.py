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
    # A call less than PathPoint(...): this happens every cycle.
    parts = (record[4:8], record[8:11], record[11:14], record[14:17], record[17:20])
    return tuple.__new__(PathPoint, parts)
