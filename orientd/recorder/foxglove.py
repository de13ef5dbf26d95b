"""What viewers draw of a cycle: Foxglove's schemas, rounded to single precision.

Sent and measured are topics and frames of their own, ``/DEVICE/sent/...`` and
``/DEVICE/measured/...``; what was measured carries the time at which it was measured.  The cycles
at full rate and precision are in ``/DEVICE/cycles``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import ArrayLike

from orientd.protocol import control_pb2 as pb
from orientd.protocol import titled
from orientd.recorder.cycle_table import Table

WORLD = "world"
_NANOSECONDS = 1_000_000_000

Shown = tuple[str, int, Message]
"""Topic, time of day in nanoseconds, message."""

_LEVELS = {
    pb.EVENT_KIND_FAULT: Log.ERROR,
    pb.EVENT_KIND_SERVO_DIED: Log.ERROR,
    pb.EVENT_KIND_RECORDING_FAILED: Log.ERROR,
    pb.EVENT_KIND_MOTION_STOPPED: Log.WARNING,
    pb.EVENT_KIND_MOTION_REPLACED: Log.WARNING,
    pb.EVENT_KIND_MOTION_UNSETTLED: Log.WARNING,
    pb.EVENT_KIND_WARNING: Log.WARNING,
}


def cycles_shown(device: str, cycles: Table, offset_ns: int) -> Iterator[Shown]:
    """Yield what viewers draw of *cycles*.

    Args:
        device: whose they are.
        cycles: those that are to be drawn, not every one.
        offset_ns: from the monotonic clock to the time of day.
    """
    due = (cycles["deadline_ns"] + offset_ns).tolist()
    sent = _rounded(cycles, "sent")
    for time_ns, q, position, omega in zip(due, *sent, strict=True):
        yield from _body(device, "sent", time_ns, time_ns, q, position, omega)
    told = np.flatnonzero(cycles["flags"] & 1)
    if not len(told):
        return
    cycles = cycles[told]
    joints = _single(cycles["measured_joints"])
    stamps = (cycles["feedback_time_ns"] + offset_ns).tolist()
    measured = _rounded(cycles, "measured")
    times = [due[k] for k in told]
    for time_ns, stamp, angles, q, position, omega in zip(
        times, stamps, joints, *measured, strict=True
    ):
        yield from _body(device, "measured", time_ns, stamp, q, position, omega)
        states = [
            JointState(name=f"{device}/axis{number}", position=angle)
            for number, angle in enumerate(angles, start=1)
            if not math.isnan(angle)
        ]
        if states:
            message = JointStates(timestamp=stamp_of(stamp), joints=states)
            yield f"/{device}/measured/joints", time_ns, message


def _rounded(cycles: Table, which: str) -> list[Any]:
    names = (f"{which}_q", f"{which}_position", f"{which}_omega_body")
    return [_single(cycles[name]) for name in names]


def _single(numbers: ArrayLike) -> Any:  # noqa: ANN401 - lists as deep as the array
    return np.asarray(numbers).astype(np.float32).astype(np.float64).tolist()


def _body(
    device: str,
    which: str,
    time_ns: int,
    stamp_ns: int,
    q: list[float],
    position: list[float],
    omega: list[float],
) -> Iterator[Shown]:
    topic, stamp = f"/{device}/{which}", stamp_of(stamp_ns)
    frame = f"{device}/{which}"
    orientation = _quaternion(q)
    place = Vector3(x=position[0], y=position[1], z=position[2])
    pose = Pose(position=place, orientation=orientation)
    transform = FrameTransform(
        timestamp=stamp,
        parent_frame_id=WORLD,
        child_frame_id=frame,
        translation=place,
        rotation=orientation,
    )
    yield f"{topic}/tf", time_ns, transform
    yield f"{topic}/pose", time_ns, PoseInFrame(timestamp=stamp, frame_id=WORLD, pose=pose)
    turning = Vector3(x=omega[0], y=omega[1], z=omega[2])
    odometry = Odometry(
        timestamp=stamp,
        frame_id=WORLD,
        body_frame_id=frame,
        pose=pose,
        angular_velocity=turning,
    )
    yield f"{topic}/odometry", time_ns, odometry


def event_shown(event: pb.Event, offset_ns: int) -> Iterator[Shown]:
    """Yield what viewers show of an event: a line of the log, and the path of a motion."""
    time_ns = event.time_ns + offset_ns
    kind = pb.EventKind.Name(event.kind).removeprefix("EVENT_KIND_").replace("_", " ").lower()
    motion = titled(event.motion_number, event.motion.name)
    number = f" {motion}" if event.motion_number else ""
    text = f": {event.text}" if event.text else ""
    log = Log(
        timestamp=stamp_of(time_ns),
        level=_LEVELS.get(event.kind, Log.INFO),
        name=event.device,
        message=f"{kind}{number}{text}",
    )
    yield "/log", time_ns, log
    if event.samples:
        poses = [
            Pose(orientation=_quaternion(_single([q.w, q.x, q.y, q.z])))
            for q in (sample.q for sample in event.samples)
        ]
        path = PosesInFrame(timestamp=stamp_of(time_ns), frame_id=WORLD, poses=poses)
        yield f"/{event.device}/planned/path", time_ns, path


def _quaternion(q: list[float]) -> Quaternion:
    return Quaternion(w=q[0], x=q[1], y=q[2], z=q[3])


def stamp_of(time_ns: int) -> Timestamp:
    """Return a time of day as viewers have it."""
    return Timestamp(seconds=time_ns // _NANOSECONDS, nanos=time_ns % _NANOSECONDS)
