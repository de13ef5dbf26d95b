"""The JSON Schema of a motion file, for editors and other programs."""

from __future__ import annotations

from typing import Any

from orientd.planner import ANGULAR, UNITS, Frame, Limits
from orientd.schema.fields import KEYFRAME, MOTION, Field, FieldKind, attribute_lines
from orientd.schema.frames import POSE_FORMS
from orientd.schema.orientations import FORMS

_NUMBER = {"type": "number"}
_TRIPLE = {"type": "array", "items": _NUMBER, "minItems": 3, "maxItems": 3}
_POSITIVE = {"type": "number", "exclusiveMinimum": 0}
_AXES = {"type": "array", "items": _POSITIVE, "minItems": 3, "maxItems": 3}
_RATES = {False: (_POSITIVE,), True: (_POSITIVE, _AXES)}

_FORMS: dict[str, dict[str, Any]] = {
    "quaternion": {
        "$ref": "#/$defs/Quaternion",
        "description": "a unit quaternion, Hamilton's product, tool to world",
    },
    "rotation_vector": {**_TRIPLE, "description": "axis times angle, rad"},
    "euler": {
        "$ref": "#/$defs/Euler",
        "description": "turns about coordinate axes, one after the other",
    },
    "matrix": {
        "type": "array",
        "items": _TRIPLE,
        "minItems": 3,
        "maxItems": 3,
        "description": "rotation matrix for column vectors, row by row",
    },
    "direction": {**_TRIPLE, "description": "where to point, of any length; the roll is free"},
    "azimuth_elevation": {
        "$ref": "#/$defs/AzimuthElevation",
        "description": "where to point, as angles; the roll is free",
    },
    "look_at": {
        "anyOf": [_TRIPLE, {"$ref": "#/$defs/LookAt"}],
        "description": "a point to look at, m, from the origin or from a place; the roll is free",
    },
}

_KINDS: dict[FieldKind, dict[str, Any]] = {
    FieldKind.TEXT: {"type": "string"},
    FieldKind.TEXTS: {"type": "array", "items": {"type": "string"}},
    FieldKind.FLAG: {"type": "boolean"},
    FieldKind.WHOLE: {"type": "integer"},
    FieldKind.NUMBER: _NUMBER,
    FieldKind.VECTOR: _TRIPLE,
    FieldKind.OPTIONS: {"type": "object"},
    FieldKind.LIMITS: {"$ref": "#/$defs/Limits"},
    FieldKind.KEYFRAMES: {"type": "array", "items": {"$ref": "#/$defs/Keyframe"}},
    FieldKind.FRAMES: {"type": "object", "additionalProperties": {"$ref": "#/$defs/Frame"}},
}


def motion_schema() -> dict[str, Any]:
    """Return the JSON Schema of a motion file."""
    poses = {
        part: {"$ref": "#/$defs/Pose", "description": said.replace("``", "")}
        for part, said in attribute_lines(Frame).items()
    }
    said = attribute_lines(Limits)
    limits = {
        name: {**_or_null(*_RATES[name in ANGULAR]), "description": said[name]} for name in UNITS
    }
    axes = {
        "type": "string",
        "description": "one to three letters: xyz about fixed axes, XYZ about axes that turn along",
    }
    degrees = {"type": "array", "items": _NUMBER, "description": "one for each letter, degrees"}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "orientd motion file",
        **_table(_properties(MOTION)),
        "anyOf": [
            *({"required": [field.name]} for field in MOTION if field.is_needed),
            {"required": ["rate"]},
        ],
        "$defs": {
            "Keyframe": {
                **_table(_properties(KEYFRAME)),
                "oneOf": [{"required": [form]} for form in FORMS],
            },
            "Quaternion": _table(dict.fromkeys("wxyz", _NUMBER), *"wxyz"),
            "Euler": _table({"axes": axes, "degrees": degrees}, "axes", "degrees"),
            "AzimuthElevation": _table(
                {
                    "azimuth": {**_NUMBER, "description": "about z, from x towards y, degrees"},
                    "elevation": {**_NUMBER, "description": "above the plane of x and y, degrees"},
                },
                "azimuth",
                "elevation",
            ),
            "LookAt": _table({"point": _TRIPLE, "place": _TRIPLE}, "point"),
            "Limits": _table(limits),
            "Frame": _table(poses),
            "Pose": _table(
                {form: _FORMS[form] for form in POSE_FORMS}
                | {"position": {**_TRIPLE, "description": "of the origin, m", "default": [0, 0, 0]}}
            ),
        },
    }


def _properties(fields: tuple[Field, ...]) -> dict[str, Any]:
    properties: dict[str, Any] = {}
    for field in fields:
        if field.kind is FieldKind.ORIENTATION:
            properties |= _FORMS
        else:
            properties[field.name] = _property(field)
    return properties


def _property(field: Field) -> dict[str, Any]:
    kinds = [{"enum": list(field.choices)} if field.choices else _KINDS[field.kind]]
    if field.kind is FieldKind.CHOICE_OR_NUMBER:
        kinds.append(_NUMBER)
    kind = _or_null(*kinds) if field.is_nullable else kinds[0]
    described = {**kind, "description": field.says.replace("``", "")}
    return described if field.is_needed else {**described, "default": field.default}


def _or_null(*kinds: dict[str, Any]) -> dict[str, Any]:
    return {"anyOf": [*kinds, {"type": "null"}]}


def _table(properties: dict[str, Any], *needed: str) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": list(needed),
        "additionalProperties": False,
    }
