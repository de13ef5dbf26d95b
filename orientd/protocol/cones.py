"""Keep-out cones on the wire."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from google.protobuf.message import Message

from orientd.keep_out import KeepOut
from orientd.model.cones import read_cones, written_cone
from orientd.protocol import control_pb2 as pb
from orientd.protocol.values import vector


def cone_message(cone: KeepOut) -> pb.KeepOut:
    """Return a keep-out cone as a message."""
    table = written_cone(cone)
    for name in table.keys() & {"direction", "axis"}:
        table[name] = vector(table[name])
    return pb.KeepOut(**table)


def to_cones(messages: Iterable[pb.KeepOut]) -> tuple[KeepOut, ...]:
    """Return the keep-out cones of messages, one at a time: names may repeat.

    Raises:
        RequestError: one is not well formed.
    """
    return tuple(cone for message in messages for cone in read_cones([_plain(message)]))


def _plain(value: Any) -> Any:  # noqa: ANN401 - a cone, or a part of it
    """Return the mapping that a file would have in place of a message."""
    if isinstance(value, pb.Vector3):
        return [value.x, value.y, value.z]
    if not isinstance(value, Message):
        return value
    return {
        field.name: _plain(getattr(value, field.name))
        for field in value.DESCRIPTOR.fields
        if not field.has_presence or value.HasField(field.name)
    }
