"""Motion requests on the wire: from the fields of a request to those of its message, and back.

What a message does not say has the default of the request; a value that is none is refused in the
words of the motion file, and by the path that it would have there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from google.protobuf.struct_pb2 import Struct

from orientd import plain_values as plain
from orientd.errors import RequestError
from orientd.planner import (
    ANGULAR,
    Frame,
    Keyframe,
    Limits,
    MotionRequest,
    Pose,
    Vector3,
    check_method,
)
from orientd.rpc import control_pb2 as pb
from orientd.rpc.limits import asked_rates, limits_message
from orientd.rpc.values import RATES, quaternion, vector
from orientd.schema import (
    FORMS,
    KEYFRAME,
    MOTION,
    Field,
    FieldKind,
    Written,
    form_notes,
    implied,
    quaternions,
    the_only,
)

Taker = Callable[[Any], Any]
"""Returns what a field of a message says."""

Giver = Callable[[Any], Any]
"""Returns what to say in a field of a message."""

_FRAMES = (pb.FRAME_BODY, pb.FRAME_WORLD)
_FRAMED = tuple(field.name for field in MOTION if field.kind is FieldKind.VECTOR)
"""What is given in one of them."""


def to_request(message: pb.MotionRequest) -> MotionRequest:
    """Return what *message* asks for.

    Raises:
        RequestError: it is not well formed; a velocity needs the frame it is in, too.
    """
    if message.velocity_frame not in _FRAMES:
        for name in _FRAMED:
            if message.HasField(name):
                raise RequestError("velocity_frame", f"expected body or world, for {name}")
    taken = _taken(message, _TAKEN)
    keyframes, notes = taken.pop("keyframes", ((), ()))
    if message.HasField("columns"):
        if keyframes:
            raise RequestError("columns", "expected without keyframes only")
        keyframes = _from_columns(message.columns)
    taken["notes"] = [*taken.get("notes", ()), *notes]
    request = MotionRequest(keyframes, **taken)
    check_method(request)
    return request


def from_request(request: MotionRequest) -> pb.MotionRequest:
    """Return the message that asks for what *request* does; orientations become quaternions."""
    return pb.MotionRequest(**_given(request, _BESIDE_KEYFRAMES), columns=_columns(request))


_COLUMNS: tuple[tuple[str, str, int], ...] = (
    ("quaternions", "q", 4),
    ("times", "time", 1),
    ("positions", "position", 3),
    ("turns", "turns", 1),
    ("free_roll", "free_roll", 1),
    ("relative", "relative", 1),
    ("frames", "frame", 1),
    ("names", "name", 1),
)
"""Columns, the fields of a keyframe that they are of, and how many entries each keyframe has."""


def _columns(request: MotionRequest) -> pb.KeyframeColumns:
    columns = pb.KeyframeColumns(quaternions=request.keys.ravel().tolist())
    if request.times is not None:
        columns.times.extend(request.times.tolist())
    if request.positions is not None:
        columns.positions.extend(request.positions.ravel().tolist())
    for column, name, _ in _COLUMNS[3:]:
        values = [getattr(keyframe, name) for keyframe in request.keyframes]
        if any(values):
            getattr(columns, column).extend(values)
    return columns


def _from_columns(message: pb.KeyframeColumns) -> list[Keyframe]:
    count = len(message.quaternions) // 4
    given: dict[str, Any] = {}
    for column, name, width in _COLUMNS:
        values = getattr(message, column)
        if not values:
            continue
        if len(values) != width * count:
            expected = f"expected {width * count} entries for {count} keyframes"
            raise RequestError(f"columns.{column}", f"{expected}, got {len(values)}")
        given[name] = values if width == 1 else zip(*[iter(values)] * width, strict=True)
    if "position" in given:
        given["position"] = [None if one[0] != one[0] else one for one in given["position"]]
    return [
        Keyframe(**dict(zip(given, values, strict=True)))
        for values in zip(*given.values(), strict=True)
    ]


def _limits_message(limits: Limits) -> pb.Limits:
    return limits_message({name: limits.rate(name) for name in RATES})


def _limits(message: pb.Limits) -> Limits | None:
    given = asked_rates(message)
    for name, rate in given.items():
        reader = plain.angular_limit if name in ANGULAR else plain.linear_limit
        try:
            given[name] = reader(rate)
        except RequestError as error:
            raise plain.placed(name, error) from None
    return Limits.partial(**given) if given else None


def _keyframes(messages: Iterable[pb.Keyframe]) -> tuple[list[Keyframe], list[str]]:
    """Return the keyframes, and notes on how they were read."""
    written: list[Written] = []
    others: list[dict[str, Any]] = []
    try:
        for message in messages:
            written.append(_orientation(message))
            others.append(_taken(message, _BESIDE_ORIENTATION) | implied(written[-1]))
    except RequestError as error:
        raise plain.placed(f"[{len(others)}]", error) from None
    found = quaternions(written)
    keyframes = [Keyframe(q, **more) for q, more in zip(found, others, strict=True)]
    return keyframes, form_notes(written)


def _orientation(message: pb.Keyframe) -> Written:
    form = message.WhichOneof("orientation")
    if form is None:
        return the_only({})
    try:
        return form, _FORMS[form](getattr(message, form))
    except RequestError as error:
        raise plain.placed(form, error) from None


# What is not finite is for the reader of the file to find and to name.


def _vector(message: pb.Vector3) -> Vector3:
    x, y, z = message.x, message.y, message.z
    return (x, y, z) if math.isfinite(x + y + z) else plain.vector([x, y, z])


def _quaternion(message: pb.Quaternion) -> Any:  # noqa: ANN401 - as its reader returns it
    q = message.w, message.x, message.y, message.z
    return q if math.isfinite(sum(q)) else FORMS["quaternion"](dict(zip("wxyz", q, strict=True)))


def _by_reader(form: str, as_written: Callable[[Any], Any]) -> Taker:
    """Return what takes a *form* by its reader, from what *as_written* makes of the message."""
    return lambda message: FORMS[form](as_written(message))


_WRITTEN: dict[str, Callable[[Any], Any]] = {
    "euler": lambda euler: {"axes": euler.axes, "degrees": list(euler.degrees)},
    "matrix": lambda matrix: [
        list(matrix.elements[k : k + 3]) for k in range(0, len(matrix.elements), 3)
    ],
    "azimuth_elevation": lambda to: {"azimuth": to.azimuth, "elevation": to.elevation},
    "look_at": lambda at: {"point": list(_vector(at.point)), "place": list(_vector(at.place))},
}
"""What a file would say in place of a message, of the forms that are taken by their readers."""

_FORMS: dict[str, Taker] = {
    "quaternion": _quaternion,
    "rotation_vector": _vector,
    "direction": _vector,
    **{form: _by_reader(form, as_written) for form, as_written in _WRITTEN.items()},
}


def _from_struct(content: Any) -> Any:  # noqa: ANN401 - whatever a method's options hold
    """Return plain Python values; a Struct has no integers, so whole numbers become them again."""
    if isinstance(content, Struct):
        return {key: _from_struct(content[key]) for key in content}
    if isinstance(content, float):
        return int(content) if content.is_integer() else content
    if content is None or isinstance(content, str | bool):
        return content
    return [_from_struct(inner) for inner in content]


def _to_struct(options: Mapping[str, Any]) -> Struct:
    struct = Struct()
    struct.update(plain.to_plain(options))
    return struct


def _frames(messages: Mapping[str, pb.NamedFrame]) -> dict[str, Frame]:
    found: dict[str, Frame] = {}
    for name, message in messages.items():
        try:
            found[name] = Frame(_pose(message.base, "base"), _pose(message.tool, "tool"))
        except RequestError as error:
            raise plain.placed(name, error) from None
    return found


def _pose(message: pb.Pose, place: str) -> Pose:
    q = message.quaternion
    position = message.position.x, message.position.y, message.position.z
    try:
        if not message.HasField("quaternion"):
            return Pose(position=position)
        return Pose((q.w, q.x, q.y, q.z), position)
    except RequestError as error:
        raise plain.placed(place, error) from None


def _frame_messages(frames: Mapping[str, Frame]) -> dict[str, pb.NamedFrame]:
    return {
        name: pb.NamedFrame(base=_pose_message(frame.base), tool=_pose_message(frame.tool))
        for name, frame in frames.items()
    }


def _pose_message(pose: Pose) -> pb.Pose:
    return pb.Pose(quaternion=quaternion(pose.q), position=vector(pose.position))


_KINDS: dict[FieldKind, tuple[Taker | None, Giver | None]] = {
    FieldKind.NUMBER: (plain.number, None),
    FieldKind.VECTOR: (_vector, vector),
    FieldKind.OPTIONS: (_from_struct, _to_struct),
    FieldKind.LIMITS: (_limits, _limits_message),
    FieldKind.ORIENTATION: (_quaternion, quaternion),
    FieldKind.KEYFRAMES: (_keyframes, None),
    FieldKind.FRAMES: (_frames, _frame_messages),
}
"""How a kind is taken from a message and given to one; as it is where nothing is said."""


@dataclass(frozen=True, slots=True)
class _Entry:
    """A field of a request in its message; *wire* is its name there."""

    name: str
    wire: str
    take: Taker | None = None
    give: Giver | None = None


_NUMBERS = {"duration": "duration_seconds", "pace": "pace_share"}
"""What a field is called where it is a number, not one of its choices."""


def _entries(fields: Iterable[Field], of: Any) -> Iterator[_Entry]:  # noqa: ANN401 - a descriptor
    for field in fields:
        yield _entry(field, of)
        if field.kind is FieldKind.CHOICE_OR_NUMBER:
            yield _Entry(field.name, _NUMBERS[field.name], plain.number, _number)


def _number(value: float | str) -> float | None:
    return None if isinstance(value, str) else value


def _entry(field: Field, of: Any) -> _Entry:  # noqa: ANN401 - as above
    # What a message gives is a quaternion, whichever form it was asked for in.
    name = "quaternion" if field.kind is FieldKind.ORIENTATION else field.name
    wire = of.fields_by_name[name]
    if field.choices:
        numbers = {
            choice: number.number
            for choice in field.choices
            for number in wire.enum_type.values
            if number.name.endswith(f"_{choice.upper()}")
        }
        choices = {number: choice for choice, number in numbers.items()}
        return _Entry(field.name, name, choices.get, numbers.get)
    take, give = _KINDS.get(field.kind, (None, None))
    return _Entry(field.name, name, take, give)


_MOTION = tuple(_entries(MOTION, pb.MotionRequest.DESCRIPTOR))
_BESIDE_KEYFRAMES = tuple(entry for entry in _MOTION if entry.name != "keyframes")
_KEYFRAME = tuple(_entries(KEYFRAME, pb.Keyframe.DESCRIPTOR))
_TAKEN = {entry.wire: entry for entry in _MOTION}
_BESIDE_ORIENTATION = {entry.wire: entry for entry in _KEYFRAME if entry.name == entry.wire}


def _taken(message: Any, entries: Mapping[str, _Entry]) -> dict[str, Any]:  # noqa: ANN401 - of a kind
    """Return the values that *message* sets of the fields that there are *entries* for."""
    values: dict[str, Any] = {}
    for field, value in message.ListFields():
        entry = entries.get(field.name)
        if entry is None:
            continue
        if entry.take is not None:
            try:
                value = entry.take(value)
            except RequestError as error:
                raise plain.placed(entry.name, error) from None
        if value is not None:
            values[entry.name] = value
    return values


def _given(of: object, entries: Iterable[_Entry]) -> dict[str, Any]:
    """Return what a message is made of that says the same."""
    fields: dict[str, Any] = {}
    for entry in entries:
        value = getattr(of, entry.name)
        is_empty = isinstance(value, Mapping) and not value
        if value is not None and not is_empty:
            fields[entry.wire] = value if entry.give is None else entry.give(value)
    return fields
