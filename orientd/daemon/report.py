"""What the daemon says about its devices and motions, as values for the wire."""

from __future__ import annotations

import numpy as np

from orientd.curves import METHODS
from orientd.daemon.device import Device
from orientd.daemon.meter import Lateness, MotionStatistics
from orientd.daemon.runs import Run
from orientd.planner import Motion
from orientd.rpc.reports import (
    DeviceReport,
    Durations,
    Method,
    Plan,
    Progress,
    Samples,
    Statistics,
    Summary,
)
from orientd.stream import Cycle

NANOSECONDS = 1e9
_MOST_CYCLES = 4096


def device_report(device: Device) -> DeviceReport:
    """Return *device* as it is now."""
    now = device.snapshot()
    return DeviceReport(
        name=device.name,
        driver=device.driver,
        rate_hz=device.rate_hz,
        limits=device.limits,
        state=now.state,
        fault=now.fault,
        fault_text=now.fault_text,
        is_paused=now.is_paused,
        speed=now.speed,
        motion_number=now.motion_number,
        motion_id=now.motion.id if now.motion else "",
        path_time=now.path_time,
        duration=now.motion.duration if now.motion else 0.0,
        servo_pid=now.servo_pid,
        scheduling=now.scheduling,
        is_memory_locked=now.memory_locked,
        cycle=now.cycle,
    )


def methods() -> list[Method]:
    """Return the families of curves that motions can be made of."""
    return [
        Method(
            name=name,
            summary=family.summary,
            source=family.source,
            interpolates=family.interpolates,
            is_local=family.local,
            meets_end_velocities=family.meets_end_velocities,
        )
        for name, family in METHODS.items()
    ]


def plan(motion: Motion) -> Plan:
    """Return what there is to say about *motion* before it is run."""
    return Plan(
        motion_id=motion.id,
        duration=motion.duration,
        start_time=motion.start_time,
        end_time=motion.end_time,
        keyframe_times=tuple(motion.keyframe_times.tolist()),
        certificate=motion.certificate,
    )


def samples(motion: Motion, rate_hz: float) -> Samples:
    """Return *motion* sampled *rate_hz* times a second, from its beginning to its end."""
    count = int(np.floor(motion.duration * rate_hz + 1e-9)) + 1
    times = np.append(np.arange(count) / rate_hz, motion.duration)
    if times[-1] - times[-2] < 1e-9:
        times = times[:-1]
    sampled = motion.sample(times)
    return Samples(
        times=times,
        q=sampled.q,
        omega_body=sampled.omega_body,
        alpha_body=sampled.alpha_body,
        position=sampled.position,
        velocity=sampled.velocity,
    )


def summary(run: Run) -> Summary:
    """Return how *run*, which has ended, went."""
    outcome, text = run.ended.result(timeout=0)
    measured = run.device.statistics(run.number)
    return Summary(
        motion_number=run.number,
        outcome=outcome,
        text=text,
        statistics=None if measured is None else _statistics(measured),
    )


class CycleReader:
    """The cycles of a device in the order in which they happen, none of them twice."""

    def __init__(self, device: Device) -> None:
        """Begin with the next cycle."""
        self._device = device
        newest = device.snapshot().cycle
        self._next = newest.index + 1 if newest is not None else 0

    def read(self) -> tuple[list[Cycle], int]:
        """Return the cycles since the last call, and how many were gone before they were read."""
        newest = self._device.snapshot().cycle
        if newest is None:
            return [], 0
        if newest.index + 1 < self._next:
            self._next = 0  # another servo process, which counts from the beginning
        cycles: list[Cycle] = []
        lost = 0
        while more := self._device.cycles(self._next, _MOST_CYCLES):
            lost += more[-1].index + 1 - self._next - len(more)
            self._next = more[-1].index + 1
            cycles += more
            if len(more) < _MOST_CYCLES:
                break
        return cycles, lost


class ProgressReader:
    """The progress of a run, from report to report."""

    def __init__(self, run: Run) -> None:
        """Begin now, when *run* has just started."""
        self._run = run
        self._cycles = CycleReader(run.device)
        newest = run.device.snapshot().cycle
        self._overruns = newest.overruns if newest is not None else 0

    def read(self) -> Progress | None:
        """Return how far the motion is; ``None`` while there is no servo to tell."""
        now = self._run.device.snapshot()
        if now.cycle is None:
            return None
        recent, _ = self._cycles.read()
        latest = max((cycle.lateness_ns for cycle in recent), default=now.cycle.lateness_ns)
        return Progress(
            path_time=min(now.path_time, self._run.motion.duration),
            duration=self._run.motion.duration,
            state=now.state,
            is_paused=now.is_paused,
            speed=now.cycle.speed,
            q=now.cycle.q,
            omega_body=now.cycle.omega_body,
            position=now.cycle.position,
            lateness=latest / NANOSECONDS,
            tracking_error=now.tracking_error,
            overruns=max(0, now.cycle.overruns - self._overruns),
        )


def _statistics(measured: MotionStatistics) -> Statistics:
    return Statistics(
        cycles=measured.cycles,
        overruns=measured.overruns,
        missed=measured.missed,
        lateness=_durations(measured.lateness),
        work=_durations(measured.work),
        velocity=measured.velocity,
        acceleration=measured.acceleration,
        jerk=measured.jerk,
        path_error=measured.path_error,
        tracking_error=measured.tracking_error,
        start_velocity_error=measured.start_velocity_error,
        end_velocity_error=measured.end_velocity_error,
    )


def _durations(lateness: Lateness) -> Durations:
    return Durations(
        p50=lateness.p50_ns / NANOSECONDS,
        p99=lateness.p99_ns / NANOSECONDS,
        p99_9=lateness.p99_9_ns / NANOSECONDS,
        largest=lateness.largest_ns / NANOSECONDS,
    )
