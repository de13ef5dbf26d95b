"""The motion file: from YAML, JSON or a mapping to a motion request, and back.

Whatever is wrong with a motion is one :class:`~orientd.errors.RequestError` with the path of the
field, what was expected and what came:

>>> parse({"keyframes": []})
Traceback (most recent call last):
    ...
orientd.errors.RequestError: keyframes: expected at least 1, got 0
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

from orientd import plain_values as plain
from orientd.errors import RequestError
from orientd.planner import ANGULAR, UNITS, Keyframe, Limits, MotionRequest, check_method
from orientd.schema import (
    FORMS,
    KEYFRAME,
    MOTION,
    Field,
    FieldKind,
    Written,
    form_notes,
    implied,
    motion_schema,
    quaternions,
    read_frames,
    the_only,
    written_frames,
)
from orientd.structured_text import parse_structured, read_structured

__all__ = ["FORMS", "load", "loads", "motion_schema", "parse", "written"]


def load(path: str | Path) -> MotionRequest:
    """Return the request in a YAML or JSON file.

    Raises:
        RequestError: the file cannot be read, is neither YAML nor JSON, or what it says is not a
            well-formed motion.
    """
    return parse(read_structured(Path(path)))


def loads(content: bytes, name: str) -> MotionRequest:
    """Return the request in the *content* of a file called *name*; see :func:`load`."""
    return parse(parse_structured(content, name))


def parse(mapping: object) -> MotionRequest:
    """Return the request that a mapping describes.

    Args:
        mapping: of the shape of :func:`~orientd.schema.json_schema.motion_schema`.

    Raises:
        RequestError: it is not a well-formed motion.
    """
    if not isinstance(mapping, Mapping):
        expected = "a motion must be a mapping with the key 'keyframes'"
        raise RequestError("", f"{expected}, got {plain.shown(mapping)}")
    needed = () if mapping.get("rate") is not None else ("keyframes",)
    read = plain.keys(mapping, _MOTION, needed)
    keyframes, notes = read.pop("keyframes", ((), ()))
    read["notes"] = [*read.get("notes", ()), *notes]
    request = MotionRequest(keyframes, **read)
    check_method(request)
    return request


def written(request: MotionRequest) -> dict[str, Any]:
    """Return the mapping of which :func:`parse` makes *request*; defaults are left out."""
    return _written(MOTION, request)


def _limits(content: object) -> Limits | None:
    read = plain.keys(content, _LIMITS, ())
    given = {name: rate for name, rate in read.items() if rate is not None}
    return Limits.partial(**given) if given else None


def _keyframes(content: object) -> tuple[list[Keyframe], list[str]]:
    """Return the keyframes, and notes on how they were read."""
    read = plain.each(content, _keyframe)
    written = [orientation for orientation, _ in read]
    keyframes = [
        Keyframe(q, **{**others, **implied(form)})
        for q, (form, others) in zip(quaternions(written), read, strict=True)
    ]
    return keyframes, form_notes(written)


def _keyframe(content: object) -> tuple[Written, dict[str, Any]]:
    read = plain.keys(content, _KEYFRAME, ())
    orientation = the_only(read)
    return orientation, {name: value for name, value in read.items() if name not in FORMS}


def _or_nothing(reader: plain.Reader) -> plain.Reader:
    return lambda content: None if content is None else reader(content)


def _or_number(reader: plain.Reader) -> plain.Reader:
    def read(content: object) -> Any:  # noqa: ANN401 - a text or a number
        is_number = isinstance(content, int | float) and not isinstance(content, bool)
        return plain.number(content) if is_number else reader(content)

    return read


def _reader(field: Field) -> plain.Reader:
    if field.kind is FieldKind.CHOICE:
        reader = plain.one_of(field.choices)
    elif field.kind is FieldKind.CHOICE_OR_NUMBER:
        reader = _or_number(plain.one_of(field.choices))
    else:
        reader = _READERS[field.kind]
    return _or_nothing(reader) if field.is_nullable else reader


_READERS: dict[FieldKind, plain.Reader] = {
    FieldKind.TEXT: plain.text,
    FieldKind.TEXTS: partial(plain.each, reader=plain.text),
    FieldKind.FLAG: plain.flag,
    FieldKind.WHOLE: plain.whole,
    FieldKind.NUMBER: plain.number,
    FieldKind.VECTOR: plain.vector,
    FieldKind.OPTIONS: plain.options,
    FieldKind.LIMITS: _limits,
    FieldKind.KEYFRAMES: _keyframes,
    FieldKind.FRAMES: read_frames,
}
_LIMITS = {
    name: _or_nothing(plain.angular_limit if name in ANGULAR else plain.linear_limit)
    for name in UNITS
}
_KEYFRAME: dict[str, plain.Reader] = {}
for _field in KEYFRAME:
    if _field.kind is FieldKind.ORIENTATION:
        _KEYFRAME |= {form: _or_nothing(reader) for form, reader in FORMS.items()}
    else:
        _KEYFRAME[_field.name] = _reader(_field)
_MOTION = {field.name: _reader(field) for field in MOTION}


def _written(fields: tuple[Field, ...], of: object) -> dict[str, Any]:
    mapping: dict[str, Any] = {}
    for field in fields:
        value = getattr(of, field.name)
        if field.kind is FieldKind.ORIENTATION:
            mapping["quaternion"] = dict(zip("wxyz", value, strict=True))
        elif field.kind is FieldKind.KEYFRAMES:
            mapping[field.name] = [_written(KEYFRAME, keyframe) for keyframe in value]
        elif field.kind is FieldKind.FRAMES:
            mapping |= {field.name: written_frames(value)} if value else {}
        elif value != field.default:
            mapping[field.name] = _plain(field.kind, value)
    return mapping


def _plain(kind: FieldKind, value: Any) -> Any:  # noqa: ANN401 - whatever the field holds
    if kind is FieldKind.LIMITS:
        value = {name: value.rate(name) for name in UNITS if value.rate(name) != math.inf}
    return plain.to_plain(value)
