"""The motion: a planned path with its certificate, which nothing can change any more."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from orientd.planner.certificate import Certificate
from orientd.planner.differences import HISTORY, Rough
from orientd.planner.limits import Limits
from orientd.planner.path import Path, Samples
from orientd.planner.request import MotionRequest, State
from orientd.planner.summing_up import before
from orientd.planner.table_path import TablePath
from orientd.rotation import Floats

RECORD_FLOATS = 16
"""q (4), omega_body (3), alpha_body (3), position (3), velocity (3): a record in the path ring."""


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A motion that keeps its limits, from hold to hold.

    Attributes:
        id: names it.
        request: what it was made for.
        limits: what it keeps.
        period: path time from one record to the next, which is the device's cycle, s.
        path: orientation and position by path time, which begins at 0.
        start_time: path time of the first keyframe, s; a whole number of periods.
        end_time: path time of the last keyframe, s.
        keyframe_times: path times of all keyframes, s, shape ``(n,)``.
        record_count: number of records; the last one is at rest.
        certificate: what it was checked for.
        rough: the part whose acceleration has steps; ``None`` if there is none.
        first_joints: axis angles it begins at, rad; empty unless it was made for a device's axes.
        last_joints: axis angles it ends at, rad.
        before: the three setpoints before path time 0, as in :class:`State`; ``None`` where the
            device held, or where they are not known.
    """

    id: str
    request: MotionRequest
    limits: Limits
    period: float
    path: Path | TablePath
    start_time: float
    end_time: float
    keyframe_times: Floats
    record_count: int
    certificate: Certificate
    rough: Rough | None = None
    first_joints: tuple[float, ...] = ()
    last_joints: tuple[float, ...] = ()
    before: tuple[Floats, Floats] | None = None

    @property
    def duration(self) -> float:
        """Path time from hold to hold, s."""
        return self.path.duration

    @property
    def start_state(self) -> State:
        """The state it begins in, at path time 0."""
        return replace(self.path.state(0.0), before=self.before)

    @property
    def end_state(self) -> State:
        """The state at the last keyframe, which a successor would continue."""
        return self.path.state(self.end_time)

    def state_at(self, record: int) -> State:
        """Return the state at a record, with the setpoints before it, for a motion to take over.

        The next motion begins in it: its first record is this one.  Before the first record of
        this motion the device was where :attr:`before` says.  The last one holds.

        Raises:
            ValueError: there is no such record.
        """
        if not 0 <= record < self.record_count:
            raise ValueError(f"record must be within 0 to {self.record_count - 1}, got {record}")
        first = max(record - HISTORY, 0)
        samples = self._samples(first, record + 1)
        q, position = samples.q[:-1], samples.position[:-1]
        missing = HISTORY - len(q)
        if missing:
            earlier = before(self.start_state, self.period)
            q = np.concatenate([earlier[0][-missing:], q])
            position = np.concatenate([earlier[1][-missing:], position])
        if record < self.record_count - 1 and self.path.positions.is_held:
            here_q, omega, alpha, place = (part[-1] for part in samples[:4])
            return State(here_q, omega, alpha, place, before=(q, position))
        if record == self.record_count - 1:
            here = State.at_rest(self.path.last, self.path.positions.last)
        else:
            here = self.path.state(self.period * record)
        return replace(here, before=(q, position))

    def _samples(self, first: int, end: int) -> Samples:
        """Return the records from the *first* to the one before *end*."""
        return self.path.sample_in_order(self.period * np.arange(first, end, dtype=np.float64))

    def sample(self, path_times: ArrayLike) -> Samples:
        """Return the motion at *path_times* (s, shape ``(n,)``, any order); held beyond its ends.

        Raises:
            ValueError: *path_times* is not one-dimensional.
        """
        times = np.asarray(path_times, dtype=np.float64)
        if times.ndim != 1:
            raise ValueError(f"path_times must be one-dimensional, got shape {times.shape}")
        return self.path.sample(times)

    def records(self, first: int, count: int) -> Floats:
        """Return records for the path ring, in order of their index.

        Args:
            first: index of the first one; record *k* is at path time ``k * period``.
            count: how many.

        Returns:
            A new C-contiguous array of shape ``(count, RECORD_FLOATS)``.

        Raises:
            ValueError: there are no such records.
        """
        if first < 0 or count < 0 or first + count > self.record_count:
            raise ValueError(
                f"records must be within 0 to {self.record_count}, got {first} to {first + count}"
            )
        samples = self._samples(first, first + count)
        block: Floats = np.empty((count, RECORD_FLOATS))
        column = 0
        for part in samples:
            block[:, column : column + part.shape[1]] = part
            column += part.shape[1]
        return block
