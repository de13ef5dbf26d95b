"""Measure a motion from the servo's cycles: the setpoints sent, not the planned ones.

The statistics need constant memory: a histogram of lateness with bins 1 % wide, and running peaks.
Nothing here waits for the device or delays it.  Cycles stay in their ring for seconds, and each
request for the statistics first reads the missing ones.
"""

from __future__ import annotations

import threading
from bisect import bisect_left
from collections import Counter
from math import exp, log

from orientd.daemon.planners.planned_motion import PlannedMotion
from orientd.driver import ZERO, Quaternion, Vector3
from orientd.floats import combine, difference, multiply, norm
from orientd.floats import exp as turn_of
from orientd.planner.facts import MOTION_RECORD
from orientd.protocol import control_pb2 as pb
from orientd.servo.path.segment import Segment, point_of
from orientd.stream.records import MOVING, PATH_FLOATS, Cycle, CycleFlag, unpack_cycle
from orientd.stream.ring import RecordRing

_BIN = log(1.01)

_BLOCK = 64
"""Cycles measured, and records read, at a time."""

_REACH = 3
"""Cycles before the first one of a motion that its third difference reaches back to."""

NANOSECONDS = 1e9

_OLDEST_FEEDBACK_NS = 2_000_000_000

_SAME = 1e-6
"""Path times nearer than this, in periods, are the same."""


class Histogram:
    """Durations in bins 1 % wide."""

    def __init__(self) -> None:
        self._counts: Counter[int] = Counter()
        self.largest_ns = 0

    def add(self, duration_ns: int) -> None:
        """Count a duration; zero and negative ones count as 1 ns."""
        self._counts[int(log(max(duration_ns, 1)) / _BIN)] += 1
        self.largest_ns = max(self.largest_ns, duration_ns)

    def percentile_ns(self, percent: float) -> float:
        """Return the duration that *percent* of those counted do not exceed, to 1 %."""
        left = percent / 100.0 * self._counts.total()
        for place, count in sorted(self._counts.items()):
            left -= count
            if left <= 0.0:
                return min(exp((place + 0.5) * _BIN), float(self.largest_ns))
        return 0.0


class LedSetpoints:
    """The setpoints of the recent past, to compare feedback with those sent a lead before it.

    With latency compensation, each setpoint is the path one lead ahead of the reported path time.
    The device is then where the plan says for that time.  Path time begins when the device begins
    to move: the servo sends the first record one lead before that.  At the end it holds the last
    record for one lead.  Along the path this only shifts time, so derivatives, limits, guard and
    stops are those of the setpoints sent.
    """

    def __init__(self, lead: float) -> None:
        """Expect feedback *lead* seconds after its setpoint."""
        self._lead_ns = round(lead * NANOSECONDS)
        self._times_ns: list[int] = []
        self._q: list[Quaternion] = []

    def gap(self, cycle: Cycle) -> float:
        """Return the angle between the feedback of the next cycle and its setpoint, rad.

        It is 0 in a cycle without a setpoint: before the device is enabled, nothing leads it.
        """
        times_ns, q = self._times_ns, self._q
        if not cycle.flags & CycleFlag.WRITTEN:
            times_ns.clear()
            q.clear()
            return 0.0
        if not times_ns:
            times_ns.append(cycle.deadline_ns - 1)
            q.append(cycle.q)
        times_ns.append(cycle.deadline_ns)
        q.append(cycle.q)
        while times_ns[0] <= cycle.deadline_ns - self._lead_ns - _OLDEST_FEEDBACK_NS:
            del times_ns[0], q[0]
        if not cycle.has_feedback:
            return 0.0
        wanted_ns = cycle.feedback_time_ns - self._lead_ns
        after = min(max(bisect_left(times_ns, wanted_ns), 1), len(times_ns) - 1)
        before_ns = times_ns[after - 1]
        share = (wanted_ns - before_ns) / (times_ns[after] - before_ns)
        turn = difference(q[after - 1], q[after])
        part = turn_of(combine(turn, min(max(share, 0.0), 1.0), ZERO, 0.0))
        return norm(difference(multiply(q[after - 1], part), cycle.feedback_q))


class MotionMeter:
    """Measure one motion.

    Peaks are of backward differences.  None is taken across a stall, because the motion then
    continues from rest.  Feedback is compared with the setpoint of the same cycle.  With latency
    compensation it is compared with the setpoint sent one lead earlier.

    Attributes:
        number: the motion's number.
    """

    def __init__(
        self,
        motion: PlannedMotion,
        number: int,
        first_index: int,
        cycles: RecordRing,
        *,
        lead: float = 0.0,
    ) -> None:
        """Expect the motion's records in the path ring from *first_index* on.

        Args:
            motion: to measure.
            number: of the motion.
            first_index: ring index of its first record.
            cycles: the ring of cycles, in which those of the motion come.
            lead: latency compensation of the device, s.
        """
        self.number = number
        self._motion, self._facts = motion, motion.facts
        self._first = first_index
        self._lock = threading.Lock()
        self._cycles: RecordRing | None = cycles
        self._next = max(0, cycles.head - _REACH - round(lead / motion.facts.period))
        self._end: int | None = None
        self._began_ns: int | None = None
        self._lateness, self._work = Histogram(), Histogram()
        self._count = self._stalls = 0
        self._counters, self._counters_before = (0, 0), (0, 0)
        self._peaks = [0.0, 0.0, 0.0]
        self._path_error = self._tracking_error = 0.0
        self._before: Cycle | None = None
        self._omega = self._alpha = ZERO
        self._start_error: float | None = None
        self._end_error: float | None = None
        self._recent: list[tuple[float, Cycle]] = []
        self._led = LedSetpoints(lead) if lead > 0.0 else None
        self._block, self._block_first = b"", 0

    @property
    def began_ns(self) -> int | None:
        """When the motion began to be run, monotonic clock; ``None`` before that.

        That is as its first setpoint says, which is for the end of a cycle.
        """
        self.measure()
        return self._began_ns

    def end(self) -> None:
        """Expect no cycles of the motion after the newest one there is."""
        if self._end is None and self._cycles is not None:
            self._end = self._cycles.head

    def measure(self) -> bool:
        """Read the new cycles; return whether they include the last one."""
        with self._lock:
            ring, end = self._cycles, self._end
            if ring is not None:
                # Cycles that come meanwhile are for the next time: it would never end else.
                head = ring.head if end is None else end
                while self._next < head:
                    since, self._next = self._next, min(self._next + _BLOCK, head)
                    for record in ring.records(since, self._next):
                        self.add(unpack_cycle(record))
                if end is not None:
                    # Nothing of the servo's memory is kept.
                    self._cycles, self._block = None, b""
            return self._cycles is None

    def add(self, cycle: Cycle) -> None:
        """Measure the next cycle; one that is not of the motion tells where that comes from."""
        before, self._before = self._before, cycle
        was_moving = before is not None and before.state in MOVING
        # The first cycle at rest belongs to the motion too: it is the last setpoint of it.
        is_moving = cycle.state in MOVING or was_moving
        is_own = is_moving and cycle.motion == self.number
        if is_own and self._began_ns is None:
            self._look_for_begin(cycle, before if was_moving else None)
        if before is None or not is_moving or cycle.flags & CycleFlag.FROM_REST:
            self._omega = self._alpha = ZERO
        if before is not None and is_moving:
            self._differentiate(before.q, cycle.q, is_own=is_own and self._began_ns is not None)
        gap = self._led.gap(cycle) if self._led is not None else 0.0
        if not is_own or self._began_ns is None:
            self._counters_before = (cycle.overruns, cycle.missed)
            return
        self._lateness.add(cycle.lateness_ns)
        if self._count:  # the work is that of the cycle before
            self._work.add(cycle.work_ns)
        self._count += 1
        self._counters = (
            cycle.overruns - self._counters_before[0],
            cycle.missed - self._counters_before[1],
        )
        self._stalls += bool(cycle.flags & CycleFlag.FROM_REST)
        if self._led is None and cycle.has_feedback:
            gap = norm(difference(cycle.q, cycle.feedback_q))
        self._tracking_error = max(self._tracking_error, gap)
        self._compare(cycle)

    def statistics(self) -> pb.MotionStatistics:
        """Return the figures so far."""
        self.measure()
        overruns, missed = self._counters
        return pb.MotionStatistics(
            cycles=self._count,
            overruns=overruns,
            missed=missed,
            stalls=self._stalls,
            lateness=_durations(self._lateness),
            work=_durations(self._work),
            velocity=self._peaks[0],
            acceleration=self._peaks[1],
            jerk=self._peaks[2],
            path_error=self._path_error,
            tracking_error=self._tracking_error,
            start_velocity_error=self._start_error,
            end_velocity_error=self._end_error,
        )

    def _look_for_begin(self, cycle: Cycle, moving: Cycle | None) -> None:
        """Note when the motion began, unless it waits yet for its time to begin.

        A motion that takes over from another one moves from its first record on.

        Args:
            cycle: of the motion.
            moving: the one before, if the device moved then.
        """
        run = cycle.path_index - self._first + cycle.path_fraction
        takes_over = moving is not None and moving.motion != self.number
        if run > 0.0 or takes_over:
            late_ns = (1.0 - run / (cycle.speed or 1.0)) * self._facts.period * NANOSECONDS
            self._began_ns = cycle.deadline_ns + cycle.lateness_ns + round(late_ns)

    def _differentiate(self, before: Quaternion, q: Quaternion, *, is_own: bool) -> None:
        per_second = 1.0 / self._facts.period
        omega = combine(difference(before, q), per_second, ZERO, 0.0)
        alpha = combine(omega, per_second, self._omega, -per_second)
        jerk = combine(alpha, per_second, self._alpha, -per_second)
        self._omega, self._alpha = omega, alpha
        if is_own:
            found = map(norm, (omega, alpha, jerk))
            self._peaks = [max(pair) for pair in zip(self._peaks, found, strict=True)]

    def _compare(self, cycle: Cycle) -> None:
        """Compare the setpoints sent with the plan."""
        facts, record = self._facts, cycle.path_index - self._first
        planned = self._planned(record, cycle.path_fraction)
        if planned is not None:
            self._path_error = max(self._path_error, norm(difference(planned, cycle.q)))
        if cycle.speed == 1.0:
            time = (record + cycle.path_fraction) * facts.period
            self._recent = [*self._recent[-2:], (time, cycle)]
            if self._start_error is None and facts.omega_start is not None:
                self._start_error = self._velocity_error(
                    facts.start_time, facts.omega_start, from_before=False
                )
            if self._end_error is None and facts.omega_end is not None:
                self._end_error = self._velocity_error(
                    facts.end_time, facts.omega_end, from_before=True
                )

    def _planned(self, record: int, fraction: float) -> Quaternion | None:
        """Return the orientation planned at a place on the path, if that is at hand."""
        last = self._motion.last_record
        if record >= last:
            record, fraction = last, 0.0
        size, needed = MOTION_RECORD.size, 2 if fraction else 1
        here = record - self._block_first
        if not 0 <= here <= len(self._block) // size - needed:
            begin, end = self._motion.at_hand
            if not begin <= record <= end - needed:
                return None
            self._block_first, here = record, 0
            self._block = self._motion.read(record, min(_BLOCK, end - record))
        start, *others = [
            point_of((0, *MOTION_RECORD.unpack_from(self._block, at * size)[:PATH_FLOATS]))
            for at in range(here, here + needed)
        ]
        return Segment(start, others[0], self._facts.period).at(fraction).q if others else start.q

    def _velocity_error(
        self, instant: float, wanted: Vector3, *, from_before: bool
    ) -> float | None:
        """Return the error of the velocity sent at *instant*, if the recent cycles span it.

        If no cycle falls on the instant, a cubic through velocity and acceleration of two cycles
        gives the velocity.  Both lie before the instant, or both after it: another curve may begin
        at the instant with a step in jerk.
        """
        recent, h = self._recent, self._facts.period
        k = next((k for k, (time, _) in enumerate(recent) if time >= instant - _SAME * h), None)
        if k is None:
            return None
        time, cycle = recent[k]
        if time - instant <= _SAME * h:
            return norm(combine(cycle.omega_body, 1.0, wanted, -1.0))
        first = k - 2 if from_before else k
        if first < 0 or first + 1 >= len(recent):
            return None
        (begin, here), (end, there) = recent[first : first + 2]
        step = end - begin
        if abs(step - h) > _SAME * h or abs(instant - (end if from_before else begin)) > h:
            return None
        u = (instant - begin) / step
        velocity = combine(
            here.omega_body, (1 + 2 * u) * (1 - u) ** 2, there.omega_body, u**2 * (3 - 2 * u)
        )
        slope = combine(
            here.alpha_body, u * (1 - u) ** 2 * step, there.alpha_body, u**2 * (u - 1) * step
        )
        return norm(combine(combine(velocity, 1.0, slope, 1.0), 1.0, wanted, -1.0))


def _durations(histogram: Histogram) -> pb.Durations:
    return pb.Durations(
        p50=histogram.percentile_ns(50.0) / NANOSECONDS,
        p99=histogram.percentile_ns(99.0) / NANOSECONDS,
        p99_9=histogram.percentile_ns(99.9) / NANOSECONDS,
        largest=histogram.largest_ns / NANOSECONDS,
    )
