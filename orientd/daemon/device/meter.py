"""Measure a motion from the cycles the servo has published: what was sent, not what was planned.

The figures grow no memory: lateness goes into a histogram with bins 1 % wide, peaks are kept as
they pass.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from orientd import rotation
from orientd.planner import RecordedMotion, Vector3
from orientd.protocol import control_pb2 as pb
from orientd.recorder import Table, from_records
from orientd.rotation import Floats
from orientd.stream import CycleFlag, ServoState

_BIN = np.log(1.01)
_BINS = 2200
"""From 1 ns to 3.2 s."""

NANOSECONDS = 1e9

_OLDEST_FEEDBACK_NS = 2_000_000_000

_SAME = 1e-6
"""Path times nearer than this, in periods, are the same."""


class Histogram:
    """Durations in bins 1 % wide, of constant size."""

    def __init__(self) -> None:
        self._counts = np.zeros(_BINS, dtype=np.int64)
        self.largest_ns = 0

    def add(self, durations_ns: NDArray[np.int64]) -> None:
        """Count *durations_ns*; what is not positive counts as 1 ns."""
        if durations_ns.size:
            bins = np.log(np.maximum(durations_ns, 1)) / _BIN
            np.add.at(self._counts, np.minimum(bins.astype(np.int64), _BINS - 1), 1)
            self.largest_ns = max(self.largest_ns, int(durations_ns.max()))

    def percentile_ns(self, percent: float) -> float:
        """Return the duration that *percent* of those counted do not exceed, to 1 %."""
        total = int(self._counts.sum())
        if total == 0:
            return 0.0
        rank = percent / 100.0 * total
        place = int(np.searchsorted(np.cumsum(self._counts), rank))
        return float(min(np.exp((place + 0.5) * _BIN), self.largest_ns))


class LedSetpoints:
    """The setpoints of the recent past, to compare feedback with those sent a lead before it.

    What is sent to a device that is led is the path a lead ahead of the path time that is reported,
    so that the device is where the plan says for that time.  Path time begins when the device does:
    the first record is sent a lead before it, and the device holds on the last record for the lead
    after.  Along the path this is a shift in time and nothing else, so derivatives, limits, guard
    and stops are those of what is sent.
    """

    def __init__(self, lead: float, held: Floats) -> None:
        """Expect feedback *lead* seconds after its setpoint; *held* is sent before the first."""
        self._lead_ns = round(lead * 1e9)
        self._held = np.asarray(held, dtype=np.float64)
        self._times_ns = np.zeros(0, dtype=np.int64)
        self._q = np.zeros((0, 4))

    def gaps(self, cycles: Table) -> Floats:
        """Return the angles between the feedback of further *cycles* and what was to be, rad.

        Args:
            cycles: in order, each with feedback or without; those without have a gap of 0.
        """
        if not len(self._times_ns):
            self._times_ns = cycles["deadline_ns"][:1] - 1
            self._q = self._held[None]
        self._times_ns = np.concatenate([self._times_ns, cycles["deadline_ns"]])
        self._q = np.concatenate([self._q, cycles["sent_q"]])
        times_ns, q = self._times_ns, self._q
        wanted_ns = cycles["feedback_time_ns"] - self._lead_ns
        after = np.clip(np.searchsorted(times_ns, wanted_ns), 1, len(times_ns) - 1)
        before_ns = times_ns[after - 1]
        share = (wanted_ns - before_ns) / np.maximum(times_ns[after] - before_ns, 1)
        expected = rotation.slerp(q[after - 1], q[after], np.clip(share, 0.0, 1.0))
        gaps = rotation.angle(expected, cycles["measured_q"])
        is_kept = times_ns > times_ns[-1] - self._lead_ns - _OLDEST_FEEDBACK_NS
        self._times_ns, self._q = times_ns[is_kept], q[is_kept]
        return np.where(cycles["flags"] & CycleFlag.FEEDBACK, gaps, 0.0)


class MotionMeter:
    """Measure one motion, block of cycles by block.

    Peaks are of backward differences, which are not taken across a stall, from which the motion
    goes on from rest.  Feedback is compared with what was sent in the same cycle; for a device that
    is led, with what was sent a lead before it.

    Attributes:
        number: the motion's number.
        began_ns: when the motion began to be run, monotonic clock, as its first setpoint says,
            which is for the end of a cycle; ``None`` before that.
    """

    def __init__(
        self,
        motion: RecordedMotion,
        number: int,
        first_index: int,
        *,
        lead: float = 0.0,
        after: MotionMeter | None = None,
    ) -> None:
        """Expect the motion's records in the path ring from *first_index* on.

        Args:
            motion: to measure.
            number: of the motion.
            first_index: ring index of its first record.
            lead: by how much the device is led, s.
            after: measures the motion that this one takes over from while it moves.
        """
        self.number = number
        self._motion = motion
        self._first = first_index
        self._lateness, self._work = Histogram(), Histogram()
        self._cycles = 0
        self._counters: tuple[int, int] | None = None
        self._overruns = self._missed = self._stalls = 0
        self._peaks = [0.0, 0.0, 0.0]
        self._path_error = self._tracking_error = 0.0
        self._before: Table | None = None
        self._omega = np.zeros(3)
        self._alpha = np.zeros(3)
        self._start_error: float | None = None
        self._end_error: float | None = None
        self._carried: tuple[Table, NDArray[np.float64]] | None = None
        # The device holds there before the first cycle of the motion.
        self._last_q = motion.orientations(np.zeros(1))[0]
        self._led = LedSetpoints(lead, self._last_q) if lead > 0.0 else None
        self._after = after
        self.began_ns: int | None = None

    def add(self, records: list[bytes]) -> None:
        """Measure further cycles, in order; those that are not of the motion are left out."""
        cycles = from_records(records)
        moving = (cycles["state"] == ServoState.STREAMING) | (
            cycles["state"] == ServoState.STOPPING
        )
        # The first cycle at rest belongs to the motion too: it is the last setpoint of it.
        moving[1:] |= moving[:-1]
        if self._before is not None:
            moving[0] |= self._before["state"] in (ServoState.STREAMING, ServoState.STOPPING)
        previous, self._before = self._before, cycles[-1]
        chosen = moving & (cycles["motion"] == self.number)
        if not chosen.any():
            return
        first = int(np.argmax(chosen))
        block = cycles[chosen]
        if self.began_ns is None:
            block = self._after_waiting(block)
            if not len(block):
                return
        self._cycles += len(block)
        self._lateness.add(block["lateness_ns"])
        self._work.add(block["work_ns"][1:])
        if self._counters is None:
            one = cycles[first - 1] if first else previous
            base = one if one is not None else block[0]
            self._counters = (int(base["overruns"]), int(base["missed"]))
        self._overruns = int(block["overruns"][-1]) - self._counters[0]
        self._missed = int(block["missed"][-1]) - self._counters[1]
        if self._after is not None:
            self._last_q, self._omega, self._alpha = self._after.last
            self._after = None
        (resumed,) = np.nonzero(block["flags"] & CycleFlag.FROM_REST)
        for number, sent in enumerate(np.split(block["sent_q"], resumed)):
            if number:
                self._omega, self._alpha = np.zeros(3), np.zeros(3)
            if len(sent):
                self._differentiate(sent)
        self._stalls += len(resumed)
        self._compare(block)

    @property
    def last(self) -> tuple[Floats, Floats, Floats]:
        """Orientation sent last, and its first and second backward differences."""
        return self._last_q, self._omega, self._alpha

    def statistics(self) -> pb.MotionStatistics:
        """Return the figures so far."""
        return pb.MotionStatistics(
            cycles=self._cycles,
            overruns=self._overruns,
            missed=self._missed,
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

    def _after_waiting(self, block: Table) -> Table:
        """Return *block* without the cycles in which the motion had not begun to move.

        A motion that takes over from another one moves from its first record on.
        """
        moved = (block["path_index"] > self._first) | (block["path_fraction"] > 0.0)
        moved |= self._after is not None
        if not moved.any():
            return block[:0]
        first = int(np.argmax(moved))
        sent = block[first]
        run = sent["path_index"] - self._first + sent["path_fraction"]
        late_ns = (1.0 - run / (sent["speed"] or 1.0)) * self._motion.facts.period * 1e9
        self.began_ns = int(sent["deadline_ns"] + sent["lateness_ns"] + round(late_ns))
        return block[first:]

    def _differentiate(self, sent: NDArray[np.float64]) -> None:
        h, q = self._motion.facts.period, np.vstack([self._last_q, sent])
        omega = rotation.log(rotation.multiply(rotation.conjugate(q[:-1]), q[1:])) / h
        alpha = np.diff(np.vstack([self._omega, omega]), axis=0) / h
        jerk = np.diff(np.vstack([self._alpha, alpha]), axis=0) / h
        self._last_q, self._omega, self._alpha = sent[-1], omega[-1], alpha[-1]
        for k, derivative in enumerate((omega, alpha, jerk)):
            largest = float(np.sqrt((derivative**2).sum(axis=1).max()))
            self._peaks[k] = max(self._peaks[k], largest)

    def _compare(self, block: Table) -> None:
        motion = self._motion
        times = (block["path_index"] - self._first + block["path_fraction"]) * motion.facts.period
        off_plan = rotation.angle(motion.orientations(times), block["sent_q"])
        self._path_error = max(self._path_error, float(off_plan.max()))
        measured = (block["flags"] & CycleFlag.FEEDBACK) != 0
        if self._led is not None:
            self._tracking_error = max(self._tracking_error, float(self._led.gaps(block).max()))
        elif measured.any():
            gap = rotation.angle(block["sent_q"][measured], block["measured_q"][measured])
            self._tracking_error = max(self._tracking_error, float(gap.max()))
        if self._carried is not None:
            block = np.concatenate([self._carried[0], block])
            times = np.concatenate([self._carried[1], times])
        self._carried = (block[-2:], times[-2:])
        full = block["speed"] == 1.0
        block, times = block[full], times[full]
        facts = motion.facts
        if self._start_error is None and facts.omega_start is not None:
            self._start_error = self._velocity_error(
                block, times, facts.start_time, facts.omega_start, from_before=False
            )
        if self._end_error is None and facts.omega_end is not None:
            self._end_error = self._velocity_error(
                block, times, facts.end_time, facts.omega_end, from_before=True
            )

    def _velocity_error(
        self,
        block: Table,
        times: NDArray[np.float64],
        instant: float,
        wanted: Vector3,
        *,
        from_before: bool,
    ) -> float | None:
        """Return the error of the velocity sent at *instant*, where the block spans it.

        Where no cycle falls on the instant, the velocity is the cubic through velocity and
        acceleration of the two cycles before it, or after it: between the one before and the one
        after, another curve begins with a step in jerk.
        """
        h = self._motion.facts.period
        k = int(np.searchsorted(times, instant - _SAME * h))
        if k >= len(times):
            return None
        if times[k] - instant <= _SAME * h:
            sent = block["sent_omega_body"][k]
            return float(np.linalg.norm(sent - np.array(wanted)))
        first = k - 2 if from_before else k
        if first < 0 or first + 1 >= len(times):
            return None
        nearest = times[k - 1] if from_before else times[k]
        step = times[first + 1] - times[first]
        if abs(step - h) > _SAME * h or abs(instant - nearest) > h:
            return None
        u = (instant - times[first]) / step
        omega, alpha = (
            block["sent_omega_body"][first : first + 2],
            block["sent_alpha_body"][first : first + 2],
        )
        sent = (
            (1 + 2 * u) * (1 - u) ** 2 * omega[0]
            + u**2 * (3 - 2 * u) * omega[1]
            + u * (1 - u) ** 2 * step * alpha[0]
            + u**2 * (u - 1) * step * alpha[1]
        )
        return float(np.linalg.norm(sent - np.array(wanted)))


def _durations(histogram: Histogram) -> pb.Durations:
    return pb.Durations(
        p50=histogram.percentile_ns(50.0) / NANOSECONDS,
        p99=histogram.percentile_ns(99.0) / NANOSECONDS,
        p99_9=histogram.percentile_ns(99.9) / NANOSECONDS,
        largest=histogram.largest_ns / NANOSECONDS,
    )
