"""Build the daemon's reports as messages: itself, its devices, their cycles and motions."""

from __future__ import annotations

import functools
import time
from collections.abc import Iterable
from typing import Any

from orientd.daemon.device import Device, QueuedMotion
from orientd.driver import PartHealth, Quaternion, Vector3
from orientd.floats import difference, norm
from orientd.model.request import Frame
from orientd.protocol import control_pb2 as pb
from orientd.protocol.cones import cone_message
from orientd.protocol.limits import limits_to_message
from orientd.protocol.reports import STALE
from orientd.protocol.values import quaternion, vector
from orientd.stream.records import UNKNOWN, Cycle, CycleFlag, ServoState, record_index, unpack_cycle

NANOSECONDS = 1e9
STALE_AFTER = 3.0
"""Age in s at which a part's health, measured once a second, is too old."""
_MOST_CYCLES = 4096
_SHARED_CYCLES = 1024


def described(device: Device) -> dict[str, Any]:
    """Return what the configuration says of *device*: the fields of a ``Device``."""
    return {
        "name": device.name,
        "driver": device.driver,
        "rate_hz": device.rate_hz,
        "limits": limits_to_message(device.limits),
        "lead": device.lead,
        "phase": device.phase,
        "keep_out": map(cone_message, device.keep_out),
    }


def device_report(device: Device) -> pb.DeviceReport:
    """Return *device* as it is now."""
    now = device.snapshot()
    facts = now.motion.facts if now.motion else None
    now_ns = time.monotonic_ns()
    cycle, age, feedback_age = now.cycle, cycle_age(now.cycle), None
    if cycle is not None and cycle.has_feedback:
        feedback_age = age + cycle.feedback_age_ns / NANOSECONDS
    return pb.DeviceReport(
        **described(device),
        state=f"STATE_{now.state.name}",
        fault=f"FAULT_{now.fault.name}",
        fault_text=now.fault_text,
        is_paused=now.is_paused,
        speed=now.speed,
        motion_number=now.motion_number,
        motion_id=now.motion.id if now.motion else "",
        motion_name=facts.name if facts else "",
        path_time=now.path_time,
        duration=facts.duration if facts else 0.0,
        servo_pid=now.servo_pid,
        scheduling=now.scheduling,
        is_memory_locked=now.memory_locked,
        cycle=None if cycle is None else cycle_message(cycle),
        cycle_age=age,
        feedback_age=feedback_age,
        is_stale=now.servo_pid is not None and age > STALE,
        is_free=device.is_free and now.state is ServoState.IDLE,
        health=[_part(part, now_ns) for part in now.health],
        held_at=now.held_at,
        ended=None if device.last_ended is None else ended_motion(device.last_ended),
    )


def ended_motion(queued: QueuedMotion) -> pb.EndedMotion:
    """Return how a motion has ended."""
    outcome, text = queued.ended.result(timeout=0)
    facts = None if queued.planned is None else queued.planned.facts
    return pb.EndedMotion(
        motion_number=queued.number,
        name=facts.name if facts else "",
        outcome=outcome,
        text=text,
        path_time=queued.reached,
        duration=facts.duration if facts else 0.0,
    )


def _part(part: PartHealth, now_ns: int) -> pb.PartHealth:
    """Return how a part of a device is, with the age of that."""
    age = (now_ns - part.time_ns) / NANOSECONDS
    return pb.PartHealth(
        name=part.name,
        age=age,
        is_stale=age > STALE_AFTER,
        voltage=part.voltage,
        temperature=part.temperature,
        current=part.current,
        warning=part.warning,
    )


def cycle_age(cycle: Cycle | None) -> float:
    """Return how long ago *cycle* was due, s; 0 before the first cycle."""
    if cycle is None:
        return 0.0
    return max(0, time.monotonic_ns() - cycle.deadline_ns) / NANOSECONDS


def cycle_message(cycle: Cycle) -> pb.Cycle:
    """Return one cycle as a message, without the feedback if there is none."""
    message = pb.Cycle(
        index=cycle.index,
        deadline_ns=cycle.deadline_ns,
        lateness_ns=cycle.lateness_ns,
        work_ns=cycle.work_ns,
        feedback_age_ns=cycle.feedback_age_ns,
        state=f"STATE_{cycle.state.name}",
        fault=cycle.fault,  # type: ignore[arg-type] # the numbers are the same
        motion_number=cycle.motion,
        is_written=bool(cycle.flags & CycleFlag.WRITTEN),
        overruns=cycle.overruns,
        missed=cycle.missed,
        path_index=cycle.path_index,
        path_fraction=cycle.path_fraction,
        speed=cycle.speed,
        q=quaternion(cycle.q),
        omega_body=vector(cycle.omega_body),
        alpha_body=vector(cycle.alpha_body),
        position=vector(cycle.position),
    )
    if cycle.has_feedback:
        message.feedback_q.CopyFrom(quaternion(cycle.feedback_q))
        message.feedback_omega_body.CopyFrom(vector(cycle.feedback_omega_body))
        message.feedback_position.CopyFrom(vector(cycle.feedback_position))
        message.tracking_error = norm(difference(cycle.q, cycle.feedback_q))
    return message


@functools.lru_cache(_SHARED_CYCLES)
def record_message(record: bytes) -> pb.Cycle:
    """Return a packed cycle as a message, made once for all callers that watch."""
    return cycle_message(unpack_cycle(record))


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
            most: how many to return at once; the next call continues from there.
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

    def __init__(self, device: Device, run: QueuedMotion) -> None:
        """Begin now, when *run* has just started on *device*."""
        self._device, self._run = device, run
        self._cycles = CycleReader(device)
        newest = device.snapshot()
        self._servo_pid = newest.servo_pid
        self._overruns = 0 if newest.cycle is None else newest.cycle.overruns

    def read(self) -> pb.MoveProgress | None:
        """Return how far the motion is.

        ``None`` once the servo process of the motion has ended, and once another motion has
        replaced this one: it may not have ended, but what the device does belongs to the other.
        """
        now = self._device.snapshot()
        if now.cycle is None or now.servo_pid != self._servo_pid:
            return None
        if now.motion_number > self._run.number:
            return None
        motion = self._run.planned
        # A motion that waits for its turn has not begun.
        is_present = now.motion_number == self._run.number
        recent, _ = self._cycles.read()
        latest = max((cycle.lateness_ns for cycle in recent), default=now.cycle.lateness_ns)
        sent = (now.cycle.q, now.cycle.omega_body, now.cycle.position)
        frame = None if motion is None else motion.frame
        q, omega_body, position = sent if frame is None else _seen(frame, *sent)
        return pb.MoveProgress(
            path_time=now.path_time if is_present else 0.0,
            duration=0.0 if motion is None else motion.facts.duration,
            state=f"STATE_{now.state.name}",
            is_paused=now.is_paused,
            speed=now.cycle.speed,
            q=quaternion(q),
            omega_body=vector(omega_body),
            position=vector(position),
            lateness=latest / NANOSECONDS,
            tracking_error=now.tracking_error,
            overruns=now.cycle.overruns - self._overruns,
        )


def summary(run: QueuedMotion, devices: Iterable[Device]) -> pb.MoveSummary:
    """Return how *run*, which has ended, went.

    Args:
        run: the motion.
        devices: those that may have begun a motion with the same start time.
    """
    outcome, text = run.ended.result(timeout=0)
    start_ns, lateness, skew = run.options.start_ns, None, None
    if start_ns != UNKNOWN:
        began = [device.began_ns(start_ns) for device in devices]
        instants = [instant for instant in began if instant is not None]
        if run.began_ns is not None:
            lateness = (run.began_ns - start_ns) / NANOSECONDS
        if len(instants) > 1:
            skew = (max(instants) - min(instants)) / NANOSECONDS
    return pb.MoveSummary(
        motion_number=run.number,
        outcome=outcome,
        text=text,
        statistics=run.statistics,
        settled_after=run.settled_after,
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
