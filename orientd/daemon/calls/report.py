"""What the daemon says about its devices and their motions, as values for the wire."""

from __future__ import annotations

import time

from orientd.daemon.device import Device
from orientd.daemon.motions import ActiveMotion, ActiveMotions
from orientd.driver import PartHealth
from orientd.planner import Frame, Quaternion, Vector3
from orientd.rpc import DeviceReport, PartReport, Progress, Summary
from orientd.stream import Cycle, ServoState, record_index, unpack_cycle

NANOSECONDS = 1e9
STALE_AFTER = 3.0
"""Age of what is measured once a second at which it is too old, s."""
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
        duration=now.motion.facts.duration if now.motion else 0.0,
        servo_pid=now.servo_pid,
        scheduling=now.scheduling,
        is_memory_locked=now.memory_locked,
        cycle=now.cycle,
        lead=device.lead,
        phase=device.phase,
        motion_name=now.motion.facts.name if now.motion else "",
        is_free=device.is_free and now.state is ServoState.IDLE,
        cycle_age=cycle_age(now.cycle),
        health=tuple(_part(part, time.monotonic_ns()) for part in now.health),
    )


def _part(part: PartHealth, now_ns: int) -> PartReport:
    """Return how a part of a device is, with how old that is."""
    age = (now_ns - part.time_ns) / NANOSECONDS
    return PartReport(
        part.name,
        age,
        age > STALE_AFTER,
        part.voltage,
        part.temperature,
        part.current,
        part.warning,
    )


def cycle_age(cycle: Cycle | None) -> float:
    """Return how long ago *cycle* was due, s; 0 where there was none."""
    if cycle is None:
        return 0.0
    return max(0, time.monotonic_ns() - cycle.deadline_ns) / NANOSECONDS


class CycleReader:
    """The cycles of a device in the order in which they happen, none of them twice."""

    def __init__(self, device: Device) -> None:
        """Begin with the next cycle."""
        self._device = device
        self._next = device.next_cycle

    def read(self) -> tuple[list[Cycle], int]:
        """Return the cycles since the last call, and how many were gone before they were read."""
        records, lost = self.read_records()
        return [unpack_cycle(record) for record in records], lost

    def read_records(self, most: int | None = None) -> tuple[list[bytes], int]:
        """Do the same with records, which are the cycles as the servo has packed them.

        Args:
            most: how many to return at once; the next call goes on from there.
        """
        if self._device.next_cycle < self._next:
            self._next = 0  # another servo process, which counts from the beginning
        taken: list[bytes] = []
        lost = 0
        chunk = _MOST_CYCLES if most is None else most
        while more := self._device.cycle_records(self._next, chunk):
            end = record_index(more[-1]) + 1
            lost += end - self._next - len(more)
            self._next = end
            taken += more
            if len(more) < chunk or most is not None:
                break
        return taken, lost


class ProgressReader:
    """The progress of a run, from report to report."""

    def __init__(self, run: ActiveMotion) -> None:
        """Begin now, when *run* has just started."""
        self._run = run
        self._cycles = CycleReader(run.device)
        newest = run.device.snapshot().cycle
        self._overruns = newest.overruns if newest is not None else 0

    def read(self) -> Progress | None:
        """Return how far the motion is.

        ``None`` while there is no servo to tell, and once the motion has been left for another:
        it may not have ended, but what the device does is the other's.
        """
        now = self._run.device.snapshot()
        if now.cycle is None or now.motion_number > self._run.number:
            return None
        frame = self._run.motion.frame if self._run.motion is not None else None
        duration = self._run.motion.facts.duration if self._run.motion is not None else 0.0
        # A motion that waits for its turn has not begun.
        is_present = now.motion_number == self._run.number
        recent, _ = self._cycles.read()
        latest = max((cycle.lateness_ns for cycle in recent), default=now.cycle.lateness_ns)
        seen = (now.cycle.q, now.cycle.omega_body, now.cycle.position)
        q, omega_body, position = seen if frame is None else _seen(frame, *seen)
        return Progress(
            path_time=now.path_time if is_present else 0.0,
            duration=duration,
            state=now.state,
            is_paused=now.is_paused,
            speed=now.cycle.speed,
            q=q,
            omega_body=omega_body,
            position=position,
            lateness=latest / NANOSECONDS,
            tracking_error=now.tracking_error,
            overruns=max(0, now.cycle.overruns - self._overruns),
        )


def summary(run: ActiveMotion, runs: ActiveMotions) -> Summary:
    """Return how *run*, which has ended, went beside the others of *runs*."""
    outcome, text = run.ended.result(timeout=0)
    lateness, skew = runs.starts(run)
    return Summary(
        motion_number=run.number,
        outcome=outcome,
        text=text,
        statistics=run.device.statistics(run.number),
        settled_after=run.device.settled_after(run.number),
        start_lateness=lateness,
        start_skew=skew,
    )


def _seen(
    frame: Frame, q: Quaternion, omega_body: Vector3, position: Vector3
) -> tuple[Quaternion, Vector3, Vector3]:
    """Return orientation, angular velocity and position of the tool of a frame, from its base."""
    seen_q, seen_position = frame.pose(q, position)
    w, x, y, z = seen_q.tolist()
    a, b, c = frame.vector(omega_body).tolist()
    u, v, t = seen_position.tolist()
    return (w, x, y, z), (a, b, c), (u, v, t)
