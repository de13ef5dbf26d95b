"""A path that is known by the rows of its records only, as a motion from a file has it.

At a record it is what the row says, to the last bit.  Between two records it is the path that the
servo takes (:mod:`orientd.servo.path.segment`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.planner.path.path import PathSamples
from orientd.planner.path.table_path import on_grid
from orientd.planner.recorded import HISTORY, STATE_FLOATS, states_between
from orientd.planner.request import State
from orientd.rotation import Floats


@dataclass(frozen=True, slots=True, eq=False)
class RowPath:
    """States on a uniform grid of path time, held before and after.

    Attributes:
        period: s.
        duration: path time from hold to hold, s; up to a period less than to the last row.
        table: state and axis angles of each record, shape ``(n, STATE_FLOATS + axes)``.
        earlier: axis angles of the three records before the first, rad, shape ``(3, axes)``.
    """

    period: float
    duration: float
    table: Floats
    earlier: Floats

    def rows(self, first: int, count: int) -> Floats:
        """Return a copy of rows of the table."""
        return self.table[first : first + count].copy()

    def joints_before(self, record: int) -> tuple[tuple[float, ...], ...]:
        """Return the axis angles of the three records before one, the oldest first."""
        joints = np.concatenate([self.earlier, self.table[:, STATE_FLOATS:]])
        return tuple(map(tuple, joints[record : record + HISTORY].tolist()))

    def sample(self, times: Floats) -> PathSamples:
        """Return the path at *times*, in any order; beyond its ends it is held.

        Raises:
            ValueError: an instant is not a number.
        """
        return PathSamples(*np.split(self._states(times), [4, 7, 10, 13, 16], axis=1)[:5])

    def state(self, time: float) -> State:
        """Return the state at *time*."""
        row = self._states(np.array([time]))[0]
        return State(row[:4], row[4:7], row[7:10], row[10:13], row[13:16], row[16:])

    def _states(self, times: Floats) -> Floats:
        if np.isnan(times).any():
            raise ValueError("times must be numbers, got nan")
        h, table = self.period, self.table
        _, index, share = on_grid(times, h, len(table))
        found: Floats = table[index, :STATE_FLOATS]
        inner = np.flatnonzero(share > 0.0)
        here, there = table[index[inner]], table[index[inner] + 1]
        found[inner] = states_between(
            here[:, :STATE_FLOATS], there[:, :STATE_FLOATS], h, share[inner]
        )
        beyond = (times < 0.0) | (times >= (len(table) - 1) * h)
        found[beyond, 4:10] = found[beyond, 13:] = 0.0
        return found
