"""A device as it is now."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from orientd.daemon.device.queue import MotionQueue
from orientd.daemon.device.servo_process import ServoProcess
from orientd.daemon.planners.planned_motion import PlannedMotion
from orientd.driver import PartHealth
from orientd.errors import Fault
from orientd.floats import difference, norm
from orientd.stream.records import Cycle, CycleFlag, ServoState, unpack_cycle


@dataclass(frozen=True, slots=True)
class DeviceSnapshot:
    """A device as it is now.

    Attributes:
        cycle: the newest cycle, ``None`` before the first.
        state: the servo's state; ``FAULT`` if there is no servo.
        fault: kind of the fault.
        fault_text: the fault in words.
        is_paused: whether a motion stands on its path, to be resumed.
        speed: the speed that motions run at, or are resumed at.
        motion: the motion last started.
        motion_number: its number, 0 before the first.
        path_time: time within that motion, s; with latency compensation, the time that the device
            has reached, not the time of the setpoint.
        tracking_error: angle between the feedback and the setpoint due now, rad; ``None`` without
            feedback.
        servo_pid: process id of the servo; ``None`` if there is none.
        scheduling: what scheduling the servo has got.
        memory_locked: whether its memory is locked.
        health: how the device's parts are, as last measured.
        longest_calls: how long the driver's longest ``read`` and ``write`` took, s.
        held_at: name of the keep-out cone that keeps the device from the target that it follows.
    """

    cycle: Cycle | None
    state: ServoState
    fault: Fault
    fault_text: str
    is_paused: bool
    speed: float
    motion: PlannedMotion | None
    motion_number: int
    path_time: float
    tracking_error: float | None
    servo_pid: int | None
    scheduling: str
    memory_locked: bool
    health: tuple[PartHealth, ...] = ()
    longest_calls: Mapping[str, float] = field(default_factory=dict)
    held_at: str = ""


def take_snapshot(
    servo: ServoProcess, queue: MotionQueue, cycle: Cycle | None, *, number: int, lead_cycles: int
) -> DeviceSnapshot:
    """Return a device as it is in a cycle.

    Args:
        servo: of the device.
        queue: what it runs.
        cycle: the newest.
        number: of the motion last started.
        lead_cycles: how many cycles before its time each setpoint is sent.
    """
    fault = servo.fault
    state = ServoState.IDLE if cycle is None else cycle.state
    if cycle is not None and state is ServoState.FAULT and fault is Fault.NONE:
        fault = Fault(cycle.fault)
    due = cycle
    if cycle is not None and lead_cycles:
        # The setpoint due now was sent one lead before the newest.
        records = servo.cycle_records(max(0, cycle.index - lead_cycles), 1)
        due = unpack_cycle(records[0]) if records else cycle
    error = None
    if cycle is not None and due is not None and cycle.flags & CycleFlag.FEEDBACK:
        error = norm(difference(due.q, cycle.feedback_q))
    queued = queue.shown(due)
    # With the reason known already, it may still be coming to rest.
    is_fault = fault is not Fault.NONE and state is not ServoState.STOPPING
    return DeviceSnapshot(
        cycle=cycle,
        state=ServoState.FAULT if is_fault else state,
        fault=fault,
        fault_text=servo.fault_text,
        is_paused=queue.is_paused and state is ServoState.STREAMING,
        speed=queue.speed,
        motion=None if queued is None else queued.planned,
        motion_number=number if queued is None else queued.number,
        path_time=0.0 if due is None or queued is None else queued.path_time(due),
        tracking_error=error,
        servo_pid=servo.pid,
        scheduling=servo.scheduling,
        memory_locked=servo.memory_locked,
        health=servo.health,
        longest_calls=servo.longest_calls,
        held_at=servo.held_at if state is ServoState.TRACKING else "",
    )
