"""Angles between two records as a cubic, in units of the period; see the rollout of a stop."""

from __future__ import annotations

from orientd.driver import Vector3

Cubic = tuple[Vector3, Vector3, Vector3, Vector3]
"""Coefficients of the powers 1, 2, 3 of *u*, and the value at ``u = 1``."""


def cubic(a: Vector3, b: Vector3, m: Vector3) -> Cubic:
    """Return what has the slopes *a* at 0 and *b* at 1, and comes to *m* there."""
    ax, ay, az = a
    bx, by, bz = b
    mx, my, mz = m
    return (
        a,
        (3.0 * mx - 2.0 * ax - bx, 3.0 * my - 2.0 * ay - by, 3.0 * mz - 2.0 * az - bz),
        (ax + bx - 2.0 * mx, ay + by - 2.0 * my, az + bz - 2.0 * mz),
        m,
    )


def between(start: Cubic, s: float, end: Cubic, u: float, gone: Vector3) -> tuple[Vector3, Vector3]:
    """Return how far it is from *s* in one cubic to *u* in another, and the slope there.

    Args:
        start: the first cubic.
        s: where in it.
        end: the second cubic.
        u: where in that.
        gone: from the beginning of the first to that of the second.
    """
    (ax, ay, az), (bx, by, bz), (cx, cy, cz), _ = end
    (px, py, pz), (qx, qy, qz), (rx, ry, rz), _ = start
    x, y, z = gone
    u2, u3 = 2.0 * u, 3.0 * u * u
    return (
        (
            ((cx * u + bx) * u + ax) * u - ((rx * s + qx) * s + px) * s + x,
            ((cy * u + by) * u + ay) * u - ((ry * s + qy) * s + py) * s + y,
            ((cz * u + bz) * u + az) * u - ((rz * s + qz) * s + pz) * s + z,
        ),
        (ax + bx * u2 + cx * u3, ay + by * u2 + cy * u3, az + bz * u2 + cz * u3),
    )
