"""The JSON Schema of a motion file, for editors and other programs, made from the model."""

from __future__ import annotations

import re
from inspect import cleandoc
from typing import Any

from pydantic import TypeAdapter

from orientd.model import cones, fields
from orientd.model.orientation import FORMS
from orientd.model.request import Frame, Keyframe, MotionRequest, Pose

_NAMES = {
    "Components": "Quaternion",
    "EulerAngles": "Euler",
    "Rates": "Limits",
    "PointFromPlace": "LookAt",
    "Cone": "KeepOut",
}


def attribute_lines(of: type) -> dict[str, str]:
    """Return the docstring's description of each attribute of a class."""
    _, _, listed = cleandoc(of.__doc__ or "").partition("Attributes:\n")
    listed = re.split(r"^\S", listed, maxsplit=1, flags=re.MULTILINE)[0]
    entries = re.findall(r"^    (\w+): (.*(?:\n {8}.*)*)", listed, flags=re.MULTILINE)
    return {name: " ".join(said.split()) for name, said in entries}


def motion_schema() -> dict[str, Any]:
    """Return the JSON Schema of a motion file."""
    made = TypeAdapter(MotionRequest).json_schema()
    tables: dict[str, Any] = {"MotionRequest": made, **made["$defs"]}
    for kind in (
        MotionRequest,
        Keyframe,
        Frame,
        Pose,
        *vars(fields).values(),
        cones.Cone,
        cones.Place,
    ):
        table = tables.get(getattr(kind, "__name__", ""), {})
        for name, said in attribute_lines(kind).items() if table else ():
            key = "quaternion" if name == "q" else name
            table["properties"][key]["description"] = said.replace("``", "")
    tables["Keyframe"]["oneOf"] = [{"required": [form]} for form in FORMS]
    schema: dict[str, Any] = _plain(
        {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            **made,
            "title": "orientd motion file",
            "anyOf": [{"required": ["keyframes"]}, {"required": ["rate"]}],
        }
    )
    inner = sorted(schema["$defs"].items(), key=lambda table: table[0] != "Keyframe")
    schema["$defs"] = {_NAMES.get(name, name): table for name, table in inner}
    return schema


def _plain(schema: Any) -> Any:  # noqa: ANN401 - any part of it
    """Return a part of a schema, shorter: no titles but the first, one item type for a list."""
    if isinstance(schema, list):
        return [_plain(one) for one in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return {**schema, "$ref": f"#/$defs/{_NAMES.get(name, name)}"}
    inner = {
        key: _plain(one)
        for key, one in schema.items()
        if not (key == "title" and isinstance(one, str) and one != "orientd motion file")
    }
    if inner.get("default") is None:
        inner.pop("default", None)
    if "Attributes:" in str(inner.get("description")):
        inner["description"] = inner["description"].partition("\n")[0]
    if "const" in inner:
        inner["enum"] = [inner.pop("const")]
    if "prefixItems" in inner:
        inner["items"] = inner.pop("prefixItems")[0]
    if inner.get("type") == "object" and "properties" in inner:
        inner.setdefault("required", [])
    return inner
