"""Requests with the motion in them left as the bytes that it came in.

A motion of a hundred thousand keyframes takes as long to read as a hundred retargets to serve, and
is read where it is planned.  On the wire a message and its bytes are the same, so a copy of the
protocol with one field of another type reads everything around the motion, and nothing of it.
"""

from __future__ import annotations

from google.protobuf import descriptor_pb2, message_factory
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import Message

from orientd.rpc import control_pb2 as pb

MOTION = "motion"
"""The field that is left unread."""

UNREAD = ("PlanRequest", "MoveRequest")
HOLDING_UNREAD = ("PlanLargeRequest", "MoveLargeRequest")
"""Messages that have one of those in them."""


def _classes() -> dict[str, type[Message]]:
    file = descriptor_pb2.FileDescriptorProto()
    pb.DESCRIPTOR.CopyToProto(file)
    for message in file.message_type:
        for field in message.field:
            if message.name in UNREAD and field.name == MOTION:
                field.type = descriptor_pb2.FieldDescriptorProto.TYPE_BYTES
                field.ClearField("type_name")
    pool = DescriptorPool()
    for needed in pb.DESCRIPTOR.dependencies:
        _add(pool, needed)
    pool.Add(file)
    return {
        name: message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{file.package}.{name}"))
        for name in UNREAD + HOLDING_UNREAD
    }


def _add(pool: DescriptorPool, file: FileDescriptor) -> None:
    for needed in file.dependencies:
        _add(pool, needed)
    pool.AddSerializedFile(file.serialized_pb)


CLASSES = _classes()
"""Messages with their motions unread, by name."""
