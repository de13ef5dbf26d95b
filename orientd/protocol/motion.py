"""Motion requests on the wire: from the fields of a message to those of a request, and back.

The message has the fields of a motion file, by the same names.  So reading one makes the mapping
that a file would be, and the model checks it: a value that is not well formed is refused in the
same words, by the same path.  Only keyframes in columns are read apart.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

from google.protobuf.message import Message
from google.protobuf.struct_pb2 import Struct

from orientd.errors import RequestError
from orientd.keep_out import KeepOut
from orientd.model.cones import read_cones, written_cone
from orientd.model.limits import Limits
from orientd.model.reading import read_request
from orientd.model.request import MotionRequest, Pose
from orientd.protocol import control_pb2 as pb
from orientd.protocol.limits import asked_rates, limits_message
from orientd.protocol.values import RATES, quaternion, vector

_FRAMES = (pb.FRAME_BODY, pb.FRAME_WORLD)
_FRAMED = ("start_velocity", "end_velocity", "rate")
"""Fields that are given in one of them."""

_NUMBERS = {"duration_seconds": "duration", "pace_share": "pace"}
"""Fields of a message for the numbers that stand in place of a word."""

_AS_NUMBER = {name: field for field, name in _NUMBERS.items()}


def to_request(message: pb.MotionRequest) -> MotionRequest:
    """Return what *message* asks for.

    Raises:
        RequestError: it is not well formed; a velocity needs the frame it is in, too.
    """
    if message.velocity_frame not in _FRAMES:
        for name in _FRAMED:
            if message.HasField(name):
                raise RequestError("velocity_frame", f"expected body or world, for {name}")
    content = _table(message)
    if message.HasField("columns"):
        if message.keyframes:
            raise RequestError("columns", "expected without keyframes only")
        content["keyframes"] = _rows(content.pop("columns"))
    return read_request(content)


def _table(message: Any) -> dict[str, Any]:  # noqa: ANN401 - any message
    """Return what a file would say in place of a message."""
    content: dict[str, Any] = {}
    for field, value in message.ListFields():
        if field.enum_type is not None:
            number = field.enum_type.values_by_number.get(value)
            if number is not None:
                prefix = field.enum_type.values[0].name.removesuffix("UNSPECIFIED")
                content[field.name] = number.name.removeprefix(prefix).lower()
        else:
            content[_NUMBERS.get(field.name, field.name)] = _plain(value)
    return content


def _plain(value: Any) -> Any:  # noqa: ANN401 - whatever a field holds
    if isinstance(value, str | bytes | bool | int | float):
        return value
    if isinstance(value, Message):
        read: Callable[[Any], Any] = _READERS.get(value.DESCRIPTOR.name, _table)
        return read(value)
    if isinstance(value, Mapping):
        return {key: _plain(value[key]) for key in value}
    return [_plain(one) for one in value]


def _with(*names: str) -> Callable[[Any], dict[str, Any]]:
    """Return the reader of a message whose fields are there whether or not they are set."""
    return lambda message: {name: _plain(getattr(message, name)) for name in names}


def _from_struct(content: Any) -> Any:  # noqa: ANN401 - whatever a method's options hold
    """Return plain Python values; a Struct has no integers, so whole numbers become them again."""
    if isinstance(content, Struct):
        try:
            return {key: _from_struct(content[key]) for key in content}
        except ValueError:
            raise RequestError("options", "expected a value for every key, got none") from None
    if isinstance(content, float):
        return int(content) if content.is_integer() else content
    if content is None or isinstance(content, str | bool):
        return content
    return [_from_struct(inner) for inner in content]


_READERS: dict[str, Callable[[Any], Any]] = {
    "Vector3": lambda message: [message.x, message.y, message.z],
    "Quaternion": _with("w", "x", "y", "z"),
    "EulerAngles": _with("axes", "degrees"),
    "AzimuthElevation": _with("azimuth", "elevation"),
    "LookAt": _with("point", "place"),
    "Sun": lambda message: {
        **_with("latitude", "longitude")(message),
        **({"north": message.north} if message.HasField("north") else {}),
    },
    "Matrix": lambda message: [
        list(message.elements[k : k + 3]) for k in range(0, len(message.elements), 3)
    ],
    "Limits": asked_rates,
    "Struct": _from_struct,
    "KeyframeColumns": lambda message: message,
}

_COLUMNS: tuple[tuple[str, str, int, object], ...] = (
    ("quaternions", "q", 4, None),
    ("times", "time", 1, None),
    ("positions", "position", 3, None),
    ("turns", "turns", 1, 0),
    ("free_roll", "free_roll", 1, False),
    ("relative", "relative", 1, False),
    ("frames", "frame", 1, ""),
    ("names", "name", 1, ""),
)
"""Each column: its name, the field of a keyframe, entries per keyframe, and the default.

The default is the value of the field if the column is empty.
"""

_NOWHERE = (math.nan, math.nan, math.nan)
"""In the column of positions, of a keyframe without one."""


def _rows(columns: pb.KeyframeColumns) -> list[dict[str, Any]]:
    """Return what a file would say in place of columns."""
    count = len(columns.quaternions) // 4
    given: dict[str, Any] = {}
    for column, name, width, _ in _COLUMNS:
        values = getattr(columns, column)
        if not values:
            continue
        if len(values) != width * count:
            expected = f"expected {width * count} entries for {count} keyframes"
            raise RequestError(f"columns.{column}", f"{expected}, got {len(values)}")
        given[name] = values if width == 1 else zip(*[iter(values)] * width, strict=True)
    if "position" in given:
        given["position"] = [None if math.isnan(one[0]) else one for one in given["position"]]
    given["quaternion"] = given.pop("q", ())
    return [dict(zip(given, values, strict=True)) for values in zip(*given.values(), strict=True)]


def from_request(request: MotionRequest) -> pb.MotionRequest:
    """Return *request* as a message; its orientations become quaternions."""
    message = pb.MotionRequest(**dict(_fields(request)))
    for column, name, _, usual in _COLUMNS:
        values = [getattr(keyframe, name) for keyframe in request.keyframes]
        if values.count(usual) == len(values):
            continue
        if name in ("q", "position"):
            values = [number for one in values for number in one or _NOWHERE]
        getattr(message.columns, column).extend(values)
    return message


def _fields(request: MotionRequest) -> Iterator[tuple[str, Any]]:
    for name, value in request.given().items():
        if name == "keyframes" or value in (None, {}):
            continue
        field = pb.MotionRequest.DESCRIPTOR.fields_by_name[name]
        if isinstance(value, float):
            yield _AS_NUMBER[name], value
        elif field.enum_type is not None:
            prefix = field.enum_type.values[0].name.removesuffix("UNSPECIFIED")
            yield name, f"{prefix}{value.upper()}"
        elif isinstance(value, Limits):
            yield name, limits_message({rate: value.rate(rate) for rate in RATES})
        elif name in _FRAMED:
            yield name, vector(value)
        elif name == "keep_out":
            yield name, list(map(cone_message, value))
        elif name == "frames":
            yield (
                name,
                {
                    key: pb.NamedFrame(base=_pose_message(one.base), tool=_pose_message(one.tool))
                    for key, one in value.items()
                },
            )
        elif isinstance(value, Mapping):
            struct = Struct()
            struct.update(value)
            yield name, struct
        else:
            yield name, value


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
    return tuple(cone for message in messages for cone in read_cones([_table(message)]))


def _pose_message(pose: Pose) -> pb.Pose:
    return pb.Pose(quaternion=quaternion(pose.q), position=vector(pose.position))
