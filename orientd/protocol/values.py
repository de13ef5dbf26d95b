"""Small values on the wire: vectors and quaternions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.model.limits import UNITS
from orientd.protocol import control_pb2 as pb

if TYPE_CHECKING:
    from google.protobuf.message import Message

    from orientd.driver import Quaternion, Vector3

RATES = tuple(UNITS)


def vector(vector: Vector3) -> pb.Vector3:
    """Return the message of a vector."""
    return pb.Vector3(x=vector[0], y=vector[1], z=vector[2])


def to_vector(message: pb.Vector3) -> Vector3:
    """Return the vector of a message."""
    return (message.x, message.y, message.z)


def quaternion(q: Quaternion) -> pb.Quaternion:
    """Return the message of a quaternion."""
    return pb.Quaternion(w=q[0], x=q[1], y=q[2], z=q[3])


def to_quaternion(message: pb.Quaternion) -> Quaternion:
    """Return the quaternion of a message."""
    return (message.w, message.x, message.y, message.z)


def field_number(message: type[Message], name: str) -> int:
    """Return the number of a field of *message*."""
    number: int = message.DESCRIPTOR.fields_by_name[name].number
    return number


def embedded(number: int, content: bytes) -> bytes:
    """Return serialised *content* as the field with that number of another message.

    The field is a message or bytes.  Serialised messages put one behind the other are merged.
    """
    size, length = len(content), bytearray()
    while size > 0x7F:
        length.append(size & 0x7F | 0x80)
        size >>= 7
    length.append(size)
    return bytes([number << 3 | 2]) + length + content
