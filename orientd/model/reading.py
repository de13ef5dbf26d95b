"""Convert a request from plain values, as in a file or a message, and back."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any

from pydantic import TypeAdapter, ValidationError

from orientd.errors import RequestError
from orientd.keep_out import KeepOut
from orientd.model.cones import written_cone
from orientd.model.limits import UNITS, Limits
from orientd.model.plain import shown, to_plain
from orientd.model.refusal import refused
from orientd.model.request import Frame, Keyframe, MotionRequest, Pose


def read_request(content: object) -> MotionRequest:
    """Return the request that a mapping describes.

    Args:
        content: follows :func:`~orientd.model.schema.motion_schema`.

    Raises:
        RequestError: it is not a well-formed motion.
    """
    if not isinstance(content, Mapping):
        expected = "a motion must be a mapping with the key 'keyframes'"
        raise RequestError("", f"{expected}, got {shown(content)}")
    request: MotionRequest = read_as(MotionRequest, content)
    return request


def read_keyframe(content: object) -> Keyframe:
    """Return the keyframe that a mapping describes.

    Raises:
        RequestError: it is not well formed.
    """
    keyframe: Keyframe = read_as(Keyframe, content)
    return keyframe


def read_frames(content: object) -> dict[str, Frame]:
    """Return frames by name.

    Raises:
        RequestError: one is not well formed.
    """
    frames: dict[str, Frame] = read_as(dict[str, Frame], content)
    return frames


def read_as(of: Any, content: object) -> Any:  # noqa: ANN401 - any type
    """Return *content* as a value of the type *of*, such as a table of fields of the model.

    Raises:
        RequestError: it is not well formed.
    """
    try:
        # A quaternion's attribute is `q` as in formulas, which is no key of a file.
        return _adapter(of).validate_python(content, by_alias=True, by_name=False)
    except ValidationError as error:
        raise refused(error, of) from None


@cache
def _adapter(of: Any) -> TypeAdapter[Any]:  # noqa: ANN401 - any type
    return TypeAdapter(of)


def written(request: MotionRequest) -> dict[str, Any]:
    """Return *request* as the mapping that :func:`read_request` reads, without defaults."""
    return _written(request)


def _written(of: object) -> dict[str, Any]:
    mapping: dict[str, Any] = {}
    for name, default in _FIELDS[type(of)].items():
        value = getattr(of, name)
        if name == "q":
            mapping["quaternion"] = dict(zip("wxyz", value, strict=True))
        elif value != default:
            mapping[name] = _plain(value)
    return mapping


def _plain(value: object) -> Any:  # noqa: ANN401 - any field
    if type(value) in _FIELDS:
        return _written(value)
    if isinstance(value, Limits):
        rates = {name: value.rate(name) for name in UNITS}
        return to_plain({name: rate for name, rate in rates.items() if rate != math.inf})
    if isinstance(value, KeepOut):
        return written_cone(value)
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return value


# Users write the time of a keyframe first.
_MODELS: tuple[Any, ...] = (MotionRequest, Keyframe, Frame, Pose)
_FIELDS: dict[type, dict[str, Any]] = {
    kind: {
        name: entry.get_default(call_default_factory=True)
        for name, entry in sorted(
            kind.__pydantic_fields__.items(), key=lambda field: field[0] != "time"
        )
    }
    for kind in _MODELS
}
