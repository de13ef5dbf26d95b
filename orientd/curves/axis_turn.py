"""A turn about one axis from rest to rest, in phases of constant jerk."""

from __future__ import annotations

import numpy as np

from orientd.curves.construct import TABLE_ROWS, CumulativeCurve
from orientd.rotation import Floats

_SIGNS = np.array([1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0])  # of the jerk


class AxisTurn(CumulativeCurve):
    """A turn with the durations of its seven phases given; they make its jerk and its velocity.

    Args:
        q: orientation it begins at, shape ``(4,)``.
        axis: in the body frame, a unit vector.
        turn: how far, rad.
        phases: durations, s, shape ``(7,)``: jerk, none, jerk back, cruise, and the mirror image.
            Where the first is 0 the acceleration steps.
    """

    def __init__(self, q: Floats, axis: Floats, turn: float, phases: Floats) -> None:
        rise, hold, _, cruise, *_ = phases.tolist()
        # By how much it turns with an acceleration of 1 in the second phase.
        speed = rise + hold
        unit = speed * (2.0 * rise + hold + cruise)
        pull = turn / unit
        kept = phases > 0.0
        lengths = phases[kept]
        breaks = np.concatenate([[0.0], np.cumsum(lengths)])
        jerks = (pull / rise if rise else 0.0) * _SIGNS[kept]
        pulls = pull * np.array([0.0, 1.0, 1.0, 0.0, 0.0, -1.0, -1.0])[kept]
        rates = np.zeros(len(lengths))
        rates[1:] = np.cumsum(lengths * (pulls + 0.5 * lengths * jerks))[:-1]
        turns = np.zeros(len(lengths))
        ways = lengths * (rates + lengths * (0.5 * pulls + lengths * jerks / 6.0))
        turns[1:] = np.cumsum(ways)[:-1]
        table: Floats = np.zeros((TABLE_ROWS, len(lengths)))
        table[:4] = q[:, None]
        # Half angles, with the factorials divided out.
        self._powers = np.stack([turns, rates, 0.5 * pulls, jerks / 6.0])
        table[4:8] = 0.5 * self._powers
        table[8:11] = axis[:, None]
        increments = 0.5 * turn * axis[None]
        self._set_table(breaks, table, increments, continuity=2 if rise else 1)

    def turned(self, times: Floats) -> Floats:
        """Return how far it has turned at *times*, rad."""
        at = np.clip(np.searchsorted(self._knots, times, side="right") - 1, 0, len(self._knots) - 2)
        u = times - self._knots[at]
        a, b, c, d = self._powers[:, at]
        turned: Floats = a + u * (b + u * (c + u * d))
        return turned
