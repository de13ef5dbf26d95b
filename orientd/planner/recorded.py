"""A motion in the form of its records: enough to leave it and to continue it.

Only the planner of a motion can compute its records; all others use the records.  Between two
records the path is that of the servo (:mod:`orientd.servo.path.segment`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from orientd.driver import Joints
from orientd.kernels import between
from orientd.planner.facts import HISTORY, MotionFacts
from orientd.planner.state import State
from orientd.rotation import Floats
from orientd.stream.records import JOINTS, PATH_FLOATS

_POSE_FLOATS = PATH_FLOATS - 2 * JOINTS
STATE_FLOATS = _POSE_FLOATS + 3
"""Numbers of a state: the pose columns of the path ring, and the acceleration of the position.

The columns are q (4), omega_body (3), alpha_body (3), position (3) and velocity (3).
"""

_ON_RECORD = 1e-6
"""Tolerance for a time at a record, as a share of a period."""


class RecordedMotion:
    """A motion with the records that are at hand.

    Attributes:
        facts: its properties.
    """

    def __init__(self, facts: MotionFacts, rows: Floats, first: int = -HISTORY) -> None:
        """Take records.

        Args:
            facts: of the motion.
            rows: of each state, axis angles and their velocities, shape ``(n, STATE_FLOATS +
                2 axes)``.
            first: which record the first row is; before record 0 the device was where it came from.
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
        """The last record."""
        return self.facts.record_count - 1

    @property
    def end_state(self) -> State:
        """The state at the last keyframe."""
        return State.of_row(np.array(self.facts.end_state))

    def rows(self, first: int, count: int) -> Floats:
        """Return state, axis angles and their velocities of records.

        Args:
            first: down to -3, if these are at hand.
            count: how many.

        Raises:
            ValueError: the records do not exist, or are not at hand.
        """
        begin, end = self.at_hand
        if count < 0 or first < begin or first + count > end:
            raise ValueError(
                f"records must be within {begin} to {end}, got {first} to {first + count}"
            )
        return self._rows[first - begin : first - begin + count]

    def packed(self) -> bytes:
        """Return the records at hand, each a :data:`.MOTION_RECORD`."""
        acceleration = self._rows[:, _POSE_FLOATS:STATE_FLOATS]
        return np.concatenate([ring_records(self._rows), acceleration], axis=1).tobytes()

    def rows_at(self, records: np.ndarray[Any, np.dtype[np.intp]]) -> Floats:
        """Return the rows of some records, all of them at hand."""
        first = int(records.min())
        rows: Floats = self.rows(first, int(records.max()) + 1 - first)[records - first]
        return rows

    def state_at(self, record: int) -> State:
        """Return the state at a record, with the setpoints before it, for a motion to take over.

        Raises:
            ValueError: the record does not exist, or is not at hand.
        """
        return _state_of(self.rows(record - HISTORY, HISTORY + 1))

    def joints_at(self, record: int) -> Joints:
        """Return the planned axis angles at a record, rad; empty if the motion has none."""
        return tuple(joints_of(self.rows(record, 1))[0].tolist())

    def joint_rates_at(self, record: int) -> Joints:
        """Return the velocities of the axes planned at a record, rad/s; none if it has none."""
        return tuple(rates_of(self.rows(record, 1))[0].tolist())

    def joints_before(self, record: int) -> tuple[Joints, ...]:
        """Return the axis angles of the three records before one, oldest first."""
        joints = joints_of(self.rows(record - HISTORY, HISTORY))
        return tuple(map(tuple, joints.tolist())) if joints.shape[1] else ()


class Start(NamedTuple):
    """Where a motion begins.

    Attributes:
        start: where the device is commanded to be.
        joints: its axis angles there, rad.
        before: axis angles planned for the cycles before, if it moves.
        rates: velocities of the axes planned there, rad/s, if it moves.
    """

    start: State
    joints: Joints
    before: Sequence[Joints]
    rates: Joints


def start_of(rows: Floats) -> Start:
    """Return the last of some rows as the start of a motion.

    The three rows before it say where the device comes from.  One row alone is at rest.
    """
    start, (*before, joints) = _state_of(rows), map(tuple, joints_of(rows).tolist())
    if not joints or start.is_at_rest:
        return Start(start, joints, (), ())
    return Start(start, joints, before, tuple(rates_of(rows)[-1].tolist()))


def rows_of(records: bytes) -> Floats:
    """Return records as rows; each record is a :data:`.MOTION_RECORD`.

    Returns:
        Shape ``(n, STATE_FLOATS + 2 axes)``.
    """
    table = np.frombuffer(records).reshape(-1, PATH_FLOATS + 3)
    rates = PATH_FLOATS - JOINTS
    axes = int(np.count_nonzero(~np.isnan(table[0, _POSE_FLOATS:rates])))
    parts = (
        (0, _POSE_FLOATS),
        (PATH_FLOATS, None),
        (_POSE_FLOATS, _POSE_FLOATS + axes),
        (rates, rates + axes),
    )
    return np.concatenate([table[:, begin:end] for begin, end in parts], axis=1)


def _state_of(rows: Floats) -> State:
    here, before = rows[-1, :STATE_FLOATS].copy(), rows[:-1].copy()
    came = (before[:, :4], before[:, 10:13]) if len(before) else None
    return State.of_row(here, came)


def joints_of(rows: Floats) -> Floats:
    """Return the axis angles of rows, rad, shape ``(n, axes)``."""
    axes = (rows.shape[1] - STATE_FLOATS) // 2
    joints: Floats = rows[:, STATE_FLOATS : STATE_FLOATS + axes]
    return joints


def rates_of(rows: Floats) -> Floats:
    """Return the velocities of the axes of rows, rad/s, shape ``(n, axes)``."""
    rates: Floats = rows[:, STATE_FLOATS + joints_of(rows).shape[1] :]
    return rates


def ring_records(rows: Floats) -> Floats:
    """Return rows in the layout of the path ring; NaN for missing axes."""
    axes = joints_of(rows).shape[1]
    records: Floats = np.full((len(rows), PATH_FLOATS), np.nan)
    records[:, :_POSE_FLOATS] = rows[:, :_POSE_FLOATS]
    records[:, _POSE_FLOATS : _POSE_FLOATS + axes] = joints_of(rows)
    rates = PATH_FLOATS - JOINTS
    records[:, rates : rates + axes] = rates_of(rows)
    return records


def joint_rates(joints: Floats, earlier: Floats, period: float) -> Floats:
    """Return the axis velocities at records, by central differences of the fourth order.

    Args:
        joints: angles at the records of a whole motion, rad, shape ``(n, axes)``; constant after
            it.
        earlier: angles of two or more records before, oldest first; the axes begin at rest if all
            of them are equal.
        period: time between two records, s.

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
    """Return the states at places among consecutive records, or at the nearest one beyond them.

    Args:
        rows: the records, as in :func:`states_between`.
        where: whole numbers are records, other numbers lie between two.
        period: time between two records, s.
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
    """Return the states of the servo's path between records and the next ones.

    Args:
        here: records: orientation and angular velocity, optionally followed by angular
            acceleration, position and velocity, and acceleration, shape ``(n, 7)``, ``(n, 10)``,
            ``(n, 16)`` or ``(n, 19)``.  Without the angular acceleration, its steps are not
            detected.
        there: the records after them.
        period: time between the two, s, one for all or shape ``(n,)``.
        shares: in [0, 1], shape ``(n,)``.
    """
    found = np.empty(here.shape)
    between(
        np.ascontiguousarray(here),
        np.ascontiguousarray(there),
        np.broadcast_to(np.asarray(period, dtype=np.float64), len(here)).copy(),
        np.ascontiguousarray(shares),
        found,
    )
    return found
