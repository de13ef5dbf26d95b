"""What a motion was like, measured from what was sent: lateness, rates, errors to the plan.

Nothing here is taken over from the plan: rates are the backward differences of the orientations
sent, as a device would compute them, and the plan only says what they are compared with.  Blocks
of cycles go in as they happen and only sums are kept, so a motion may last for days.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from orientd.planner import Motion, Peak
from orientd.rotation import Floats, angle, conjugate, log, multiply
from orientd.stream import Cycle

NANOSECONDS = 1e9

_LATENESS_BINS = 50_000
_LATENESS_BIN_NS = 1_000

# Two records are at one path time when they are nearer than this, in records.
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class Sent:
    """Consecutive cycles in which setpoints of one motion were sent; arrays over the cycles.

    Attributes:
        deadline_ns: when each was due.
        lateness_ns: how much later it began.
        path_time: where on the motion, s from its beginning.
        speed: rate of the path clock, 1 as planned.
        q: orientations sent, shape ``(n, 4)``.
        omega_body: angular velocities sent, rad/s, shape ``(n, 3)``.
        alpha_body: angular accelerations sent, rad/s^2, shape ``(n, 3)``.
        position: positions sent, m, shape ``(n, 3)``.
        feedback_q: orientations reported, not a number where there were none, shape ``(n, 4)``.
    """

    deadline_ns: NDArray[np.int64]
    lateness_ns: NDArray[np.int64]
    path_time: Floats
    speed: Floats
    q: Floats
    omega_body: Floats
    alpha_body: Floats
    position: Floats
    feedback_q: Floats

    @classmethod
    def of(cls, cycles: Sequence[Cycle], *, first_index: int, period: float) -> Sent:
        """Return *cycles* as arrays.

        Args:
            cycles: consecutive ones, all of the same motion.
            first_index: the path index of the motion's first record.
            period: path time from one record to the next, s.
        """
        nowhere = (math.nan,) * 4
        return cls(
            np.array([cycle.deadline_ns for cycle in cycles], dtype=np.int64),
            np.array([cycle.lateness_ns for cycle in cycles], dtype=np.int64),
            np.array([cycle.path_index - first_index + cycle.path_fraction for cycle in cycles])
            * period,
            np.array([cycle.speed for cycle in cycles], dtype=np.float64),
            np.array([cycle.q for cycle in cycles]).reshape(-1, 4),
            np.array([cycle.omega_body for cycle in cycles]).reshape(-1, 3),
            np.array([cycle.alpha_body for cycle in cycles]).reshape(-1, 3),
            np.array([cycle.position for cycle in cycles]).reshape(-1, 3),
            np.array(
                [cycle.feedback_q if cycle.has_feedback else nowhere for cycle in cycles]
            ).reshape(-1, 4),
        )

    def __len__(self) -> int:
        return len(self.path_time)


@dataclass(frozen=True)
class MotionStatistics:
    """What was measured of a motion.

    Attributes:
        cycles: setpoints sent.
        overruns: cycles that began more than half a period late.
        missed: deadlines that were left out altogether.
        lateness_p50: half the cycles were no later than this, s.
        lateness_p99: 99 percent of them.
        lateness_p999: 99.9 percent of them.
        lateness_max: none was later than this, s.
        velocity: largest angular velocity sent, rad/s, against its limit.
        acceleration: the same of the angular acceleration, rad/s^2.
        jerk: the same of the angular jerk, rad/s^3.
        path_error: largest angle between what was sent and the plan at the same path time, rad.
        position_error: largest distance between position sent and planned, m.
        start_velocity_error: how far the velocity sent was from the one asked for when the motion
            passed its first keyframe, rad/s; ``None`` unless it passed at full speed.
        end_velocity_error: the same at the last keyframe.
        tracking_error: largest angle between what was sent and what was reported in the same
            cycle, rad; ``None`` without feedback.
    """

    cycles: int
    overruns: int
    missed: int
    lateness_p50: float
    lateness_p99: float
    lateness_p999: float
    lateness_max: float
    velocity: Peak
    acceleration: Peak
    jerk: Peak
    path_error: float
    position_error: float
    start_velocity_error: float | None
    end_velocity_error: float | None
    tracking_error: float | None


class LatenessCounter:
    """Count latenesses in bins of a microsecond, whatever their number."""

    def __init__(self) -> None:
        self._counts = np.zeros(_LATENESS_BINS + 1, dtype=np.int64)
        self._largest_ns = 0

    def add(self, lateness_ns: NDArray[np.int64]) -> None:
        """Count more of them; an early cycle counts as punctual."""
        if len(lateness_ns):
            late = np.maximum(lateness_ns, 0)
            bins = np.minimum(-(-late // _LATENESS_BIN_NS), _LATENESS_BINS)
            self._counts += np.bincount(bins, minlength=_LATENESS_BINS + 1)
            self._largest_ns = max(self._largest_ns, int(late.max()))

    @property
    def largest(self) -> float:
        """The largest lateness, s."""
        return self._largest_ns / NANOSECONDS

    def percentile(self, percent: float) -> float:
        """Return the lateness in seconds that so many percent of the cycles did not exceed.

        It is rounded up to a microsecond; beyond 50 ms it is the largest there was.
        """
        total = int(self._counts.sum())
        if total == 0:
            return 0.0
        rank = max(1, math.ceil(total * percent / 100.0))
        place = int(np.searchsorted(np.cumsum(self._counts), rank))
        if place == _LATENESS_BINS:
            return self.largest
        return min(place * _LATENESS_BIN_NS / NANOSECONDS, self.largest)


class _Differences:
    """Backward differences of the orientations sent, continued from block to block."""

    def __init__(self, period: float) -> None:
        self._period = period
        self._q: Floats | None = None
        self._omega = np.zeros((1, 3))
        self._alpha = np.zeros((1, 3))

    def add(self, q: Floats) -> tuple[Floats, Floats, Floats]:
        """Return length of velocity, acceleration and jerk at each of *q*; at rest before them."""
        before = np.concatenate([q[:1] if self._q is None else self._q, q[:-1]])
        omega = log(multiply(conjugate(before), q)) / self._period
        alpha = np.diff(omega, axis=0, prepend=self._omega) / self._period
        jerk = np.diff(alpha, axis=0, prepend=self._alpha) / self._period
        self._q, self._omega, self._alpha = q[-1:], omega[-1:], alpha[-1:]
        return _length(omega), _length(alpha), _length(jerk)

    def rest(self, count: int) -> tuple[Floats, Floats, Floats]:
        """Return what *count* more setpoints at the last orientation would add, adding none."""
        if self._q is None:
            return np.zeros(count), np.zeros(count), np.zeros(count)
        return copy(self).add(np.repeat(self._q, count, axis=0))


class StatisticsCollector:
    """Statistics of one motion, fed with its cycles as they happen."""

    def __init__(self, motion: Motion) -> None:
        """Begin before the first cycle of *motion*, the device at rest."""
        self._motion = motion
        self._period = motion.period
        self._differences = _Differences(motion.period)
        limits = motion.limits
        self._peaks = (
            Peak(0.0, 0.0, limits.velocity),
            Peak(0.0, 0.0, limits.acceleration),
            Peak(0.0, 0.0, limits.jerk),
        )
        self._lateness = LatenessCounter()
        self._cycles = 0
        self._overruns = 0
        self._missed = 0
        self._deadline_ns: int | None = None
        self._path_error = 0.0
        self._position_error = 0.0
        self._tracking_error: float | None = None
        self._start = _Passage(motion, motion.start_time, motion.request.omega_start, is_end=False)
        self._end = _Passage(motion, motion.end_time, motion.request.omega_end, is_end=True)
        self._last_time = 0.0

    def add(self, sent: Sent) -> None:
        """Take the cycles that follow those taken before."""
        if len(sent) == 0:
            return
        self._time(sent)
        self._rate(sent)
        planned = self._motion.sample(sent.path_time)
        self._path_error = max(self._path_error, float(np.max(angle(planned.q, sent.q))))
        self._position_error = max(
            self._position_error, float(np.max(_length(planned.position - sent.position)))
        )
        is_known = np.isfinite(sent.feedback_q[:, 0])
        if np.any(is_known):
            largest = float(np.max(angle(sent.feedback_q[is_known], sent.q[is_known])))
            self._tracking_error = max(self._tracking_error or 0.0, largest)
        self._start.add(sent)
        self._end.add(sent)

    def result(self) -> MotionStatistics:
        """Return the statistics so far, as of a device that holds after the last cycle."""
        # What a device sees of the end shows in the three setpoints after it.
        velocity, acceleration, jerk = _raised(
            self._peaks, self._differences.rest(3), np.full(3, self._last_time)
        )
        return MotionStatistics(
            cycles=self._cycles,
            overruns=self._overruns,
            missed=self._missed,
            lateness_p50=self._lateness.percentile(50.0),
            lateness_p99=self._lateness.percentile(99.0),
            lateness_p999=self._lateness.percentile(99.9),
            lateness_max=self._lateness.largest,
            velocity=velocity,
            acceleration=acceleration,
            jerk=jerk,
            path_error=self._path_error,
            position_error=self._position_error,
            start_velocity_error=self._start.error,
            end_velocity_error=self._end.error,
            tracking_error=self._tracking_error,
        )

    def _time(self, sent: Sent) -> None:
        period_ns = self._period * NANOSECONDS
        self._cycles += len(sent)
        self._overruns += int(np.count_nonzero(sent.lateness_ns > period_ns / 2))
        before = sent.deadline_ns[0] - period_ns if self._deadline_ns is None else self._deadline_ns
        steps = np.diff(sent.deadline_ns, prepend=np.int64(before))
        self._missed += int(np.sum(np.rint(steps / period_ns) - 1.0))
        self._deadline_ns = int(sent.deadline_ns[-1])
        self._lateness.add(sent.lateness_ns)

    def _rate(self, sent: Sent) -> None:
        self._peaks = _raised(self._peaks, self._differences.add(sent.q), sent.path_time)
        self._last_time = float(sent.path_time[-1])


def _raised(
    peaks: Sequence[Peak], lengths: Sequence[Floats], path_time: Floats
) -> tuple[Peak, Peak, Peak]:
    """Return *peaks*, each raised to the largest of its *lengths* if that is higher."""
    places = [int(np.argmax(length)) for length in lengths]
    velocity, acceleration, jerk = (
        replace(peak, value=float(length[at]), time=float(path_time[at]))
        if length[at] > peak.value
        else peak
        for peak, length, at in zip(peaks, lengths, places, strict=True)
    )
    return velocity, acceleration, jerk


class _Passage:
    """The velocity with which a motion passed one of its ends.

    The instant need not be one of a cycle.  Velocity and acceleration of the two cycles next to it
    *within* the keyframes' part then give it by a cubic: the part beyond is another curve, joined
    with a step in jerk.
    """

    def __init__(self, motion: Motion, time: float, asked: Floats | None, *, is_end: bool) -> None:
        self.error: float | None = None
        self._asked = motion.sample(np.array([time])).omega_body[0] if asked is None else asked
        self._time = time
        self._period = motion.period
        self._is_end = is_end
        self._tail = np.empty((0, 8))

    def add(self, sent: Sent) -> None:
        """Look for the passage in the cycles that follow those before."""
        if self.error is not None:
            return
        rows = np.column_stack([sent.path_time, sent.speed, sent.omega_body, sent.alpha_body])
        rows = np.concatenate([self._tail, rows])
        self._tail = rows[-2:]
        times = rows[:, 0]
        same = np.flatnonzero(np.abs(times - self._time) <= _SAME * self._period)
        if len(same):
            self._measure(rows[same[0]], rows[same[0]])
            return
        after = int(np.searchsorted(times, self._time))
        first = after - 2 if self._is_end else after
        if 0 < after < len(times) and first >= 0 and first + 1 < len(times):
            self._measure(rows[first], rows[first + 1])

    def _measure(self, first: Floats, second: Floats) -> None:
        """Take the velocity from two rows of time, speed, velocity and acceleration."""
        if first[1] != 1.0 or second[1] != 1.0:
            return
        step = second[0] - first[0]
        u = (self._time - first[0]) / step if step else 0.0
        omega = (
            (1 + 2 * u) * (1 - u) ** 2 * first[2:5]
            + u**2 * (3 - 2 * u) * second[2:5]
            + u * (1 - u) ** 2 * step * first[5:8]
            + u**2 * (u - 1) * step * second[5:8]
        )
        self.error = float(np.linalg.norm(omega - self._asked))


def _length(vectors: Floats) -> Floats:
    return np.sqrt(np.sum(vectors * vectors, axis=-1))
