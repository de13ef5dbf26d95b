r"""A trajectory on another clock: the same orientations, at a rate that varies along it.

The trajectory's own time *s* is a function of time in two steps.  The outer function, :math:`x(t)`,
has a squared rate :math:`y = \dot x^2` that is a quadratic spline in *x*.  The inner one,
:math:`s(x)`, is fixed and lets a device leave rest.  ``orientd/kernels/c/clock.h`` has both.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.curves.trajectory import PIECE, Trajectory
from orientd.errors import PlanError
from orientd.kernels import retime_trajectory, time_map
from orientd.rotation import Floats

_MOST_GROWTH = 256  # multiple of the least number of pieces of a retimed trajectory


@dataclass(frozen=True, slots=True, eq=False)
class TimeMap:
    """A parameter as a function of time.

    Attributes:
        times: times of the nodes, from 0 on, s, shape ``(n,)``.
        places: parameters of the nodes, increasing from 0, shape ``(n,)``.
        values: squared rates there, shape ``(n,)``.
        slopes: derivatives of the squared rates by *x*, shape ``(n,)``.
        leaves: lengths of *x* over which the parameter leaves rest, at both ends, shape ``(2,)``. 0
            means that it does not, negative that a path that moves there must be at rest.
    """

    times: Floats
    places: Floats
    values: Floats
    slopes: Floats
    leaves: Floats

    def __call__(self, times: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the parameter, from 0 on, and its first two derivatives at *times*, (n,) each."""
        out: Floats = np.empty((3, len(times)))
        time_map(*self._nodes, np.ascontiguousarray(times), out)
        return out[0], out[1], out[2]

    def times_of(self, parameters: Floats) -> Floats:
        """Return the times of given parameter values, clipped to its ends, ``(n,)``."""
        out: Floats = np.empty((1, len(parameters)))
        time_map(*self._nodes, np.ascontiguousarray(parameters), out)
        times: Floats = out[0]
        return times

    def retimed(self, trajectory: Trajectory) -> Trajectory:
        """Return a trajectory whose time, since its start, is the parameter.

        If the parameter leaves rest, so do the orientations.

        Raises:
            PlanError: it would take far more pieces than the trajectory and the parameter have.
        """
        room, count = 2 * (len(self.times) + len(trajectory.breaks)), 0
        most = _MOST_GROWTH * room
        while not count:
            if room > most:
                raise PlanError(f"a retimed curve would take more than {most} pieces")
            breaks, pieces = np.empty(room + 1), np.empty((room, PIECE))
            count = retime_trajectory(
                trajectory.breaks, trajectory.pieces, *self._nodes, breaks, pieces
            )
            room *= 4
        knots = self.times_of(trajectory.knots - trajectory.domain[0])
        return Trajectory(breaks[: count + 1], pieces[:count], knots, trajectory.continuity)

    @property
    def _nodes(self) -> tuple[Floats, Floats, Floats, Floats, Floats]:
        return self.times, self.places, self.values, self.slopes, self.leaves
