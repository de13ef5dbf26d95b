"""The least time that a gimbal of two axes loses a target among cones, by a fine search.

The state is both axis angles on a fine grid; in a step each axis stays or turns by a cell, at its
full speed and without a limit of its acceleration.  So the result is a lower bound, but for the
grid.  No state inside a cone is entered.
"""

import numpy as np


def least_loss(times, target, *, turns, inner, velocity, tolerance, cones, cell):
    """Return the least time in which the target is missed by more than *tolerance*, s.

    Args:
        times: s, even, shape ``(n,)``.
        target: unit vectors north, west, up; shape ``(n, 3)``.
        turns: lowest and highest azimuth, rad, from north towards east.
        inner: lowest and highest elevation, rad.
        velocity: of both axes, rad/s.
        tolerance: rad.
        cones: pairs of a unit vector and a half angle in rad.
        cell: distance of neighbours, rad.
    """
    azimuth, elevation = (np.arange(low, high + cell / 2, cell) for low, high in (turns, inner))
    a, e = azimuth[:, None], elevation[None, :]
    points = np.stack(
        [np.cos(e) * np.cos(a), -np.cos(e) * np.sin(a), np.sin(e) + 0.0 * a], axis=-1
    ).astype(np.float32)
    is_free = np.ones(points.shape[:2], dtype=bool)
    for direction, half in cones:
        is_free &= points @ np.asarray(direction, dtype=np.float32) < np.cos(half)
    step = cell / velocity
    grid = np.arange(times[0], times[-1], step)
    cost = np.where(is_free, 0.0, np.inf).astype(np.float32)
    for t in grid:
        aim = np.array([np.interp(t, times, column) for column in target.T])
        is_off = points @ (aim / np.linalg.norm(aim)).astype(np.float32) < np.cos(tolerance)
        for axis in (0, 1):
            other = np.moveaxis(cost, axis, 0)
            best = other.copy()
            np.minimum(best[1:], other[:-1], out=best[1:])
            np.minimum(best[:-1], other[1:], out=best[:-1])
            cost = np.moveaxis(best, 0, axis)
        cost = np.where(is_free, cost + np.float32(step) * is_off, np.inf).astype(np.float32)
    return float(cost.min())
