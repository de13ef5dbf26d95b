"""The least time that any gimbal of two axes loses a target, by a fine dynamic programme.

The state is the angle and the rate of the outer axis, the control its acceleration: none, or all of
it either way.  Time, angle and rate lie on a grid on which these motions are exact.  The inner axis
is taken to be wherever it is best inside its range, at once.  So the result is a lower bound, but
for the grid.
"""

import math

import numpy as np

STEP = 0.05
"""Longest time between two controls, s."""


def least_loss(times, azimuth, elevation, *, turns, inner, velocity, acceleration, tolerance):
    """Return the least time in which the target is missed by more than *tolerance*, s.

    Args:
        times: s, shape ``(n,)``.
        azimuth: rad, unwrapped, shape ``(n,)``.
        elevation: rad, shape ``(n,)``.
        turns: lowest and highest angle of the outer axis, rad.
        inner: lowest and highest angle of the inner axis, rad.
        velocity: of the outer axis, rad/s.
        acceleration: of the outer axis, rad/s^2.
        tolerance: rad.
    """
    levels = max(1, math.ceil(velocity / (acceleration * STEP)))
    step = velocity / (levels * acceleration)
    unit = 0.5 * acceleration * step**2
    angles = np.arange(turns[0], turns[1] + unit / 2, unit)
    grid = np.arange(times[0], times[-1] + step / 2, step)
    # Close to the zenith the azimuth turns within a step: interpolate the direction.
    up = np.sin(elevation)
    east, north = np.cos(elevation) * np.sin(azimuth), np.cos(elevation) * np.cos(azimuth)
    x, y, z = (np.interp(grid, times, part) for part in (north, east, up))
    size = np.sqrt(x * x + y * y + z * z)
    line, sine, height = np.arctan2(y, x), np.hypot(x, y) / size, np.arcsin(z / size)
    sines, cosines = np.sin(angles), np.cos(angles)
    cost = np.zeros((2 * levels + 1, len(angles)), dtype=np.float32)
    limit = math.sin(tolerance)
    for at in range(len(grid)):
        if at:
            cost = _moved(cost, levels)
        if sine[at] <= limit:
            continue  # too close to the outer axis to be missed
        turned = sines * math.cos(line[at]) - cosines * math.sin(line[at])
        is_near = cosines * math.cos(line[at]) + sines * math.sin(line[at]) > 0.0
        is_missed = sine[at] * np.abs(turned) > limit
        for side, is_here in ((height[at], is_near), (math.pi - height[at], ~is_near)):
            if not inner[0] <= side <= inner[1]:
                is_missed |= is_here
        cost += np.float32(step) * is_missed
    return float(np.min(cost))


def _moved(cost, levels):
    """Return the least cost of each state a step later."""
    moved = np.full_like(cost, np.inf)
    count = cost.shape[1]
    for rate in range(-levels, levels + 1):
        for change in (-1, 0, 1):
            then = rate + change
            if abs(then) > levels:
                continue
            shift = 2 * rate + change
            a, b = max(0, shift), min(count, count + shift)
            here = moved[then + levels, a:b]
            np.minimum(here, cost[rate + levels, a - shift : b - shift], out=here)
    return moved
