r"""The position of a motion: a quintic spline from rest to rest.

The spline passes through the keyframes that have a position.  Its derivatives are continuous up to
the fourth, and it starts and ends at rest without acceleration.  Before and after it the position
is constant.  A move between two points is a single piece, :math:`p_0 + (p_1 - p_0)(10u^3 - 15u^4 +
6u^5)`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from orientd import kernels
from orientd.curves.quintic import QUINTIC, quintic, quintics
from orientd.errors import PlanError
from orientd.rotation import Floats

Motion3 = tuple[Floats, Floats, Floats]
"""Position, velocity and acceleration."""

Clock = Callable[[Floats], tuple[Floats, Floats, Floats]]
"""Maps a time to a path time and its first two derivatives, for example a ``TimeMap``."""

_STILL = np.zeros(3)


@dataclass(frozen=True, slots=True, eq=False)
class PositionPath:
    """A piecewise quintic in time, constant outside its breaks.

    Attributes:
        breaks: increasing times, s, shape ``(m + 1,)``.
        coefficients: of the powers of the time since a piece's own break, shape ``(m, 6, 3)``.
        first: the position before the breaks.
        last: the position after them.
    """

    breaks: Floats
    coefficients: Floats
    first: Floats
    last: Floats

    @classmethod
    def held(cls, position: ArrayLike) -> PositionPath:
        """Return the path that stays at *position*."""
        point = np.asarray(position, dtype=np.float64)
        return cls(np.empty(0), np.empty((0, QUINTIC, 3)), point, point)

    @property
    def is_held(self) -> bool:
        """Whether the position is constant."""
        return len(self.coefficients) == 0

    def sample(self, times: Floats) -> Motion3:
        """Return positions, velocities and accelerations at *times*, ``(n, 3)`` each.

        At a break they are those of the piece that begins there.
        """
        found: Floats = np.zeros((3, len(times), 3))
        position, velocity, acceleration = found
        if self.is_held:
            position[:] = self.first
            return position, velocity, acceleration
        times = np.ascontiguousarray(times, dtype=np.float64)
        kernels.sample_moves(times, self.breaks, self.coefficients.reshape(-1, QUINTIC * 3), found)
        # While it is held, the position is constant to the last digit.
        position[times < self.breaks[0]] = self.first
        position[times >= self.breaks[-1]] = self.last
        return position, velocity, acceleration

    def state(self, time: float) -> Motion3:
        """Return position, velocity and acceleration at *time*, shape ``(3,)`` each."""
        position, velocity, acceleration = self.sample(np.array([time]))
        return position[0], velocity[0], acceleration[0]

    def retimed(self, clock: Clock, times: Floats) -> PositionPath:
        """Return the same positions with another timing, quintic between *times* of it, s.

        It may continue a motion, and ends at rest.
        """
        if self.is_held:
            return self
        path_times, rate, change = clock(times)
        rate, change = rate[:, None], np.nan_to_num(change)[:, None]
        position, velocity, acceleration = self.sample(path_times)
        acceleration = acceleration * rate**2 + velocity * change
        velocity = velocity * rate
        velocity[-1] = acceleration[-1] = 0.0
        pieces = quintics(np.diff(times), position, velocity, acceleration)
        return PositionPath(times, pieces, position[0], position[-1])

    def slowed(self, factor: float) -> PositionPath:
        """Return the same path, slower by *factor*."""
        powers = factor ** -np.arange(float(QUINTIC))
        coefficients = self.coefficients * powers[:, None]
        return replace(self, breaks=self.breaks * factor, coefficients=coefficients)

    def delayed(self, delay: float) -> PositionPath:
        """Return the same path *delay* seconds later."""
        return self if self.is_held else replace(self, breaks=self.breaks + delay)

    def after(self, lead: PositionPath) -> PositionPath:
        """Return *lead*, which ends where this path begins, followed by this path."""
        if lead.is_held:
            return self
        if self.is_held:
            return lead
        gap = self.breaks[0] > lead.breaks[-1]
        hold: Floats = np.zeros((int(gap), QUINTIC, 3))
        hold[:, 0] = self.first
        return PositionPath(
            np.concatenate([lead.breaks if gap else lead.breaks[:-1], self.breaks]),
            np.concatenate([lead.coefficients, hold, self.coefficients]),
            lead.first,
            self.last,
        )

    def since(self, time: float) -> PositionPath:
        """Return the part after *time*, at the same times."""
        if self.is_held or time <= self.breaks[0]:
            return self
        if time >= self.breaks[-1]:
            return PositionPath.held(self.last)
        piece = int(np.searchsorted(self.breaks[1:-1], time, side="right"))
        u, c = time - self.breaks[piece], self.coefficients[piece:].copy()
        c[0] = [
            sum(math.comb(n, k) * u ** (n - k) * c[0, n] for n in range(k, QUINTIC))
            for k in range(QUINTIC)
        ]
        return PositionPath(np.append(time, self.breaks[piece + 1 :]), c, c[0, 0], self.last)

    def until(self, time: float) -> PositionPath:
        """Return the part before *time*."""
        if self.is_held or time <= self.breaks[0]:
            return PositionPath.held(self.first)
        count = int(np.searchsorted(self.breaks, time))
        if count == len(self.breaks):
            return self
        breaks = np.append(self.breaks[:count], time)
        last = self.state(time)[0]
        return PositionPath(breaks, self.coefficients[:count], self.first, last)

    def after_move_from(self, position: Floats, end: float) -> PositionPath:
        """Return a move from *position* to the first point of this path, followed by this path.

        Args:
            position: the initial position.
            end: end of the move from time 0 on, not later than this path's first break, s.
        """
        # A move that takes no time bridges only a rounding error.
        if not end or np.array_equal(position, self.first):
            return self
        move = quintic((position, _STILL, _STILL), (self.first, _STILL, _STILL), end)
        return self.after(PositionPath(np.array([0.0, end]), move[None], position, self.first))


def position_path(
    times: Floats, positions: Floats | None, held: Floats, first: Motion3 | None = None
) -> PositionPath:
    """Return the path through two positions or more at their times.

    Args:
        times: increasing, s, shape ``(n,)``.
        positions: shape ``(n, 3)``, NaN for keyframes without one; ``None`` if no keyframe has one.
        held: the position of a motion without positions.
        first: velocity and acceleration at the first position, after it; ``None`` for rest.
    """
    if positions is None:
        return PositionPath.held(held)
    is_given = np.isfinite(positions[:, 0])
    instants, points = times[is_given], positions[is_given]
    if len(points) == 1:
        return PositionPath.held(points[0])
    velocities, pushes = np.zeros((2, *points.shape))
    if first is not None:
        velocities[0], pushes[0] = first[1:]
    intervals = np.diff(instants)
    if len(points) > 2:
        _join(intervals, points, velocities, pushes)
    pieces = quintics(intervals, points, velocities, pushes)
    return PositionPath(instants, pieces, points[0], points[-1])


def _join(intervals: Floats, points: Floats, velocities: Floats, pushes: Floats) -> None:
    """Fill in velocities and accelerations that make third and fourth derivatives continuous.

    Each inner point gives two equations in the derivatives at it and at its neighbours.
    """
    size = 2 * (len(points) - 2)
    h, g = intervals[:-1], intervals[1:]
    way = np.diff(points, axis=0) / intervals[:, None] ** 3
    rows: Floats = np.empty((2, 6, len(h)))
    rows[0] = -24 / h**2, -3 / h, 36 / g**2 - 36 / h**2, 9 / h + 9 / g, 24 / g**2, -3 / g
    rows[1] = (
        -168 / h**3, -24 / h**2, -192 / h**3 - 192 / g**3, 36 / h**2 - 36 / g**2,
        -168 / g**3, 24 / g**2,
    )  # fmt: skip
    right: Floats = np.empty((len(h), 2, 3))
    right[:, 0] = 60.0 * (way[1:] - way[:-1])
    right[:, 1] = -360.0 * (way[1:] / g[:, None] + way[:-1] / h[:, None])
    right[0] -= rows[:, 0, :1] * velocities[0] + rows[:, 1, :1] * pushes[0]
    # Remove the units, so that pivoting compares rows fairly.
    units = np.minimum(h, g) ** np.array([[2.0], [3.0]])
    rows *= units[:, None]
    right *= units.T[:, :, None]
    band: Floats = np.zeros((7, size))
    for place in range(12):
        row = 2 * np.arange(len(h)) + place // 6
        column = 2 * np.arange(len(h)) - 2 + place % 6
        inside = (column >= 0) & (column < size)
        band[3 + (row - column)[inside], column[inside]] = rows[place // 6, place % 6, inside]
    solution = right.reshape(size, 3)
    if not kernels.solve_banded(band, 3, 3, solution):
        raise PlanError("no spline was found through the positions: their times are too uneven")
    velocities[1:-1], pushes[1:-1] = solution[0::2], solution[1::2]
