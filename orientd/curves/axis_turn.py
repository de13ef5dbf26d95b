"""A turn about one axis from rest to rest, in phases of constant jerk."""

from __future__ import annotations

import math

import numpy as np

from orientd.curves.trajectory import PIECE, Trajectory
from orientd.rotation import Floats

_SIGNS = (1.0, 0.0, -1.0, 0.0, -1.0, 0.0, 1.0)  # of the jerk
_PULLS = (0.0, 1.0, 1.0, 0.0, 0.0, -1.0, -1.0)  # of the acceleration as a phase begins
_LONGEST_PIECE = 1.9  # rad


class AxisTurn:
    """A turn with given durations of its seven phases, which determine its jerk and its velocity.

    Attributes:
        duration: of the turn, s.
        trajectory: the orientations, from time 0 on.
    """

    def __init__(self, q: Floats, axis: Floats, turn: float, phases: Floats) -> None:
        """Make the turn.

        Args:
            q: initial orientation, shape ``(4,)``.
            axis: in the body frame, a unit vector.
            turn: angle, rad.
            phases: durations, s, shape ``(7,)``: jerk, constant acceleration, opposite jerk,
                constant velocity, and the mirror image.  If the first is 0 the acceleration steps.
        """
        rise, hold, _, cruise, *_ = phases.tolist()
        # The turn with an acceleration of 1 in the second phase.
        pull = turn / ((rise + hold) * (2.0 * rise + hold + cruise))
        knots, powers = [0.0], []
        angle = rate = 0.0
        for length, sign, begun in zip(phases.tolist(), _SIGNS, _PULLS, strict=True):
            if length > 0.0:
                # The angle by powers of the time since the start of the phase.
                jerk, bend = (sign * pull / rise if rise else 0.0), begun * pull
                powers.append((angle, rate, 0.5 * bend, jerk / 6.0))
                angle += length * (rate + length * (0.5 * bend + length * jerk / 6.0))
                rate += length * (bend + 0.5 * length * jerk)
                knots.append(knots[-1] + length)
        self.duration = knots[-1]
        self._knots, self._powers = np.array(knots), np.array(powers)
        breaks, pieces = [0.0], []
        w, x, y, z = q.tolist()
        i, j, k = axis.tolist()
        for begin, end, (a, b, c, d) in zip(knots, knots[1:], powers, strict=False):
            length = end - begin
            cuts = max(1, math.ceil(length * (b + length * (c + length * d)) / _LONGEST_PIECE))
            h = 0.5 * length / cuts
            for place in range(cuts):
                u = h * (2 * place + 1)
                half = 0.5 * (a + u * (b + u * (c + u * d)))
                cos, sin = math.cos(half), math.sin(half)
                base = (
                    cos * w - sin * (x * i + y * j + z * k),
                    cos * x + sin * (w * i + y * k - z * j),
                    cos * y + sin * (w * j + z * i - x * k),
                    cos * z + sin * (w * k + x * j - y * i),
                )
                by = h * (b + u * (2.0 * c + 3.0 * u * d)), h * h * (c + 3.0 * u * d), h**3 * d
                pieces.append((*base, 0.0, 0.0, 0.0, *(r * e for r in by for e in (i, j, k))))
                breaks.append(end if place + 1 == cuts else begin + u + h)
        table: Floats = np.zeros((len(pieces), PIECE))
        table[:, :16] = pieces
        self.trajectory = Trajectory(np.array(breaks), table, self._knots, 2 if rise else 1)

    def turned(self, times: Floats) -> Floats:
        """Return the angle at *times*, rad."""
        at = np.clip(np.searchsorted(self._knots, times, side="right") - 1, 0, len(self._knots) - 2)
        u = times - self._knots[at]
        a, b, c, d = self._powers[at].T
        turned: Floats = a + u * (b + u * (c + u * d))
        return turned
