"""Planned orientations of a recording, and where on the path each cycle was."""

from __future__ import annotations

import numpy as np

from orientd import rotation
from orientd.planner.recorded import states_between
from orientd.protocol import control_pb2 as pb
from orientd.recorder.columns import Table
from orientd.recorder.reader import Recording
from orientd.rotation import Floats


def planned_orientations(recording: Recording, device: str) -> tuple[Floats, Floats]:
    """Return path time and planned orientation of every cycle of *device*.

    The servo records the orientation of the path that it follows.  A recording of an earlier
    version lacks it: the orientation is then interpolated between the samples of the path in the
    event of the motion, up to 50 a second.

    Returns:
        Path times, s, shape ``(n,)``, NaN without the event of the motion, and orientations
        ``(w, x, y, z)``, shape ``(n, 4)``, NaN without a path.
    """
    cycles = recording.cycles[device]
    times: Floats = np.full(len(cycles), np.nan)
    planned: Floats = cycles["planned_q"].copy()
    is_recorded = np.isfinite(planned[:, 0])
    period = 1.0 / recording.rate_hz(device)
    for event in recording.events:
        if event.device != device or not event.samples:
            continue
        rows = np.flatnonzero(
            (cycles["motion"] == event.motion_number)
            & (cycles["deadline_ns"] >= event.time_ns - _EARLY_NS)
        )
        if len(rows):
            first = _first_index(event, cycles[rows], period)
            times[rows] = _path_times(cycles[rows], first, period)
            earlier = rows[~is_recorded[rows]]
            planned[earlier] = _path(event, times[earlier])
    return times, planned


_EARLY_NS = 5_000_000_000
"""The event of a motion follows its first cycle by less.  A restart counts motions from 1."""


def _path_times(cycles: Table, first: int, period: float) -> Floats:
    """Return the path time of each cycle of one motion, s."""
    records: Floats = cycles["path_index"] - first + cycles["path_fraction"]
    return records * period


def _first_index(event: pb.Event, cycles: Table, period: float) -> int:
    """Return the path index of a motion's first record.

    The event of a queued motion does not have it.  Its first cycle is at that record or at the one
    after it.  The index with the path nearer to the setpoints is taken.
    """
    if event.HasField("path_index"):
        return event.path_index
    here = int(cycles["path_index"][0])

    def distance(first: int) -> float:
        path = _path(event, _path_times(cycles, first, period))
        return float(np.median(rotation.angle(path, cycles["sent_q"])))

    return min((here, here - 1), key=distance)


def _path(event: pb.Event, times: Floats) -> Floats:
    """Return the orientations of a motion at path times."""
    knots = np.array([sample.path_time for sample in event.samples])
    samples = [(sample.q, sample.omega_body) for sample in event.samples]
    rows = np.array([[q.w, q.x, q.y, q.z, omega.x, omega.y, omega.z] for q, omega in samples])
    times = np.clip(times, knots[0], knots[-1])
    span = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(knots) - 2)
    length = knots[span + 1] - knots[span]
    u = (times - knots[span]) / length
    return states_between(rows[span], rows[span + 1], length, u)[:, :4]


def marks(recording: Recording, device: str) -> list[tuple[int, str]]:
    """Return the events that a picture shows, as times (ns, clock of the cycles) and names."""
    return [
        (event.time_ns, _SHOWN[event.kind])
        for event in recording.events
        if event.device == device and event.kind in _SHOWN
    ]


_SHOWN = {
    pb.EVENT_KIND_MOTION_STARTED: "started",
    pb.EVENT_KIND_MOTION_DONE: "done",
    pb.EVENT_KIND_MOTION_PASSED: "passed",
    pb.EVENT_KIND_MOTION_STOPPED: "stopped",
    pb.EVENT_KIND_MOTION_REPLACED: "replaced",
    pb.EVENT_KIND_FAULT: "FAULT",
    pb.EVENT_KIND_SERVO_DIED: "SERVO DIED",
}
