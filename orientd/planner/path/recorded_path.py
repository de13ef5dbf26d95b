r"""A path known at its records only: shaped for the axes of a device, or read from a file.

At a record it equals the row, to the last bit.  Between two records it is the path that the servo
takes (:mod:`orientd.servo.path.segment`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orientd.planner.facts import HISTORY
from orientd.planner.path.path import Path, PathSamples
from orientd.planner.recorded import (
    STATE_FLOATS,
    joint_rates,
    joints_of,
    rates_of,
    states_at,
)
from orientd.planner.state import State
from orientd.rotation import Floats, align, angle, conjugate, exp, log, multiply

SAME_ANGLE = 1e-9
"""Largest distance of two equal paths, rad."""

_EVEN = 1e-6
"""Largest deviation of steps along the original from its own pace, as a share of a period."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPath:
    """States on a uniform grid of path time, constant before and after.

    Attributes:
        period: s.
        duration: path time from start to end, s; up to a period less than to the last row.
        table: state, axis angles and their velocities of each record, shape ``(n, STATE_FLOATS +
            2 axes)``.
        earlier: axis angles of the three records before the first, rad, shape ``(3, axes)``.
        is_reshaped: whether it deviates from the original path or its times anywhere.
    """

    period: float
    duration: float
    table: Floats
    earlier: Floats
    is_reshaped: bool = True

    @classmethod
    def of(
        cls,
        q: Floats,
        path_times: Floats,
        original: Path,
        period: float,
        joints: Floats,
        earlier: Floats | None = None,
        begun: Sequence[float] = (),
        rates: Floats | None = None,
    ) -> RecordedPath:
        """Return the path through *q*, with the position of *original* at the times *path_times*.

        Angular velocity and acceleration are central differences of fourth order of the logarithms
        of neighbours: at :math:`r = 0` they are the derivatives of *r*.  Where it equals the
        original path at the original's times, it keeps the derivatives of that, which include the
        motion between the records.

        Args:
            q: orientations, shape ``(n, 4)``.
            path_times: time of each on the original, s, shape ``(n,)``.
            original: the path as planned.
            period: s.
            joints: axis angles for the orientations, rad, unwrapped, shape ``(n, axes)``.
            earlier: axis angles of the three records before; without them the axes were at rest.
            begun: axis velocities at the first record, rad/s, if it takes over from a path that has
                them.
            rates: axis velocities at the records, rad/s, shape ``(n, axes)``; by default
                differences of the angles, which blur what changes within four periods.
        """
        q = align(q)
        given = original.sample(path_times)
        # The original continues a motion before it, and is at rest after its end.
        back = -period * np.array([[2.0], [1.0]])
        turn = back * given.omega_body[0] + 0.5 * back**2 * given.alpha_body[0]
        padded = np.concatenate([multiply(q[0], exp(turn)), q, q[-1:], q[-1:]])
        # Backwards the logarithm has the opposite sign, so each is computed once.
        one, two = (log(multiply(conjugate(padded[:-k]), padded[k:])) for k in (1, 2))
        count = len(q)
        near = (-two[:count], -one[1 : count + 1], one[2 : count + 2], two[2 : count + 2])
        omega = (8.0 * (near[2] - near[1]) - (near[3] - near[0])) / (12.0 * period)
        alpha = (16.0 * (near[1] + near[2]) - near[0] - near[3]) / (12.0 * period**2)
        ahead = {"prepend": path_times[0] - period, "append": path_times[-1] + period}
        is_paced = np.abs(np.diff(path_times, **ahead) / period - 1.0) > _EVEN
        is_other = (angle(q, given.q) > SAME_ANGLE) | is_paced[:-1] | is_paced[1:]
        # A difference reaches two records.
        is_same = np.convolve(is_other, np.ones(5))[2:-2] < 0.5
        omega[is_same], alpha[is_same] = given.omega_body[is_same], given.alpha_body[is_same]
        # It continues the device's motion, and has no velocity where it stands still.
        omega[0], alpha[0] = given.omega_body[0], given.alpha_body[0]
        omega[-1], alpha[-1] = 0.0, 0.0
        if earlier is None:
            earlier = np.repeat(joints[:1], HISTORY, axis=0)
        table: Floats = np.zeros((count, STATE_FLOATS + 2 * joints.shape[1]))
        table[:, :4], table[:, 4:7], table[:, 7:10] = q, omega, alpha
        table[:, 10:13] = given.position
        if rates is None:
            rates = joint_rates(joints, earlier, period)
        if len(begun):
            rates[0] = begun
        table[:, STATE_FLOATS:] = np.concatenate([joints, rates], axis=1)
        velocity = given.velocity * (np.gradient(path_times) / period)[:, None]
        table[:-1, 13:16] = velocity[:-1]
        table[1:-1, 16:19] = (velocity[2:] - velocity[:-2]) / (2.0 * period)
        return cls(period, (count - 1) * period, table, earlier, bool(np.any(is_other)))

    def rows(self, first: int, count: int) -> Floats:
        """Return a copy of rows of the table."""
        return self.table[first : first + count].copy()

    @property
    def joints(self) -> Floats:
        """Axis angles at the records, rad, shape ``(n, axes)``."""
        return joints_of(self.table)

    @property
    def joint_rates(self) -> Floats:
        """Velocities of the axes at the records, rad/s, shape ``(n, axes)``."""
        return rates_of(self.table)

    def joints_before(self, record: int) -> tuple[tuple[float, ...], ...]:
        """Return the axis angles of the three records before one, oldest first."""
        joints = np.concatenate([self.earlier, self.joints])
        return tuple(map(tuple, joints[record : record + HISTORY].tolist()))

    def sample(self, times: Floats) -> PathSamples:
        """Return the path at *times*, in any order; it is constant beyond its ends.

        Raises:
            ValueError: a time is NaN.
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
        found = states_at(table[:, :STATE_FLOATS], times / h, h)
        beyond = (times < 0.0) | (times >= (len(table) - 1) * h)
        found[beyond, 4:10] = found[beyond, 13:] = 0.0
        return found
