r"""A trajectory on an uneven clock: the same orientations, at a rate that changes along it.

The trajectory's own time *s* is a function of time in two steps.  The outer one, :math:`x(t)`, has
a squared rate :math:`y = \dot x^2` that is a quadratic spline in *x*; the inner one,
:math:`s(x)`, is fixed and lets a device leave rest.  Both are in ``orientd/kernels/c/clock.h``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.curves.trajectory import PIECE, Trajectory
from orientd.errors import PlanError
from orientd.kernels import retime_trajectory, time_map
from orientd.rotation import Floats

_MOST_GROWTH = 256  # times the pieces that a retimed trajectory has at least


@dataclass(frozen=True, slots=True, eq=False)
class TimeMap:
    """A parameter by time.

    Attributes:
        times: when the nodes are passed, from 0 on, s, shape ``(n,)``.
        places: of the nodes, increasing from 0, shape ``(n,)``.
        values: squared rates there, shape ``(n,)``.
        slopes: of the squared rates by *x*, shape ``(n,)``.
        leaves: how far *x* goes while the parameter leaves rest, at both ends, shape ``(2,)``; 0
            where it does not, negative where a path that moves there is to be at rest.
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
        """Return when the parameter has given values; at its ends for those beyond, ``(n,)``."""
        out: Floats = np.empty((1, len(parameters)))
        time_map(*self._nodes, np.ascontiguousarray(parameters), out)
        times: Floats = out[0]
        return times

    def retimed(self, trajectory: Trajectory) -> Trajectory:
        """Return a trajectory run through as the parameter says, its time since it begins.

        Where the parameter leaves rest the orientations are at rest, too.

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
