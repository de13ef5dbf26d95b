"""How quickly a stop could be, whatever path it took: a proven bound.

Nothing here shares code with the servo: the motion's own samples and the limits are all it knows.
"""

from math import sqrt

import numpy as np


def _directions():
    random = np.random.default_rng(0).normal(size=(300, 3))
    return np.vstack([np.eye(3), -np.eye(3), random / np.linalg.norm(random, axis=1)[:, None]])


_DIRECTIONS = _directions()


def bound(omega, alpha, velocity, limits):
    """Return a time that no stop is shorter than, whatever path it took.

    Along any direction the component of the angular velocity has to go to zero from its own first
    acceleration, within what the limits allow along that direction at most: a double integrator
    with bounded jerk.  The largest of these times, over many directions, is the bound.
    """
    best = float(np.linalg.norm(velocity)) / limits.linear_acceleration
    directions = _DIRECTIONS
    if np.linalg.norm(omega) > 0.0:
        directions = np.vstack([omega / np.linalg.norm(omega), directions])
    for d in directions:
        speed, push = float(omega @ d), float(alpha @ d)
        most, jerk = (
            min(limit, sum(abs(x) * a for x, a in zip(d, axes, strict=True) if x != 0.0))
            for limit, axes in (
                (limits.acceleration, limits.axis_acceleration),
                (limits.jerk, limits.axis_jerk),
            )
        )
        if speed <= 0.0 or (push < 0.0 and push * push / (2.0 * jerk) >= speed):
            continue
        peak = sqrt(jerk * speed + 0.5 * push * push)
        if peak <= most:
            best = max(best, (push + 2.0 * peak) / jerk)
        else:
            held = speed + (push * push - 2.0 * most * most) / (2.0 * jerk)
            best = max(best, (push + 2.0 * most) / jerk + held / most)
    return best
