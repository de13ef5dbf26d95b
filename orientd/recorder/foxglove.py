"""Frames for the 3D view of Foxglove, and events as lines of its log."""

from __future__ import annotations

from collections.abc import Iterator

from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.timestamp_pb2 import Timestamp

from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import titled
from orientd.recorder.columns import Table
from orientd.stream.records import CycleFlag

_LEVELS = {
    pb.EVENT_KIND_FAULT: Log.ERROR,
    pb.EVENT_KIND_SERVO_DIED: Log.ERROR,
    pb.EVENT_KIND_RECORDING_FAILED: Log.ERROR,
    pb.EVENT_KIND_MOTION_STOPPED: Log.WARNING,
    pb.EVENT_KIND_MOTION_REPLACED: Log.WARNING,
    pb.EVENT_KIND_MOTION_UNSETTLED: Log.WARNING,
    pb.EVENT_KIND_WARNING: Log.WARNING,
}


def frames(device: str, cycles: Table, offset_ns: int) -> Iterator[tuple[int, FrameTransform]]:
    """Yield log time and transform of the frames ``DEVICE/sent`` and ``DEVICE/measured``.

    The transform of a measured frame has the time of the measurement.

    Args:
        device: its name.
        cycles: that are shown.
        offset_ns: from the monotonic clock to the time of day.
    """
    measured = cycles[(cycles["flags"] & CycleFlag.FEEDBACK) != 0]
    for which, rows, stamps in (
        ("sent", cycles, cycles["deadline_ns"]),
        ("measured", measured, measured["feedback_time_ns"]),
    ):
        for due, stamp, q, position in zip(
            (rows["deadline_ns"] + offset_ns).tolist(),
            (stamps + offset_ns).tolist(),
            rows[f"{which}_q"].tolist(),
            rows[f"{which}_position"].tolist(),
            strict=True,
        ):
            yield (
                due,
                FrameTransform(
                    timestamp=_stamp(stamp),
                    parent_frame_id="world",
                    child_frame_id=f"{device}/{which}",
                    translation=Vector3(x=position[0], y=position[1], z=position[2]),
                    rotation=Quaternion(w=q[0], x=q[1], y=q[2], z=q[3]),
                ),
            )


def log_line(event: pb.Event, time_ns: int) -> Log:
    """Return an event as a line of the log, at a time of day."""
    kind = pb.EventKind.Name(event.kind).removeprefix("EVENT_KIND_").replace("_", " ").lower()
    motion = f" {titled(event.motion_number, event.plan.name)}" if event.motion_number else ""
    text = f": {event.text}" if event.text else ""
    return Log(
        timestamp=_stamp(time_ns),
        level=_LEVELS.get(event.kind, Log.INFO),
        name=event.device,
        message=f"{kind}{motion}{text}",
    )


def _stamp(time_ns: int) -> Timestamp:
    seconds, nanos = divmod(time_ns, 1_000_000_000)
    return Timestamp(seconds=seconds, nanos=nanos)
