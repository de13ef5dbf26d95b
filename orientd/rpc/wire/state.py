"""The state of the daemon and its devices on the wire."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from orientd.driver import IDENTITY, ZERO, Vector3
from orientd.floats import difference, norm
from orientd.planner import ANGULAR, NO_AXES, Limits
from orientd.rpc import control_pb2 as pb
from orientd.rpc.descriptions import DeviceDescription, MethodDescription, Outline, PartReport
from orientd.rpc.reports import DaemonReport, DeviceReport, LeaseReport
from orientd.rpc.wire.codec import Codec
from orientd.rpc.wire.values import (
    RATES,
    quaternion,
    to_quaternion,
    to_vector,
    vector,
)
from orientd.stream import Cycle, CycleFlag


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


CYCLE = Codec(
    Cycle,
    pb.Cycle,
    names={"motion": "motion_number", "q": "orientation"},
    without=(
        "feedback_time_ns", "flags", "feedback_q", "feedback_omega_body", "feedback_position",
        "joints", "sent_joints",
    ),
)  # fmt: skip


def cycle_to_message(cycle: Cycle) -> pb.Cycle:
    """Return one cycle; what was not reported is left out."""
    message = CYCLE.to_message(cycle)
    message.feedback_age_ns = cycle.feedback_age_ns
    message.is_written = bool(cycle.flags & CycleFlag.WRITTEN)
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
    return CYCLE.from_message(
        message,
        flags=flags,
        feedback_time_ns=message.deadline_ns - message.feedback_age_ns if has_feedback else 0,
        feedback_q=to_quaternion(message.feedback_orientation) if has_feedback else IDENTITY,
        feedback_omega_body=to_vector(message.feedback_omega_body) if has_feedback else ZERO,
        feedback_position=to_vector(message.feedback_position) if has_feedback else ZERO,
    )


_OF_DEVICE = tuple(DeviceDescription.__dataclass_fields__)
_LIMITS = limits_to_message, limits_from_message

PART = Codec(PartReport, pb.PartHealth)
DEVICE = Codec(DeviceDescription, pb.Device, kinds={"limits": _LIMITS})
DEVICE_REPORT = Codec(
    DeviceReport,
    pb.DeviceReport,
    names={name: f"device.{name}" for name in _OF_DEVICE},
    kinds={
        "limits": _LIMITS,
        "health": PART.kind,
        "cycle": (cycle_to_message, cycle_from_message),
        # The message says 0 where there is no process.
        "servo_pid": (int, lambda pid: pid or None),
    },
)
LEASE = Codec(LeaseReport, pb.LeaseReport)
DAEMON = Codec(
    DaemonReport,
    pb.DaemonReport,
    names={f"lease_{name}": f"lease.{name}" for name in pb.LeaseReport.DESCRIPTOR.fields_by_name},
    kinds={"leases": LEASE.kind},
)
METHOD = Codec(MethodDescription, pb.Method)

device_to_message, device_from_message = DEVICE_REPORT.to_message, DEVICE_REPORT.from_message
configured_from_message = DEVICE.from_message
daemon_to_message, daemon_from_message = DAEMON.to_message, DAEMON.from_message
method_to_message, method_from_message = METHOD.to_message, METHOD.from_message


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
