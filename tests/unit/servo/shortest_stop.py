"""How quickly a stop on the path could be: a proven bound, and a numerical optimum.

Nothing here shares code with the servo: the motion's own samples and the limits are all it knows.
"""

from math import inf, sqrt

import numpy as np
from scipy.optimize import minimize


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


def optimum(motion, place, guess, *, intervals=32):
    """Return the shortest time to rest that SLSQP finds for a path clock at full rate.

    The clock's jerk is constant in each of the intervals; the limits are held at their ends.  It
    is a local optimum: where it fails or ends above the guess, the guess is as good as it gets.

    Args:
        motion: whose path and limits.
        place: path time of the stop, s.
        guess: a time that is long enough, s.
        intervals: pieces of constant jerk.
    """
    limits, h = motion.limits, motion.period
    times = np.arange(place, min(place + 1.2 * guess, motion.duration) + h, h)
    path = motion.sample(np.minimum(times, motion.duration))
    jerk = np.gradient(path.alpha_body, h, axis=0)
    push = np.gradient(path.velocity, h, axis=0)
    table = np.hstack([path.omega_body, path.alpha_body, jerk, path.velocity, push])
    axes = [np.array(x) for x in (limits.axis_velocity, limits.axis_acceleration, limits.axis_jerk)]

    def rows(s):
        x = np.clip(s / h, 0.0, len(table) - 1.001)
        k = x.astype(int)
        f = (x - k)[:, None]
        return np.hsplit(table[k] * (1.0 - f) + table[k + 1] * f, 5)

    def profile(x):
        d, b = guess * x[0] / intervals, x[1:] / guess**2
        a = np.concatenate([[0.0], np.cumsum(b) * d])
        rate = np.concatenate([[1.0], 1.0 + np.cumsum(a[:-1] * d + b * d * d / 2)])
        steps = rate[:-1] * d + a[:-1] * d * d / 2 + b * d**3 / 6
        return np.concatenate([[0.0], np.cumsum(steps)]), rate, a, b

    def within(x):
        s, r, a, b = profile(x)
        w, al, j, v, p = rows(s)
        r, a = r[:, None], a[:, None]
        bend = al * r**2 + w * a
        three = j * r**3 + 3 * al * r * a
        twist = np.concatenate([three[:-1] + w[:-1] * b[:, None], three[1:] + w[1:] * b[:, None]])
        found = [
            1 - (bend[1:] ** 2).sum(1) / limits.acceleration**2,
            1 - (twist**2).sum(1) / limits.jerk**2,
            r[:, 0],
            1.0 - r[1:, 0],
        ]
        if np.isfinite(limits.linear_acceleration):
            push = p * r**2 + v * a
            found.append(1 - (push[1:] ** 2).sum(1) / limits.linear_acceleration**2)
        for value, most in ((bend, axes[1]), (twist, axes[2])):
            found += [1 - (value[1:, i] / most[i]) ** 2 for i in range(3) if most[i] < inf]
        return np.concatenate(found)

    def at_rest(x):
        _, rate, a, _ = profile(x)
        return np.array([rate[-1], a[-1] * guess])

    start = np.concatenate([[1.0], np.where(np.arange(intervals) < intervals // 2, -4.0, 4.0)])
    best = minimize(
        lambda x: x[0],
        start,
        jac=lambda x: np.eye(1, len(x))[0],
        method="SLSQP",
        bounds=[(0.05, 1.5)] + [(-np.inf, np.inf)] * intervals,
        constraints=[{"type": "ineq", "fun": within}, {"type": "eq", "fun": at_rest}],
        options={"maxiter": 150, "ftol": 1e-5},
    )
    is_feasible = within(best.x).min() > -0.01 and np.abs(at_rest(best.x)).max() < 1e-3
    return guess * float(best.x[0]) if is_feasible else inf
