r"""A path that is known at its records only, as a driver may have shaped it.

Around the record :math:`q_k` the path is :math:`q_k \exp(r)`.  At :math:`r = 0` the derivatives of
the rotation vector are angular velocity and acceleration in body components, so both come from
central differences of the logarithms of the neighbours, of fourth order in the period.  Between two
records it is the path that the servo takes (:mod:`orientd.servo.path.segment`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orientd.curves import Indices
from orientd.planner.path.path import Path, PathSamples
from orientd.planner.path.position import PositionPath
from orientd.planner.recorded import HISTORY, states_between
from orientd.planner.request import State
from orientd.rotation import (
    Floats,
    align,
    angle,
    conjugate,
    exp,
    log,
    multiply,
)

SAME_ANGLE = 1e-9
"""How far two paths may be apart to be the same one, rad."""

_ON_RECORD = 1e-6
"""Share of a period within which an instant is that of a record."""


@dataclass(frozen=True, slots=True, eq=False)
class TablePath:
    """Orientations on a uniform grid of path time, held before and after.

    Attributes:
        period: s.
        q: orientations, signs continuous, shape ``(n, 4)``.
        omega: angular velocities in the body frame, rad/s, shape ``(n, 3)``.
        alpha: their derivatives, rad/s^2, shape ``(n, 3)``.
        positions: what the position does by *path_times*.
        path_times: how far along the positions each record is, s, shape ``(n,)``.
        joints: axis angles that make the orientations, rad, unwrapped, shape ``(n, axes)``.
        earlier: axis angles of the three records before the first, rad, shape ``(3, axes)``.
    """

    period: float
    q: Floats
    omega: Floats
    alpha: Floats
    positions: PositionPath
    path_times: Floats
    joints: Floats
    earlier: Floats

    @classmethod
    def of(
        cls,
        q: Floats,
        path_times: Floats,
        original: Path,
        period: float,
        joints: Floats,
        earlier: Floats | None = None,
    ) -> TablePath:
        """Return the path through *q*, with the position of *original* at the times *path_times*.

        Where it is the original's path, in the original's time, it keeps the derivatives of that,
        which know what happens between the records.  The axes were at rest before it unless
        *earlier* says otherwise.
        """
        q = align(q)
        given = original.sample(path_times)
        # Before it, what the original goes on from; at rest after, where its motion ends.
        back = -period * np.array([[2.0], [1.0]])
        turn = back * given.omega_body[0] + 0.5 * back**2 * given.alpha_body[0]
        padded = np.concatenate([multiply(q[0], exp(turn)), q, q[-1:], q[-1:]])
        # The way back is the way there with the other sign, so each is calculated once.
        one, two = (log(multiply(conjugate(padded[:-k]), padded[k:])) for k in (1, 2))
        count = len(q)
        near = (-two[:count], -one[1 : count + 1], one[2 : count + 2], two[2 : count + 2])
        omega = (8.0 * (near[2] - near[1]) - (near[3] - near[0])) / (12.0 * period)
        alpha = (16.0 * (near[1] + near[2]) - near[0] - near[3]) / (12.0 * period**2)
        pace = (
            np.diff(path_times, prepend=path_times[0] - period, append=path_times[-1] + period)
            / period
        )
        is_paced = np.abs(pace - 1.0) > _ON_RECORD
        is_other = (angle(q, given.q) > SAME_ANGLE) | is_paced[:-1] | is_paced[1:]
        # A difference reaches two records far.
        is_same = np.convolve(is_other, np.ones(5))[2:-2] < 0.5
        omega[is_same], alpha[is_same] = given.omega_body[is_same], given.alpha_body[is_same]
        # It takes over from what the device does, and held means held: no velocity where it stands.
        omega[0], alpha[0] = given.omega_body[0], given.alpha_body[0]
        omega[-1], alpha[-1] = 0.0, 0.0
        if earlier is None:
            earlier = np.repeat(joints[:1], HISTORY, axis=0)
        return cls(period, q, omega, alpha, original.positions, path_times, joints, earlier)

    @property
    def duration(self) -> float:
        """Path time from the first record to the last, s."""
        return (len(self.q) - 1) * self.period

    @property
    def last(self) -> Floats:
        """Orientation after the end."""
        return np.asarray(self.q[-1], dtype=np.float64)

    def joints_at(self, record: int) -> tuple[float, ...]:
        """Return the axis angles planned at a record, rad, held beyond the first and the last."""
        return tuple(self.joints[min(max(record, 0), len(self.joints) - 1)].tolist())

    def joints_before(self, record: int) -> tuple[tuple[float, ...], ...]:
        """Return the axis angles of the records before *record*, the oldest first.

        As many as a third difference reaches back to, which is what :meth:`.Driver.shape` wants of
        a motion that takes over from this one at that record.
        """
        return tuple(
            self.joints_at(at) if at >= 0 else tuple(self.earlier[at].tolist())
            for at in range(record - HISTORY, record)
        )

    def farthest_from(self, keys: Floats, times: Floats) -> float:
        """Return the largest angle between *keys* and the path at *times*, rad."""
        return float(np.max(angle(self.sample(times).q, keys)))

    def sample(self, times: Floats) -> PathSamples:
        """Return the path at *times*, in any order; beyond its ends it is held."""
        where, index, u = on_grid(times, self.period, len(self.q))
        q, omega, alpha = self.q[index], self.omega[index], self.alpha[index]
        inner = np.flatnonzero(u > 0.0)
        rows = np.concatenate([self.q, self.omega, self.alpha], axis=1)
        here, there = rows[index[inner]], rows[index[inner] + 1]
        states = states_between(here, there, self.period, u[inner])
        q[inner], omega[inner], alpha[inner] = np.split(states, [4, 7], axis=1)
        position, velocity = self._position(where)
        return PathSamples(q, omega, alpha, position, velocity)

    sample_in_order = sample

    def state(self, time: float) -> State:
        """Return the state at *time*."""
        times = np.array([time], dtype=np.float64)
        sample = self.sample(times)
        return State(
            sample.q[0],
            sample.omega_body[0],
            sample.alpha_body[0],
            sample.position[0],
            sample.velocity[0],
            self.push(times)[0],
        )

    def push(self, times: Floats) -> Floats:
        """Return the accelerations of the position at *times*, from velocities a period apart."""
        is_inside = (times >= self.period) & (times < self.duration)
        after, before = self.sample(times + self.period), self.sample(times - self.period)
        change = (after.velocity - before.velocity) / (2.0 * self.period)
        return np.where(is_inside[:, None], change, 0.0)

    def _position(self, where: Floats) -> tuple[Floats, Floats]:
        grid = np.arange(len(self.q), dtype=np.float64)
        position, velocity = self.positions.sample(np.interp(where, grid, self.path_times))
        pace = np.gradient(self.path_times) / self.period
        return position, velocity * np.interp(where, grid, pace)[:, None]


def on_grid(times: Floats, period: float, count: int) -> tuple[Floats, Indices, Floats]:
    """Return where *times* are among records: in records, the one before, and the share beyond.

    Times before the first record are at it, those after the last of *count* at that.
    """
    where = np.clip(times / period, 0.0, count - 1.0)
    nearest = np.rint(where)
    where = np.where(np.abs(where - nearest) < _ON_RECORD, nearest, where)
    index = where.astype(np.int64)
    return where, index, where - index
