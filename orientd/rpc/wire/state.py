"""The state of the daemon and its devices on the wire."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from orientd.driver import IDENTITY, ZERO, Vector3
from orientd.errors import Fault
from orientd.floats import difference, norm
from orientd.planner import ANGULAR, NO_AXES, Limits
from orientd.rpc import control_pb2 as pb
from orientd.rpc.reports import DaemonReport, Device, DeviceReport, Method, Outline
from orientd.rpc.wire.values import (
    RATES,
    STATES,
    STATES_BACK,
    quaternion,
    to_quaternion,
    to_vector,
    vector,
)
from orientd.stream import Cycle, CycleFlag

_FAULTS = {
    Fault.NONE: pb.FAULT_NONE,
    Fault.LINK_LOST: pb.FAULT_LINK_LOST,
    Fault.FEEDBACK_STALE: pb.FAULT_FEEDBACK_STALE,
    Fault.DEVICE_FAULT: pb.FAULT_DEVICE_FAULT,
    Fault.LIMIT_GUARD: pb.FAULT_LIMIT_GUARD,
    Fault.PATH_STARVED: pb.FAULT_PATH_STARVED,
    Fault.HEARTBEAT_LOST: pb.FAULT_HEARTBEAT_LOST,
    Fault.SERVO_DIED: pb.FAULT_SERVO_DIED,
    Fault.INTERNAL: pb.FAULT_INTERNAL,
    Fault.SERVO_STALLED: pb.FAULT_SERVO_STALLED,
}
_DAEMON = ("version", "pid", "uptime", "socket", "configuration")
_METHOD = tuple(Method.__dataclass_fields__)


def tracking_error(cycle: Cycle) -> float | None:
    """Return the angle between what was sent and what was reported, rad."""
    return norm(difference(cycle.q, cycle.feedback_q)) if cycle.has_feedback else None


def limits_to_message(limits: Limits) -> pb.Limits:
    """Return all limits; those of the axes only where there are any."""
    message = pb.Limits(**{name: getattr(limits, name) for name in RATES})
    for name in ANGULAR:
        if limits.axes(name) != NO_AXES:
            getattr(message, f"axis_{name}").CopyFrom(vector(limits.axes(name)))
    return message


def limits_from_message(message: pb.Limits) -> Limits:
    """Return the limits that *message* was made of."""
    axes = (
        to_vector(getattr(message, f"axis_{name}")) if message.HasField(f"axis_{name}") else NO_AXES
        for name in ANGULAR
    )
    return Limits(*(getattr(message, name) for name in RATES), *axes)


def cycle_to_message(cycle: Cycle) -> pb.Cycle:
    """Return one cycle; what was not reported is left out."""
    message = pb.Cycle(
        index=cycle.index,
        deadline_ns=cycle.deadline_ns,
        lateness_ns=cycle.lateness_ns,
        work_ns=cycle.work_ns,
        feedback_age_ns=cycle.feedback_age_ns,
        state=STATES[cycle.state],
        fault=_FAULTS[Fault(cycle.fault)],
        motion_number=cycle.motion,
        is_written=bool(cycle.flags & CycleFlag.WRITTEN),
        overruns=cycle.overruns,
        missed=cycle.missed,
        path_index=cycle.path_index,
        path_fraction=cycle.path_fraction,
        speed=cycle.speed,
        orientation=quaternion(cycle.q),
        omega_body=vector(cycle.omega_body),
        alpha_body=vector(cycle.alpha_body),
        position=vector(cycle.position),
    )
    error = tracking_error(cycle)
    if error is not None:
        message.feedback_orientation.CopyFrom(quaternion(cycle.feedback_q))
        message.feedback_omega_body.CopyFrom(vector(cycle.feedback_omega_body))
        message.feedback_position.CopyFrom(vector(cycle.feedback_position))
        message.tracking_error = error
    return message


def cycle_from_message(message: pb.Cycle) -> Cycle:
    """Return the cycle that *message* was made of."""
    has_feedback = message.HasField("feedback_orientation")
    flags = CycleFlag.FEEDBACK if has_feedback else 0
    if message.is_written:
        flags |= CycleFlag.WRITTEN
    return Cycle(
        index=message.index,
        deadline_ns=message.deadline_ns,
        lateness_ns=message.lateness_ns,
        work_ns=message.work_ns,
        feedback_time_ns=message.deadline_ns - message.feedback_age_ns if has_feedback else 0,
        path_index=message.path_index,
        state=STATES_BACK[message.state],
        fault=Fault(message.fault),
        motion=message.motion_number,
        flags=flags,
        overruns=message.overruns,
        missed=message.missed,
        path_fraction=message.path_fraction,
        speed=message.speed,
        q=to_quaternion(message.orientation),
        omega_body=to_vector(message.omega_body),
        alpha_body=to_vector(message.alpha_body),
        position=to_vector(message.position),
        feedback_q=to_quaternion(message.feedback_orientation) if has_feedback else IDENTITY,
        feedback_omega_body=to_vector(message.feedback_omega_body) if has_feedback else ZERO,
        feedback_position=to_vector(message.feedback_position) if has_feedback else ZERO,
    )


def device_to_message(report: DeviceReport) -> pb.DeviceReport:
    """Return *report* as a message."""
    message = pb.DeviceReport(
        device=pb.Device(
            name=report.name,
            driver=report.driver,
            rate_hz=report.rate_hz,
            limits=limits_to_message(report.limits),
            lead=report.lead,
            phase=report.phase,
        ),
        state=STATES[report.state],
        fault=_FAULTS[report.fault],
        fault_text=report.fault_text,
        is_paused=report.is_paused,
        speed=report.speed,
        motion_number=report.motion_number,
        motion_id=report.motion_id,
        path_time=report.path_time,
        duration=report.duration,
        servo_pid=report.servo_pid or 0,
        scheduling=report.scheduling,
        is_memory_locked=report.is_memory_locked,
    )
    if report.cycle is not None:
        message.cycle.CopyFrom(cycle_to_message(report.cycle))
    return message


def configured_from_message(message: pb.Device) -> Device:
    """Return the device of the configuration that *message* was made of."""
    return Device(
        name=message.name,
        driver=message.driver,
        rate_hz=message.rate_hz,
        limits=limits_from_message(message.limits),
        lead=message.lead,
        phase=message.phase,
    )


def device_from_message(message: pb.DeviceReport) -> DeviceReport:
    """Return the report that *message* was made of."""
    return DeviceReport(
        name=message.device.name,
        driver=message.device.driver,
        rate_hz=message.device.rate_hz,
        limits=limits_from_message(message.device.limits),
        state=STATES_BACK[message.state],
        fault=Fault(message.fault),
        fault_text=message.fault_text,
        is_paused=message.is_paused,
        speed=message.speed,
        motion_number=message.motion_number,
        motion_id=message.motion_id,
        path_time=message.path_time,
        duration=message.duration,
        servo_pid=message.servo_pid or None,
        scheduling=message.scheduling,
        is_memory_locked=message.is_memory_locked,
        cycle=cycle_from_message(message.cycle) if message.HasField("cycle") else None,
        lead=message.device.lead,
        phase=message.device.phase,
    )


def outline_to_messages(outline: Sequence[Sequence[Vector3]]) -> list[pb.Polyline]:
    """Return one message for each line."""
    return [pb.Polyline(coordinates=[x for point in line for x in point]) for line in outline]


def outline_from_messages(messages: Iterable[pb.Polyline]) -> Outline:
    """Return the lines that *messages* were made of."""
    # For clients: the daemon, which only sends them, does without NumPy until it plans.
    import numpy as np

    return tuple(
        np.array(message.coordinates, dtype=np.float64).reshape(-1, 3) for message in messages
    )


def daemon_to_message(report: DaemonReport) -> pb.DaemonReport:
    """Return *report* as a message."""
    return pb.DaemonReport(
        **{name: getattr(report, name) for name in _DAEMON},
        lease=pb.LeaseReport(
            holder=report.lease_holder,
            remaining=report.lease_remaining,
            identity=report.lease_identity,
        ),
    )


def daemon_from_message(message: pb.DaemonReport) -> DaemonReport:
    """Return the report that *message* was made of."""
    return DaemonReport(
        **{name: getattr(message, name) for name in _DAEMON},
        lease_holder=message.lease.holder,
        lease_remaining=message.lease.remaining,
        lease_identity=message.lease.identity,
    )


def method_to_message(method: Method) -> pb.Method:
    """Return *method* as a message."""
    return pb.Method(**{name: getattr(method, name) for name in _METHOD})


def method_from_message(message: pb.Method) -> Method:
    """Return the method that *message* was made of."""
    return Method(**{name: getattr(message, name) for name in _METHOD})
