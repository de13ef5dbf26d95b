r"""A trajectory on an uneven clock: the same orientations, at a rate that changes along it.

The trajectory's own time *s* is a function of time in two steps.  The outer one, :math:`x(t)`, has
a squared rate :math:`y = \dot x^2` that is a quadratic spline in *x*; the inner one,
:math:`s(x)`, is fixed and lets a device leave rest.  Both are in ``orientd/kernels/c/clock.h``.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from orientd import kernels
from orientd.curves.trajectory import PIECE, Trajectory
from orientd.rotation import Floats

_NEWTON_STEPS = 40


@dataclass(frozen=True, slots=True, eq=False)
class TimeMap:
    """A parameter by time.

    Attributes:
        places: of the nodes, increasing from 0, shape ``(n,)``.
        values: squared rates there, shape ``(n,)``.
        slopes: of the squared rates by *x*, shape ``(n,)``.
        leaves: how far *x* goes while the parameter leaves rest, at both ends; 0 where it does not.
        times: when the nodes are passed, from 0 on, s, shape ``(n,)``.
    """

    places: Floats
    values: Floats
    slopes: Floats
    leaves: Floats
    times: Floats = field(init=False)

    def __post_init__(self) -> None:
        times: Floats = np.empty(len(self.places))
        kernels.put_node_times(self.places, self.values, self.slopes, times)
        object.__setattr__(self, "times", times)

    def __call__(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the parameter and its first two derivatives by time."""
        out: Floats = np.empty((3, len(times)))
        instants = np.ascontiguousarray(times)
        nodes = self.times, self.places, self.values, self.slopes
        kernels.sample_clock(*nodes, self.leaves, instants, out)
        return out[0], out[1], out[2]

    def retimed(self, trajectory: Trajectory) -> Trajectory:
        """Return a trajectory run through as the parameter says, its time since it begins.

        Where the parameter leaves rest the orientations are at rest, too.
        """
        nodes = self.times, self.places, self.values, self.slopes, self.leaves
        room, count = 2 * (len(self.times) + len(trajectory.breaks)), 0
        while not count:
            breaks, pieces = np.empty(room + 1), np.empty((room, PIECE))
            count = kernels.retime_trajectory(
                trajectory.breaks, trajectory.pieces, *nodes, breaks, pieces
            )
            room *= 4
        knots = self.times_of(trajectory.knots - trajectory.domain[0])
        return Trajectory(breaks[: count + 1], pieces[:count], knots, trajectory.continuity)

    def times_of(self, parameters: Floats) -> Floats:
        """Return when the parameter has given values."""
        x = places_of(parameters, self.leaves, float(self.places[-1]))
        here = np.clip(np.searchsorted(self.places, x, side="right") - 1, 0, len(self.places) - 2)
        # The part of an element up to there, as an element of its own.
        ahead = np.clip(x - self.places[here], 0.0, np.diff(self.places)[here])
        bend = (np.diff(self.slopes) / np.diff(self.places))[here]
        square = self.values[here] + ahead * (self.slopes[here] + 0.5 * ahead * bend)
        mean = ahead / (np.sqrt(self.values[here]) + np.sqrt(np.maximum(square, 0.0)))
        w = np.sqrt(0.5 * np.abs(bend))
        small = w * mean < 1e-6
        turned = np.where(bend > 0.0, np.arctanh(np.minimum(w * mean, 1.0 - 1e-16)),
                          np.arctan(w * mean))  # fmt: skip
        times: Floats = self.times[here] + 2.0 * np.where(
            small, mean, turned / np.where(small, 1.0, w)
        )
        times[x <= 0.0], times[x >= self.places[-1]] = 0.0, self.times[-1]
        return times


def places_of(parameters: Floats, leaves: Floats, total: float) -> Floats:
    """Return *x* where the parameter, from 0 on, has given values, by Newton's method.

    Args:
        parameters: from 0 to the largest one.
        leaves: as for :class:`TimeMap`.
        total: the largest *x*.
    """
    end = total - 0.2 * float(leaves.sum())
    places = parameters + 0.2 * float(leaves[0])
    places[parameters >= end] = total
    for length, ahead in ((leaves[0], parameters), (leaves[1], end - parameters)):
        near = (ahead < 0.8 * length) & (ahead > 0.0)
        if not near.any():
            continue
        goal = ahead[near] / length
        u = goal ** (2.0 / 3.0)
        for _ in range(_NEWTON_STEPS):
            root = np.sqrt(u)
            u = u - (u * root * (1.0 - 0.2 * u) - goal) / (root * (1.5 - 0.5 * u))
        places[near] = length * u if ahead is parameters else total - length * u
    places[parameters <= 0.0] = 0.0
    return places
