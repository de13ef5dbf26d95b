"""A motion as its records tell it: all that is needed to feed, leave, measure and continue it.

Whoever planned a motion can work out every record of it; everybody else has the records.  Between
two records the path is that of the servo (:mod:`orientd.servo.path.segment`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from orientd.driver import Vector3
from orientd.model import Limits
from orientd.planner.state import State
from orientd.rotation import Floats
from orientd.stream import JOINTS, PATH_FLOATS

HISTORY = 3
"""Setpoints that a third difference reaches back to."""

_POSE_FLOATS = PATH_FLOATS - 2 * JOINTS
STATE_FLOATS = _POSE_FLOATS + 3
"""What the path ring has of the pose, q (4), omega_body (3), alpha_body (3), position (3) and
velocity (3), and the acceleration of the position (3)."""


_ON_RECORD = 1e-6
"""Share of a period within which an instant is that of a record."""

Joints = tuple[float, ...]
"""Angles of a device's axes, rad."""


@dataclass(frozen=True, slots=True, eq=False)
class MotionFacts:
    """What there is to know of a motion besides its records.

    Attributes:
        id: identifies it.
        name: what people call it; empty where they do not.
        period: path time from one record to the next, s.
        record_count: number of records; the last one is at rest.
        duration: path time from hold to hold, s.
        start_time: path time of the first keyframe, s.
        end_time: path time of the last keyframe, s.
        last_passed: path time of the last keyframe before that one; 0 where there is none.
        corner: of a motion that is blended with the one before, the path time at which it is
            nearest to the end of that, s, and how near, rad.
        limits: what it keeps.
        brake_rate: share of full speed by which it may be slowed down in a second, 1/s.
        stop_time: how long a stop on its path from full speed takes at the most, s.
        omega_start: angular velocity asked for at the first keyframe, body frame, rad/s.
        omega_end: the same at the last keyframe.
        device_options: of the device's driver.
        first_joints: axis angles it begins at, rad; empty unless it was made for a device's axes.
        last_joints: axis angles it ends at, rad.
        earlier: states of the three records before the first, shape ``(3, STATE_FLOATS + 2 axes)``;
            orientations, positions and axis angles of them count.
    """

    id: str
    name: str
    period: float
    record_count: int
    duration: float
    start_time: float
    end_time: float
    last_passed: float
    limits: Limits
    brake_rate: float
    stop_time: float
    omega_start: Vector3 | None
    omega_end: Vector3 | None
    device_options: Mapping[str, Any]
    first_joints: Joints
    last_joints: Joints
    earlier: Floats
    corner: tuple[float, float] | None = None


class RecordedMotion:
    """A motion, and those of its records that are at hand.

    Attributes:
        facts: what there is to know of it.
    """

    def __init__(self, facts: MotionFacts, rows: Floats, first: int = 0) -> None:
        """Take records.

        Args:
            facts: of the motion.
            rows: of each state, axis angles and their velocities, shape ``(n, STATE_FLOATS +
                2 axes)``.
            first: which record the first row is.
        """
        self.facts = facts
        self._rows = rows
        self._first = first

    @property
    def at_hand(self) -> tuple[int, int]:
        """The first record that is at hand, and the one after the last."""
        return self._first, self._first + len(self._rows)

    @property
    def last_record(self) -> int:
        """The record at which it ends."""
        return self.facts.record_count - 1

    def rows(self, first: int, count: int) -> Floats:
        """Return state, axis angles and their velocities of records.

        Args:
            first: may be down to -3: before the first record the device was where it came from.
            count: how many.

        Raises:
            ValueError: there are no such records, or they are not at hand.
        """
        begin, end = self.at_hand
        if first < 0 and begin == 0 and first >= -HISTORY:
            earlier = self.facts.earlier[HISTORY + first : HISTORY + min(first + count, 0)]
            rest = count - len(earlier)
            return np.concatenate([earlier, self.rows(0, rest)]) if rest else earlier
        if count < 0 or first < begin or first + count > end:
            raise ValueError(
                f"records must be within {begin} to {end}, got {first} to {first + count}"
            )
        return self._read(first, count)

    def _read(self, first: int, count: int) -> Floats:
        """Return rows that are at hand."""
        return self._rows[first - self._first : first - self._first + count]

    def records(self, first: int, count: int) -> Floats:
        """Return records for the path ring, as many of *count* as are at hand.

        Returns:
            Shape ``(n, PATH_FLOATS)``.
        """
        return ring_records(self.rows(first, min(count, self.at_hand[1] - first)))

    def rows_at(self, records: np.ndarray[Any, np.dtype[np.intp]]) -> Floats:
        """Return the rows of some records, all of them at hand."""
        first = int(records.min())
        rows: Floats = self.rows(first, int(records.max()) + 1 - first)[records - first]
        return rows

    def state_at(self, record: int) -> State:
        """Return the state at a record, with the setpoints before it, for a motion to take over.

        Raises:
            ValueError: there is no such record, or it is not at hand.
        """
        rows = self.rows(record - HISTORY, HISTORY + 1)
        here, before = rows[-1].copy(), rows[:-1].copy()
        turning, linear = (here[:4], here[4:7], here[7:10]), (here[10:13], here[13:16], here[16:19])
        return State(*turning, *linear, before=(before[:, :4], before[:, 10:13]))

    def joints_at(self, record: int) -> Joints:
        """Return the axis angles planned at a record, rad; none where it knows of none."""
        return tuple(joints_of(self.rows(record, 1))[0].tolist())

    def joint_rates_at(self, record: int) -> Joints:
        """Return the velocities of the axes planned at a record, rad/s; none if it has none."""
        row = self.rows(record, 1)
        return tuple(row[0, STATE_FLOATS + joints_of(row).shape[1] :].tolist())

    def joints_before(self, record: int) -> tuple[Joints, ...]:
        """Return the axis angles of the three records before one, the oldest first."""
        joints = joints_of(self.rows(record - HISTORY, HISTORY))
        return tuple(map(tuple, joints.tolist())) if joints.shape[1] else ()

    def orientations(self, times: Floats) -> Floats:
        """Return the orientations at path *times* that are at hand, shape ``(n, 4)``.

        Times beyond the records at hand are those of the nearest one.
        """
        begin, end = self.at_hand
        where = np.clip(times / self.facts.period, begin, end - 1.0)
        first = int(where.min())
        rows = self.rows(first, int(np.ceil(where.max())) + 1 - first)
        return states_at(rows[:, :10], where - first, self.facts.period)[:, :4]


def joints_of(rows: Floats) -> Floats:
    """Return the axis angles of rows, rad, shape ``(n, axes)``."""
    axes = (rows.shape[1] - STATE_FLOATS) // 2
    joints: Floats = rows[:, STATE_FLOATS : STATE_FLOATS + axes]
    return joints


def ring_records(rows: Floats) -> Floats:
    """Return the records of the path ring that rows are; NaN for the axes that there are not."""
    axes = joints_of(rows).shape[1]
    records: Floats = np.full((len(rows), PATH_FLOATS), np.nan)
    records[:, :_POSE_FLOATS] = rows[:, :_POSE_FLOATS]
    records[:, _POSE_FLOATS : _POSE_FLOATS + axes] = joints_of(rows)
    rates = PATH_FLOATS - JOINTS
    records[:, rates : rates + axes] = rows[:, STATE_FLOATS + axes :]
    return records


def joint_rates(joints: Floats, earlier: Floats, period: float) -> Floats:
    """Return the velocities of axes at records, by central differences of the fourth order.

    Args:
        joints: angles at the records of a whole motion, rad, shape ``(n, axes)``; held after it.
        earlier: those of two or more records before, the oldest first; the axes begin at rest if
            all of them are the same.
        period: from each record to the next, s.

    Returns:
        rad/s, shape ``(n, axes)``; zero at the last record.
    """
    padded = np.concatenate([earlier[-2:], joints, joints[-1:], joints[-1:]])
    one, two = padded[3:-1] - padded[1:-3], padded[4:] - padded[:-4]
    rates: Floats = (8.0 * one - two) / (12.0 * period)
    rates[-1] = 0.0
    if not np.ptp(np.concatenate([earlier, joints[:1]]), axis=0).any():
        rates[0] = 0.0
    return rates


def states_at(rows: Floats, where: Floats, period: float) -> Floats:
    """Return the states at places among consecutive records, those beyond them at the nearest one.

    Args:
        rows: the records, as :func:`states_between` takes them.
        where: whole numbers are records, those between them are between two.
        period: from each record to the next, s.
    """
    where = np.clip(where, 0.0, len(rows) - 1.0)
    nearest = np.rint(where)
    where = np.where(np.abs(where - nearest) < _ON_RECORD, nearest, where)
    index = where.astype(np.int64)
    found: Floats = rows[index]
    inner = np.flatnonzero(where > index)
    if len(inner):
        here = index[inner]
        shares = where[inner] - here
        found[inner] = states_between(rows[here], rows[here + 1], period, shares)
    return found


def states_between(here: Floats, there: Floats, period: Floats | float, shares: Floats) -> Floats:
    """Return the states that the servo takes between some records and those after them.

    Args:
        here: records: orientation and angular velocity, and angular acceleration, position and
            velocity, and acceleration as far as they are known, shape ``(n, 7)``, ``(n, 10)``,
            ``(n, 16)`` or ``(n, 19)``.  Without the angular acceleration, steps of it are not seen.
        there: those after them.
        period: from each to the next, s, one for all or shape ``(n,)``.
        shares: in [0, 1], shape ``(n,)``.
    """
    # The daemon measures recorded motions, and needs the kernels off the records only.
    from orientd.kernels import between

    found = np.empty(here.shape)
    between(
        np.ascontiguousarray(here),
        np.ascontiguousarray(there),
        np.broadcast_to(np.asarray(period, dtype=np.float64), len(here)).copy(),
        np.ascontiguousarray(shares),
        found,
    )
    return found
