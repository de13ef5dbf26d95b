"""Motion requests on the wire: the messages, key by key, as the mapping of a motion file.

There is one schema and one reader of it, that of the motion file.  A message becomes the mapping
that such a file would hold and nothing more: what is not set is not there, so that defaults,
checks and the paths in error messages are those of the file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from google.protobuf.struct_pb2 import Struct

from orientd.errors import RequestError
from orientd.planner import ANGULAR, Limits, Rate
from orientd.rpc import control_pb2 as pb
from orientd.rpc.wire.values import RATES, quaternion, vector

if TYPE_CHECKING:
    from orientd.planner import Keyframe, MotionRequest

_FRAMES = {pb.FRAME_BODY: "body", pb.FRAME_WORLD: "world"}


def to_mapping(message: pb.MotionRequest) -> dict[str, Any]:
    """Return what a motion file would say instead of *message*.

    Raises:
        RequestError: a velocity is given without the frame it is in, which a message must say.
    """
    mapping: dict[str, Any] = {}
    if message.method:
        mapping["method"] = message.method
    mapping["keyframes"] = [_keyframe_to_mapping(keyframe) for keyframe in message.keyframes]
    if message.velocity_frame in _FRAMES:
        mapping["velocity_frame"] = _FRAMES[message.velocity_frame]
    for name in ("start_velocity", "end_velocity"):
        if message.HasField(name):
            if message.velocity_frame not in _FRAMES:
                raise RequestError("velocity_frame", f"expected body or world, for {name}")
            mapping[name] = _vector(getattr(message, name))
    if message.HasField("approach"):
        mapping["approach"] = message.approach
    if message.HasField("limits"):
        mapping["limits"] = _limits_to_mapping(message.limits)
    if message.duration == pb.DURATION_MINIMUM:
        mapping["duration"] = "minimum"
    for name in ("options", "device_options"):
        if message.HasField(name):
            mapping[name] = _from_struct(getattr(message, name))
    return mapping


def from_request(request: MotionRequest) -> pb.MotionRequest:
    """Return the message that asks for what *request* does; orientations become quaternions."""
    message = pb.MotionRequest(
        method=request.method,
        velocity_frame=pb.FRAME_WORLD if request.velocity_frame == "world" else pb.FRAME_BODY,
        approach=request.approach,
        keyframes=[_keyframe_from(keyframe) for keyframe in request.keyframes],
    )
    if request.start_velocity is not None:
        message.start_velocity.CopyFrom(vector(request.start_velocity))
    if request.end_velocity is not None:
        message.end_velocity.CopyFrom(vector(request.end_velocity))
    if request.limits is not None:
        message.limits.CopyFrom(limits_message({n: request.limits.rate(n) for n in RATES}))
    if request.duration == "minimum":
        message.duration = pb.DURATION_MINIMUM
    for name in ("options", "device_options"):
        if options := getattr(request, name):
            getattr(message, name).update(_plain(options))
    return message


def limits_message(rates: Mapping[str, Rate]) -> pb.Limits:
    """Return the message of limits; infinite ones are left out.

    Raises:
        RequestError: there is no such limit.
    """
    message = pb.Limits()
    for name, limit in rates.items():
        if name not in RATES:
            raise RequestError(f"limits.{name}", f"expected one of {', '.join(RATES)}")
        if not isinstance(limit, int | float):
            x, y, z = map(float, limit)
            getattr(message, f"axis_{name}").CopyFrom(vector((x, y, z)))
        elif math.isfinite(limit):
            setattr(message, name, limit)
    return message


def limits_to_wish(message: pb.Limits) -> Limits:
    """Return limits that a caller asks for, infinite where the message says nothing.

    Raises:
        RequestError: one is not positive, or is given twice.
    """
    try:
        return Limits.partial(**_limits_to_mapping(message))
    except ValueError as error:
        raise RequestError("limits", str(error)) from error


def _limits_to_mapping(message: pb.Limits) -> dict[str, Any]:
    mapping: dict[str, Any] = {
        name: getattr(message, name) for name in RATES if message.HasField(name)
    }
    for name in ANGULAR:
        axes = f"axis_{name}"
        if message.HasField(axes):
            if name in mapping:
                raise RequestError(f"limits.{name}", f"expected one of {name} and {axes}, got both")
            mapping[name] = _vector(getattr(message, axes))
    return mapping


def _keyframe_to_mapping(message: pb.Keyframe) -> dict[str, Any]:
    mapping: dict[str, Any] = {}
    if message.HasField("time"):
        mapping["time"] = message.time
    form = message.WhichOneof("orientation")
    if form == "quaternion":
        q = message.quaternion
        mapping[form] = {"w": q.w, "x": q.x, "y": q.y, "z": q.z}
    elif form == "rotation_vector":
        mapping[form] = _vector(message.rotation_vector)
    elif form == "euler":
        mapping[form] = {"axes": message.euler.axes, "degrees": list(message.euler.degrees)}
    elif form == "matrix":
        elements = list(message.matrix.elements)
        mapping[form] = [elements[k : k + 3] for k in range(0, len(elements), 3)]
    if message.HasField("position"):
        mapping["position"] = _vector(message.position)
    if message.HasField("turns"):
        mapping["turns"] = message.turns
    return mapping


def _keyframe_from(keyframe: Keyframe) -> pb.Keyframe:
    message = pb.Keyframe(
        time=keyframe.time, quaternion=quaternion(keyframe.q), turns=keyframe.turns or None
    )
    if keyframe.position is not None:
        message.position.CopyFrom(vector(keyframe.position))
    return message


def _vector(message: pb.Vector3) -> list[float]:
    return [message.x, message.y, message.z]


def _plain(content: Any) -> Any:  # noqa: ANN401 - whatever a method's options hold
    if isinstance(content, Mapping):
        return {key: _plain(inner) for key, inner in content.items()}
    if hasattr(content, "tolist"):  # an array or a number of NumPy's
        return content.tolist()
    if isinstance(content, list | tuple):
        return [_plain(inner) for inner in content]
    return content


def _from_struct(content: Any) -> Any:  # noqa: ANN401 - whatever a method's options hold
    """Return plain Python values; a Struct has no integers, so whole numbers become them again."""
    if isinstance(content, Struct):
        return {key: _from_struct(content[key]) for key in content}
    if isinstance(content, float):
        return int(content) if content.is_integer() else content
    if content is None or isinstance(content, str | bool):
        return content
    return [_from_struct(inner) for inner in content]
