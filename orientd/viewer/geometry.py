"""Lines and meshes of the scene, as arrays: traces of the axes' tips, dashes, arrows, tubes."""

from __future__ import annotations

import numpy as np

from orientd.rotation import Floats, align, rotate, slerp
from orientd.rpc import Plan, Samples

Dashes = tuple[float, ...]
"""Lengths of strokes and gaps in turn, in radians of arc; empty for one line."""

AXES = ("x", "y", "z")
PATTERNS: tuple[Dashes, ...] = ((), (0.09, 0.035), (0.075, 0.025, 0.02, 0.025))
"""Of the axes' traces: one line, dashes, dashes and dots."""

_FACES = np.ndarray[tuple[int, int], np.dtype[np.uint32]]


def tips(q: Floats) -> Floats:
    """Return where the tips of the axes are on the unit sphere.

    Args:
        q: orientations ``(w, x, y, z)``, shape ``(n, 4)``.

    Returns:
        Shape ``(3, n, 3)``: for each axis its tip at each orientation.
    """
    traces: Floats = np.stack([rotate(q, np.eye(3)[axis]) for axis in range(3)])
    return traces


def keyframe_orientations(plan: Plan, samples: Samples) -> Floats:
    """Return the orientations at the keyframes of a plan from its *samples*, shape ``(k, 4)``."""
    times = np.asarray(plan.keyframe_times, dtype=np.float64)
    after = np.clip(np.searchsorted(samples.times, times), 1, len(samples.times) - 1)
    start, end = samples.times[after - 1], samples.times[after]
    share = np.clip((times - start) / (end - start), 0.0, 1.0)
    pairs = align(np.stack([samples.q[after - 1], samples.q[after]], axis=-2))
    return slerp(pairs[:, 0], pairs[:, 1], share)


def dashed(points: Floats, pattern: Dashes) -> Floats:
    """Return the strokes of a line on the unit sphere, shape ``(m, 2, 3)``.

    A stroke ends where the line has its next corner after the stroke's end, so corners should be
    nearer to each other than strokes are long.

    Args:
        points: the line, shape ``(n, 3)``.
        pattern: of strokes and gaps.
    """
    segments: Floats = np.stack([points[:-1], points[1:]], axis=1)
    if not pattern:
        return segments
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    middles = np.cumsum(steps) - 0.5 * steps
    ends = np.cumsum(pattern)
    is_stroke = np.searchsorted(ends, middles % ends[-1], side="right") % 2 == 0
    kept: Floats = segments[is_stroke]
    return kept


def segments(line: Floats) -> Floats:
    """Return a line as segments, shape ``(n - 1, 2, 3)``."""
    return dashed(line, ())


def circle(axis: int, corners: int = 72) -> Floats:
    """Return the great circle of the unit sphere about an axis, closed, ``(corners + 1, 3)``."""
    around = np.linspace(0.0, 2.0 * np.pi, corners + 1)
    points = np.zeros((corners + 1, 3))
    points[:, (axis + 1) % 3], points[:, (axis + 2) % 3] = np.cos(around), np.sin(around)
    return points


def arrow(length: float, radius: float, *, sides: int = 20) -> tuple[Floats, _FACES]:
    """Return vertices and faces of an arrow from the origin along z; its tip is at *length*."""
    head = 4.5 * radius
    profile = [(0.0, 0.0), (radius, 0.0), (radius, length - head), (2.4 * radius, length - head)]
    return _turned([*profile, (0.0, length)], sides)


def tube(start: float, end: float, radius: float, *, sides: int = 20) -> tuple[Floats, _FACES]:
    """Return vertices and faces of a closed tube about z."""
    return _turned([(0.0, start), (radius, start), (radius, end), (0.0, end)], sides)


def _turned(profile: list[tuple[float, float]], sides: int) -> tuple[Floats, _FACES]:
    """Return the surface that a line of points (radius, height) leaves when turned about z."""
    around = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    radii, heights = np.array(profile).T
    rings = np.empty((len(profile), sides, 3))
    rings[..., 0] = radii[:, None] * np.cos(around)
    rings[..., 1] = radii[:, None] * np.sin(around)
    rings[..., 2] = heights[:, None]
    ring, side = np.meshgrid(np.arange(len(profile) - 1), np.arange(sides), indexing="ij")
    after = (side + 1) % sides
    a, b = ring * sides + side, ring * sides + after
    c, d = a + sides, b + sides
    faces = np.concatenate([np.stack([a, b, d], -1), np.stack([a, d, c], -1)]).reshape(-1, 3)
    return rings.reshape(-1, 3), faces.astype(np.uint32)
