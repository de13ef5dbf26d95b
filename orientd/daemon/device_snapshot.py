"""What a device looks like now: its newest cycle, its motion, and what is wrong with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.daemon.devices import DeviceSnapshot, ServoSupervisor
from orientd.errors import Fault
from orientd.floats import difference, norm
from orientd.stream import Cycle, CycleFlag, ServoState, unpack_cycle

if TYPE_CHECKING:
    from orientd.daemon.motions import Motions


def take_snapshot(
    servo: ServoSupervisor,
    motions: Motions | None,
    cycle: Cycle | None,
    *,
    number: int,
    speed: float,
    lead_cycles: int,
) -> DeviceSnapshot:
    """Return what there is to see of a device in a cycle.

    Args:
        servo: of the device.
        motions: what the servo runs; ``None`` before its first motion.
        cycle: the newest; ``None`` before the first, and where no servo runs.
        number: of the motion last started, 0 before the first.
        speed: that motions run at, or are resumed at.
        lead_cycles: by how many cycles the device is led.
    """
    fault = servo.fault
    if cycle is not None and cycle.state is ServoState.FAULT and fault is Fault.NONE:
        fault = Fault(cycle.fault)
    due = None if cycle is None else _due(servo, cycle, lead_cycles)
    error = None
    if cycle is not None and due is not None and cycle.flags & CycleFlag.FEEDBACK:
        error = norm(difference(due.q, cycle.feedback_q))
    queued = None if motions is None else motions.queued_of(due)
    path_time = 0.0
    if due is not None and queued is not None and queued.feeder is not None:
        records = due.path_index - queued.feeder.first_index + due.path_fraction
        path_time = max(0.0, records * queued.motion.facts.period)
    state = ServoState.IDLE if cycle is None else cycle.state
    is_paused = motions is not None and motions.is_paused
    return DeviceSnapshot(
        cycle=cycle,
        # With the reason known already, it may still be coming to rest.
        state=ServoState.FAULT
        if fault is not Fault.NONE and state is not ServoState.STOPPING
        else state,
        fault=fault,
        fault_text=servo.fault_text,
        is_paused=is_paused and state is ServoState.STREAMING,
        speed=speed,
        motion=None if queued is None else queued.motion,
        motion_number=number if queued is None else queued.number,
        path_time=path_time,
        tracking_error=error,
        servo_pid=servo.pid,
        scheduling=servo.scheduling,
        memory_locked=servo.memory_locked,
        health=servo.health,
    )


def _due(servo: ServoSupervisor, cycle: Cycle, lead_cycles: int) -> Cycle:
    """Return the cycle whose setpoint the device is to be at now: a lead before the newest."""
    if not lead_cycles:
        return cycle
    records = servo.cycle_records(max(0, cycle.index - lead_cycles), 1)
    return unpack_cycle(records[0]) if records else cycle
