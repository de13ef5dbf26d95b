"""Motion requests on the wire: the messages, key by key, as the mapping of a motion file.

There is one schema and one reader of it, that of the motion file.  A message becomes the mapping
that such a file would hold and nothing more: what is not set is not there, so that defaults,
checks and the paths in error messages are those of the file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from google.protobuf.struct_pb2 import Struct

from orientd.errors import RequestError
from orientd.rpc import control_pb2 as pb

_FRAMES = {pb.FRAME_BODY: "body", pb.FRAME_WORLD: "world"}
_LIMITS = ("velocity", "acceleration", "jerk", "linear_velocity", "linear_acceleration")


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
        limits = message.limits
        mapping["limits"] = {
            name: getattr(limits, name) for name in _LIMITS if limits.HasField(name)
        }
    if message.HasField("options"):
        mapping["options"] = _from_struct(message.options)
    return mapping


def from_mapping(mapping: Mapping[str, Any]) -> pb.MotionRequest:
    """Return the message that says what *mapping*, the content of a checked motion file, says."""
    message = pb.MotionRequest(
        method=mapping.get("method", ""),
        velocity_frame=pb.FRAME_WORLD
        if mapping.get("velocity_frame") == "world"
        else pb.FRAME_BODY,
        keyframes=[_keyframe_from_mapping(keyframe) for keyframe in mapping["keyframes"]],
    )
    for name in ("start_velocity", "end_velocity"):
        if mapping.get(name) is not None:
            x, y, z = mapping[name]
            getattr(message, name).CopyFrom(pb.Vector3(x=x, y=y, z=z))
    if mapping.get("approach") is not None:
        message.approach = mapping["approach"]
    limits = mapping.get("limits") or {}
    for name, limit in limits.items():
        if limit is not None:
            setattr(message.limits, name, limit)
    if mapping.get("options"):
        message.options.CopyFrom(_to_struct(mapping["options"]))
    return message


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


def _keyframe_from_mapping(mapping: Mapping[str, Any]) -> pb.Keyframe:
    message = pb.Keyframe(time=mapping.get("time"), turns=mapping.get("turns"))
    if mapping.get("quaternion") is not None:
        message.quaternion.CopyFrom(pb.Quaternion(**mapping["quaternion"]))
    elif mapping.get("rotation_vector") is not None:
        x, y, z = mapping["rotation_vector"]
        message.rotation_vector.CopyFrom(pb.Vector3(x=x, y=y, z=z))
    elif mapping.get("euler") is not None:
        euler = mapping["euler"]
        message.euler.CopyFrom(pb.EulerAngles(axes=euler["axes"], degrees=euler["degrees"]))
    elif mapping.get("matrix") is not None:
        elements = [element for row in mapping["matrix"] for element in row]
        message.matrix.CopyFrom(pb.Matrix(elements=elements))
    if mapping.get("position") is not None:
        x, y, z = mapping["position"]
        message.position.CopyFrom(pb.Vector3(x=x, y=y, z=z))
    return message


def _vector(message: pb.Vector3) -> list[float]:
    return [message.x, message.y, message.z]


def _to_struct(mapping: Mapping[str, Any]) -> Struct:
    struct = Struct()
    struct.update({key: _plain(content) for key, content in mapping.items()})
    return struct


def _plain(content: Any) -> Any:  # noqa: ANN401 - whatever a method's options hold
    if isinstance(content, Mapping):
        return {key: _plain(inner) for key, inner in content.items()}
    if isinstance(content, np.ndarray | np.generic):
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
