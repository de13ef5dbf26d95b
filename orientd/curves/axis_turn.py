"""A turn about one axis from rest to rest, in phases of constant jerk."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orientd.curves.trajectory import PIECE, Trajectory
from orientd.rotation import Floats, exp, multiply

_SIGNS = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])  # of the jerk
_LONGEST_PIECE = 1.9  # rad


class AxisTurn:
    """A turn with the durations of its seven phases given; they make its jerk and its velocity.

    Attributes:
        duration: of the turn, s.
        trajectory: the orientations, from time 0 on.
    """

    def __init__(self, q: Floats, axis: Floats, turn: float, phases: Floats) -> None:
        """Make the turn.

        Args:
            q: orientation it begins at, shape ``(4,)``.
            axis: in the body frame, a unit vector.
            turn: how far, rad.
            phases: durations, s, shape ``(7,)``: jerk, none, jerk back, cruise, and the mirror
                image.  Where the first is 0 the acceleration steps.
        """
        rise, hold, _, cruise, *_ = phases.tolist()
        # By how much it turns with an acceleration of 1 in the second phase.
        speed = rise + hold
        unit = speed * (2.0 * rise + hold + cruise)
        pull = turn / unit
        kept = phases > 0.0
        lengths = phases[kept]
        jerks = (pull / rise if rise else 0.0) * _SIGNS[kept]
        pulls = pull * np.array([0.0, 1.0, 1.0, 0.0, 0.0, -1.0, -1.0])[kept]
        rates = np.zeros(len(lengths))
        rates[1:] = np.cumsum(lengths * (pulls + 0.5 * lengths * jerks))[:-1]
        turns = np.zeros(len(lengths))
        ways = lengths * (rates + lengths * (0.5 * pulls + lengths * jerks / 6.0))
        turns[1:] = np.cumsum(ways)[:-1]
        self._knots = np.concatenate([[0.0], np.cumsum(lengths)])
        # The angle by powers of the time since a phase began.
        self._powers = np.stack([turns, rates, 0.5 * pulls, jerks / 6.0])
        self.duration = float(self._knots[-1])
        cuts = np.ceil(ways / _LONGEST_PIECE).astype(np.intp).clip(1)
        self.trajectory = self._trajectory(q, axis, cuts, 2 if rise else 1)

    def _trajectory(
        self, q: Floats, axis: Floats, cuts: NDArray[np.intp], continuity: int
    ) -> Trajectory:
        """Return the turn with each phase cut into so many pieces."""
        phase = np.repeat(np.arange(len(cuts)), cuts)
        half = 0.5 * (np.diff(self._knots) / cuts)[phase]
        place = np.arange(len(phase)) - np.repeat(np.cumsum(cuts) - cuts, cuts)
        u = half * (2 * place + 1)
        a, b, c, d = self._powers[:, phase]
        pieces: Floats = np.zeros((len(phase), PIECE))
        pieces[:, :4] = multiply(q, exp((a + u * (b + u * (c + u * d)))[:, None] * axis))
        angles = (b + u * (2.0 * c + 3.0 * u * d), c + 3.0 * u * d, d)
        for power, angle in enumerate(angles, start=1):
            columns = slice(4 + 3 * power, 7 + 3 * power)
            pieces[:, columns] = (angle * half**power)[:, None] * axis
        breaks = np.append(self._knots[phase] + 2.0 * half * place, self._knots[-1])
        return Trajectory(breaks, pieces, self._knots, continuity)

    def turned(self, times: Floats) -> Floats:
        """Return how far it has turned at *times*, rad."""
        at = np.clip(np.searchsorted(self._knots, times, side="right") - 1, 0, len(self._knots) - 2)
        u = times - self._knots[at]
        a, b, c, d = self._powers[:, at]
        turned: Floats = a + u * (b + u * (c + u * d))
        return turned
