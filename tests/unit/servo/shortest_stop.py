"""How quickly a stop could be: a proven bound for any path, and a search on the path itself.

Nothing here shares code with the servo: the motion's own samples and the limits are all it knows.
"""

from math import inf, sqrt

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csr_matrix

from orientd import rotation


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


_ENOUGH = 1.0005
_AXES = np.vstack([np.eye(3), -np.eye(3)])


class ShortestStop:
    """A search for a stop on the path in a given number of cycles, inside the limits.

    The unknowns are the places on the path at the end of each cycle.  What is made small is the
    largest share of a limit that backward differences reach, from what the device did before to two
    cycles of rest, by a sequence of linear programs inside a trust region.  It is a local search
    from several beginnings: a stop that it finds exists, and one that it does not find may.
    """

    def __init__(self, motion, record, omega, alpha, velocity):
        """Begin at a record that was reached as planned, with these backward differences."""
        self.motion, self.record, self.h = motion, record, motion.period
        self.omega, self.alpha, self.velocity = omega, alpha, velocity

    def finds_one(self, cycles, *, like):
        """Return whether there is one in which so many cycles move; *like* are a stop's rates."""
        t = np.arange(1, cycles + 1) / (cycles + 1)
        begins = [0.0, 0.3, 0.6]
        beginnings = [1.0 - _smooth(np.maximum(t - late, 0.0) / (1.0 - late)) for late in begins]
        places = (np.arange(cycles) + 0.5) * len(like) / cycles
        beginnings.append(np.interp(places, np.arange(len(like)) + 0.5, like))
        return any(self._improve(rates) <= _ENOUGH for rates in beginnings)

    def _differences(self, rates):
        """Return what a device would see, and the path's velocities at the places."""
        h = self.h
        places = np.concatenate([[0.0], np.cumsum(rates)])
        places = np.append(places, places[-1:].repeat(2))
        path = self.motion.sample(np.minimum((self.record + places) * h, self.motion.duration))
        turns = rotation.log(rotation.multiply(rotation.conjugate(path.q[:-1]), path.q[1:]))
        alpha = np.diff(np.vstack([self.omega, turns / h]), axis=0) / h
        jerk = np.diff(np.vstack([self.alpha, alpha]), axis=0) / h
        travel = np.diff(path.position, axis=0) / h
        push = np.diff(np.vstack([self.velocity, travel]), axis=0) / h
        return (alpha, jerk, push), path.omega_body[1:], path.velocity[1:]

    def _limits(self):
        limits = self.motion.limits
        return (
            (limits.acceleration, np.array(limits.axis_acceleration)),
            (limits.jerk, np.array(limits.axis_jerk)),
            (limits.linear_acceleration, np.full(3, inf)),
        )

    def _share(self, differences):
        return max(
            max(np.linalg.norm(vectors, axis=1).max() / most, (np.abs(vectors) / axes).max())
            for vectors, (most, axes) in zip(differences, self._limits(), strict=True)
        )

    def _improve(self, rates):
        """Return the least largest share of a limit that the search comes to from *rates*."""
        rates = np.clip(rates, 0.0, 1.0)
        found = self._differences(rates)
        best, trust, tired = self._share(found[0]), 0.15, 0
        for _ in range(60):
            if best <= _ENOUGH or trust < 1e-6 or tired > 4:
                break
            change, hoped = self._program(rates, *found, trust)
            other = np.clip(rates + change, 0.0, 1.0)
            differences = self._differences(other)
            share = self._share(differences[0])
            gain, promise = best - share, best - hoped
            if promise < 1e-5:
                break
            tired = tired + 1 if gain < 2e-4 else 0
            if gain < 0.3 * promise:
                trust *= 0.5 if gain > 0.0 else 0.3
            elif gain > 0.7 * promise:
                trust = min(2.0 * trust, 0.5)
            if gain > 0.0:
                rates, found, best = other, differences, share
        return best

    def _program(self, rates, differences, omega, velocity, trust):
        """Return the change of the rates that does most, and the share it would come to."""
        h, count = self.h, len(rates)
        moves = _steps(omega, count), _steps(omega, count), _steps(velocity, count)
        rows, most = [], []
        for order, (vectors, (limit, axes)) in enumerate(
            zip(differences, self._limits(), strict=True)
        ):
            slopes = moves[order]
            for _ in range(2 if order == 1 else 1):
                slopes = np.concatenate([slopes[:1], np.diff(slopes, axis=0)]) / h
            size = np.linalg.norm(vectors, axis=1, keepdims=True)
            if size.max() == 0.0 and not slopes.any():
                continue
            along = vectors / np.maximum(size, 1e-12)
            for way in (along, -along, *(np.broadcast_to(axis, vectors.shape) for axis in _AXES)):
                rows.append(np.einsum("ki,kij->kj", way, slopes) / limit)
                most.append(-np.sum(way * vectors, axis=1) / limit)
            for axis in np.flatnonzero(np.isfinite(axes)):
                for sign in (1.0, -1.0):
                    rows.append(sign * slopes[:, axis] / axes[axis])
                    most.append(-sign * vectors[:, axis] / axes[axis])
        shares = np.vstack(rows)
        bounds = np.eye(count) - np.eye(count, k=-1)
        matrix = np.vstack(
            [
                np.hstack([shares, np.full((len(shares), 1), -1.0)]),
                np.hstack([bounds, np.zeros((count, 1))]),
                np.hstack([-bounds, np.zeros((count, 1))]),
            ]
        )
        most += [np.minimum(1.0 - rates, trust), np.minimum(rates, trust)]
        result = linprog(
            np.eye(1, count + 1, count)[0],
            A_ub=csr_matrix(matrix),
            b_ub=np.concatenate(most),
            bounds=[(None, None)] * count + [(0.0, None)],
            method="highs",
        )
        if result.status != 0:
            return np.zeros(count), inf
        return np.diff(np.concatenate([[0.0], result.x[:-1]])), float(result.x[-1])


def _steps(velocity, count):
    """Return how each cycle's velocity depends on the places, shape ``(count + 2, 3, count)``."""
    steps = np.zeros((count + 2, 3, count))
    for k in range(count):
        steps[k, :, k] = velocity[k]
        if k > 0:
            steps[k, :, k - 1] = -velocity[k - 1]
    return steps


def _smooth(t):
    return t * t * (3.0 - 2.0 * t)
