"""The motion: a planned path with its certificate, immutable."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from orientd.curves.keyframes import is_same
from orientd.driver import Vector3
from orientd.errors import OrientdError
from orientd.keep_out import KeepOut
from orientd.model.cones import written_cone
from orientd.model.limits import Limits
from orientd.model.request import MotionRequest
from orientd.planner.certify.certificate import Certificate
from orientd.planner.certify.summary import before
from orientd.planner.facts import HISTORY, MotionFacts
from orientd.planner.path import Path, PathSamples, RecordedPath
from orientd.planner.recorded import STATE_FLOATS, RecordedMotion, joints_of, ring_records
from orientd.planner.saving import write_archive
from orientd.planner.state import State
from orientd.rotation import Floats, to_scipy

if TYPE_CHECKING:
    from pathlib import Path as FilePath

    from scipy.spatial.transform import Rotation

_SAME = 1e-9
"""Tolerance of equal times, s."""

_COMPARED = (
    *("request", "limits", "period", "start_time", "end_time", "keyframe_times", "record_count"),
    *("certificate", "first_joints", "last_joints", "before"),
)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A motion that keeps its limits, from rest to rest.

    Two motions are equal if they have the same request, records and certificate, whatever their
    identifiers.

    Attributes:
        id: its identifier.
        request: the request that it fulfils.
        limits: the limits that it keeps.
        period: path time between two records, which is the device's cycle, s.
        path: orientation and position by path time, which begins at 0.
        start_time: path time of the first keyframe, s; a whole number of periods.
        end_time: path time of the last keyframe, s.
        keyframe_times: path times of all keyframes, s, shape ``(n,)``.
        record_count: number of records; the last one is at rest.
        certificate: the checks that it passed.
        first_joints: initial axis angles, rad; empty unless planned for a device's axes.
        last_joints: final axis angles, rad.
        before: the three setpoints before path time 0, as in :class:`State`; ``None`` if the
            device held, or if they are unknown.
        corner: as in :class:`MotionFacts`.
        joined: path time at which a blend with the previous motion ends, s.
        keep_out: the cones that it stays out of, of the device too, as they are when it begins.
    """

    id: str
    request: MotionRequest
    limits: Limits
    period: float
    path: Path | RecordedPath
    start_time: float
    end_time: float
    keyframe_times: Floats
    record_count: int
    certificate: Certificate
    first_joints: tuple[float, ...] = ()
    last_joints: tuple[float, ...] = ()
    before: tuple[Floats, Floats] | None = None
    corner: tuple[float, float] | None = None
    joined: float = 0.0
    keep_out: tuple[KeepOut, ...] = ()

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Motion):
            return NotImplemented
        return all(
            is_same(getattr(self, name), getattr(other, name)) for name in _COMPARED
        ) and np.array_equal(self.rows(0, self.record_count), other.rows(0, other.record_count))

    def __hash__(self) -> int:
        return hash((self.request, self.period, self.record_count))

    def __repr__(self) -> str:
        found = self.certificate
        return (
            f"<Motion {self.id}: {self.request.method} through {len(self.request.keyframes)} "
            f"keyframes, {self.duration:.6g} s at {1.0 / self.period:.6g} Hz, peaks "
            f"{found.peak_velocity.value:.4g} rad/s, {found.peak_acceleration.value:.4g} rad/s^2, "
            f"{found.peak_jerk.value:.4g} rad/s^3>"
        )

    def __call__(self, path_times: ArrayLike) -> Rotation:
        """Return the orientations at *path_times* as a ``Rotation`` of SciPy; held beyond.

        Raises:
            OrientdError: SciPy is not installed.
        """
        times = np.asarray(path_times, dtype=np.float64)
        return to_scipy(self.sample(times.reshape(-1)).q.reshape(*times.shape, 4))

    def plot(self, *_: object, **__: object) -> None:
        """Say which function draws a motion; version 0.2 drew it here.

        Raises:
            OrientdError: always.
        """
        raise OrientdError("motion.plot(path) is now orientd.plots.draw(motion, path)")

    def save(self, path: str | FilePath) -> None:
        """Write the motion with its certificate to a file that :func:`orientd.load_motion` reads.

        Raises:
            OrientdError: the file cannot be written, or its name has the suffix of another format.
        """
        request = self.request
        header = {
            "id": self.id,
            "request": {
                **request.given(),
                "keyframes": [asdict(keyframe) for keyframe in request.keyframes],
                "limits": None if request.limits is None else asdict(request.limits),
                "keep_out": list(map(written_cone, request.keep_out)),
            },
            "limits": asdict(self.limits),
            "period": self.period,
            "duration": self.duration,
            "start_time": self.start_time,
            "end_time": self.end_time,
            "certificate": asdict(self.certificate),
            "first_joints": self.first_joints,
            "last_joints": self.last_joints,
            "axes": len(self.first_joints),
            "keep_out": list(map(written_cone, self.keep_out)),
        }
        arrays: dict[str, Floats] = {
            "rows": self.rows(0, self.record_count),
            "keyframe_times": self.keyframe_times,
            "earlier": np.array(self.path.joints_before(0), dtype=np.float64),
        }
        if self.before is not None:
            arrays["q_before"], arrays["position_before"] = self.before
        write_archive(path, header, arrays)

    @property
    def duration(self) -> float:
        """Path time from start to finish, s."""
        return self.path.duration

    @property
    def start_state(self) -> State:
        """The initial state, at path time 0."""
        return replace(self.path.state(0.0), before=self.before)

    @property
    def facts(self) -> MotionFacts:
        """The properties of the motion apart from its records."""
        request, certificate = self.request, self.certificate
        passed = self.keyframe_times[self.keyframe_times < self.end_time - _SAME]
        return MotionFacts(
            id=self.id,
            name=request.name,
            period=self.period,
            record_count=self.record_count,
            duration=self.duration,
            start_time=self.start_time,
            end_time=self.end_time,
            last_passed=max(self.joined, *passed.tolist()) if len(passed) else self.joined,
            limits=self.limits,
            brake_rate=certificate.brake_rate,
            stop_time=certificate.stop_time,
            omega_start=_vector(request.omega_start),
            omega_end=_vector(request.omega_end),
            device_options=request.driver_options,
            first_joints=self.first_joints,
            last_joints=self.last_joints,
            end_state=tuple(self.path.state(self.end_time).row.tolist()),
            corner=self.corner,
        )

    def recorded(self, first: int = -HISTORY, end: int | None = None) -> RecordedMotion:
        """Return the motion in the form of its records, with those from *first* to *end* at hand.

        Three records before record 0 hold the previous setpoints of the device.  Only their
        orientations, positions and axis angles count.
        """
        end = self.record_count if end is None else end
        rows = self.rows(max(first, 0), max(end, 0) - max(first, 0))
        if first < 0:
            rows = np.concatenate([self._earlier()[first:], rows])
        return RecordedMotion(self.facts, rows, first)

    def noted(self, *notes: str) -> Motion:
        """Return the same motion with more notes in its certificate, each of them once."""
        if not notes:
            return self
        once = dict.fromkeys((*self.certificate.notes, *notes))
        certificate = replace(self.certificate, notes=tuple(once))
        return replace(self, certificate=certificate)

    def state_at(self, record: int) -> State:
        """Return the state at a record; see :meth:`.RecordedMotion.state_at`.

        Raises:
            ValueError: the record does not exist.
        """
        if not 0 <= record < self.record_count:
            raise ValueError(f"record must be within 0 to {self.record_count - 1}, got {record}")
        return self.recorded(record - HISTORY, record + 1).state_at(record)

    def _earlier(self) -> Floats:
        """Return the rows of the three records before the first."""
        q, position = before(self.start_state, self.period)
        joints = np.array(self.path.joints_before(0), dtype=np.float64).reshape(HISTORY, -1)
        rows = np.zeros((HISTORY, STATE_FLOATS + 2 * joints.shape[1]))
        rows[:, :4], rows[:, 10:13] = q, position
        joints_of(rows)[:] = joints
        return rows

    def sample(self, path_times: ArrayLike) -> PathSamples:
        """Return the motion at *path_times* (s, shape ``(n,)``, any order); held beyond its ends.

        Raises:
            ValueError: *path_times* is not one-dimensional.
        """
        times = np.asarray(path_times, dtype=np.float64)
        if times.ndim != 1:
            raise ValueError(f"path_times must be one-dimensional, got shape {times.shape}")
        return self.path.sample(times)

    def rows(self, first: int, count: int) -> Floats:
        """Return state, axis angles and their velocities of records, in order of their index.

        Args:
            first: index of the first one; record *k* is at path time ``k * period``.
            count: number of records.

        Returns:
            A new C-contiguous array of shape ``(count, STATE_FLOATS + 2 axes)``.

        Raises:
            ValueError: the records do not exist.
        """
        end = first + count
        if first < 0 or count < 0 or end > self.record_count:
            raise ValueError(
                f"records must be within 0 to {self.record_count}, got {first} to {end}"
            )
        path = self.path
        if isinstance(path, RecordedPath):
            return path.rows(first, count)
        times = self.period * np.arange(first, end, dtype=np.float64)
        rows: Floats = np.zeros((count, STATE_FLOATS))
        np.concatenate(path.sample(times), axis=1, out=rows[:, : STATE_FLOATS - 3])
        rows[:, STATE_FLOATS - 3 :] = path.positions.sample(times)[2]
        if count and end == self.record_count:
            rows[-1] = 0.0
            rows[-1, :4], rows[-1, 10:13] = path.last, path.positions.last
        return rows

    def records(self, first: int, count: int) -> Floats:
        """Return records in the layout of the path ring; see :meth:`rows`.

        Returns:
            A new C-contiguous array of shape ``(count, PATH_FLOATS)``.
        """
        return ring_records(self.rows(first, count))


def _vector(omega: Floats | None) -> Vector3 | None:
    if omega is None:
        return None
    x, y, z = omega.tolist()
    return x, y, z
