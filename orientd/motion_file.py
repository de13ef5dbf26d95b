"""The motion file: its schema, and the way from YAML, JSON or a mapping to a motion request.

One schema serves the file, the control socket and the Python client.  Whatever is wrong with a
motion is one :class:`~orientd.errors.RequestError` with the path of the field, what was expected
and what came:

>>> parse({"keyframes": []})
Traceback (most recent call last):
    ...
orientd.errors.RequestError: keyframes: expected at least 1, got 0
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from orientd.errors import RequestError
from orientd.limit_field import AngularLimit, LinearLimit
from orientd.planner import DEFAULT_METHOD, Keyframe, Limits, MotionRequest, check_method
from orientd.rotation import Floats, from_euler, from_matrix, from_rotation_vector
from orientd.spelling import unknown_key
from orientd.structured_text import parse_structured, read_structured

Number = Annotated[float, Field(allow_inf_nan=False)]
Triple = Annotated[list[Number], Field(min_length=3, max_length=3)]
Rows = Annotated[list[Triple], Field(min_length=3, max_length=3)]

_NORM_OR_AXES = "one number limits its norm, three its components in the body frame"

FORMS = ("quaternion", "rotation_vector", "euler", "matrix")


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class QuaternionModel(_Table):
    """A unit quaternion with its components by name, Hamilton's product, tool to world."""

    w: Number
    x: Number
    y: Number
    z: Number


class EulerModel(_Table):
    """Turns about coordinate axes, one after the other."""

    axes: str = Field(
        description="one to three letters: xyz about fixed axes, XYZ about axes that turn along"
    )
    degrees: list[Number] = Field(description="one angle for each letter, degrees")


class KeyframeModel(_Table):
    """An orientation to pass, in exactly one of its four forms."""

    time: Number | None = Field(default=None, description="s; in all keyframes or in none")
    quaternion: QuaternionModel | None = None
    rotation_vector: Triple | None = Field(default=None, description="axis times angle, rad")
    euler: EulerModel | None = None
    matrix: Rows | None = Field(
        default=None, description="rotation matrix for column vectors, row by row"
    )
    position: Triple | None = Field(default=None, description="of the tool in the world, m")
    turns: int = Field(
        default=0, description="whole turns on the way from the previous keyframe to this one"
    )


class LimitsModel(_Table):
    """Limits below those of the device; the device's own where nothing is said."""

    velocity: AngularLimit | None = Field(
        default=None, description=f"angular velocity, rad/s; {_NORM_OR_AXES}"
    )
    acceleration: AngularLimit | None = Field(
        default=None, description=f"angular, rad/s^2; {_NORM_OR_AXES}"
    )
    jerk: AngularLimit | None = Field(
        default=None, description=f"angular, rad/s^3; {_NORM_OR_AXES}"
    )
    linear_velocity: LinearLimit | None = Field(default=None, description="of the position, m/s")
    linear_acceleration: LinearLimit | None = Field(default=None, description="of it, m/s^2")


class MotionModel(_Table):
    """A motion to plan."""

    method: str = Field(default=DEFAULT_METHOD, description="a name that `orientd methods` lists")
    keyframes: list[KeyframeModel] = Field(
        description="at least one; a single one is where to go from wherever the device is"
    )
    velocity_frame: Literal["body", "world"] = Field(
        default="body", description="frame of start_velocity and end_velocity"
    )
    start_velocity: Triple | None = Field(default=None, description="at the first keyframe, rad/s")
    end_velocity: Triple | None = Field(default=None, description="at the last keyframe, rad/s")
    approach: bool = Field(
        default=False, description="lead in from wherever the device is commanded to be"
    )
    duration: Literal["minimum"] | None = Field(
        default=None,
        description="minimum: along the curve as quickly as the limits permit at every point; "
        "keyframes have no times then",
    )
    limits: LimitsModel = LimitsModel()
    options: dict[str, Any] = Field(default_factory=dict, description="of the method")
    device_options: dict[str, Any] = Field(
        default_factory=dict, description="of the device's driver, for this motion"
    )


def motion_schema() -> dict[str, Any]:
    """Return the JSON Schema of a motion file."""
    schema = MotionModel.model_json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    schema["title"] = "orientd motion file"
    return schema


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
        mapping: of the shape of :func:`motion_schema`.

    Raises:
        RequestError: it is not a well-formed motion.
    """
    if not isinstance(mapping, Mapping):
        raise RequestError(
            "", f"a motion must be a mapping with the key 'keyframes', got {_shown(mapping)}"
        )
    try:
        model = MotionModel.model_validate(mapping)
    except ValidationError as error:
        raise _first_problem(error) from None
    orientations = _orientations(model.keyframes)
    request = MotionRequest(
        keyframes=[
            Keyframe(
                q=q, time=keyframe.time, position=_triple(keyframe.position), turns=keyframe.turns
            )
            for q, keyframe in zip(orientations, model.keyframes, strict=True)
        ],
        method=model.method,
        start_velocity=_triple(model.start_velocity),
        end_velocity=_triple(model.end_velocity),
        velocity_frame=model.velocity_frame,
        approach=model.approach,
        limits=_limits(model.limits),
        duration=model.duration,
        options=model.options,
        device_options=model.device_options,
    )
    check_method(request)
    return request


def _triple(components: list[float] | None) -> tuple[float, float, float] | None:
    if components is None:
        return None
    x, y, z = components
    return x, y, z


def _limits(model: LimitsModel) -> Limits | None:
    given = model.model_dump(exclude_none=True)
    return Limits.partial(**given) if given else None


def _orientations(keyframes: Sequence[KeyframeModel]) -> list[Any]:
    """Return the orientations as tuples (w, x, y, z), each kind of form converted at once."""
    by_form: dict[str, list[int]] = {form: [] for form in FORMS}
    for index, keyframe in enumerate(keyframes):
        of_forms = keyframe.quaternion, keyframe.rotation_vector, keyframe.euler, keyframe.matrix
        given = [form for form, one in zip(FORMS, of_forms, strict=True) if one is not None]
        if len(given) != 1:
            expected = f"expected one of {', '.join(FORMS)}"
            came = f"got {' and '.join(given)}" if given else "got none of them"
            raise RequestError(f"keyframes[{index}]", f"{expected}; {came}")
        by_form[given[0]].append(index)
    table: Floats = np.empty((len(keyframes), 4))
    for index in by_form["quaternion"]:
        q = keyframes[index].quaternion
        if q is not None:
            table[index] = q.w, q.x, q.y, q.z
    _convert(table, keyframes, "rotation_vector", by_form, from_rotation_vector)
    _convert(table, keyframes, "matrix", by_form, from_matrix)
    for index in by_form["euler"]:
        euler = keyframes[index].euler
        if euler is not None:
            table[index] = _from_euler(euler, f"keyframes[{index}].euler")
    return list(map(tuple, table.tolist()))


def _convert(
    table: Floats,
    keyframes: Sequence[KeyframeModel],
    form: str,
    by_form: Mapping[str, list[int]],
    converted: Callable[[Any], Floats],
) -> None:
    indices = by_form[form]
    if not indices:
        return
    given = np.array([getattr(keyframes[index], form) for index in indices], dtype=np.float64)
    try:
        table[indices] = converted(given)
    except ValueError:
        # Once more, one by one, to find the one that is wrong.
        for index, one in zip(indices, given, strict=True):
            try:
                converted(one)
            except ValueError as error:
                problem = str(error).removeprefix(f"{form} ")
                raise RequestError(f"keyframes[{index}].{form}", problem) from None


def _from_euler(euler: EulerModel, field: str) -> Floats:
    try:
        from_euler(euler.axes, [0.0] * len(euler.axes))
    except ValueError as error:
        raise RequestError(f"{field}.axes", str(error).removeprefix("axes ")) from None
    if len(euler.degrees) != len(euler.axes):
        raise RequestError(
            f"{field}.degrees",
            f"expected {len(euler.axes)} angles for the axes {euler.axes!r}, "
            f"got {len(euler.degrees)}",
        )
    return from_euler(euler.axes, [math.radians(angle) for angle in euler.degrees])


_EXPECTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": "a text",
    "finite_number": "a finite number",
    "greater_than": "a number greater than 0",
    "list_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
}


def _first_problem(error: ValidationError) -> RequestError:
    """Return the first of pydantic's complaints in our words."""
    problems = error.errors(include_url=False)
    first = problems[0]
    if first["type"] == "missing":
        # A key that is missing is more often misspelt than forgotten.
        parent = first["loc"][:-1]
        misspelt = (
            p for p in problems if p["type"] == "extra_forbidden" and p["loc"][:-1] == parent
        )
        first = next(misspelt, first)
    kind, place, came = first["type"], first["loc"], first["input"]
    if kind == "extra_forbidden":
        return RequestError(_path(place), unknown_key(str(place[-1]), _known_keys(place[:-1])))
    if kind == "missing":
        return RequestError(_path(place), "missing")
    if kind in ("too_long", "too_short"):
        return RequestError(_path(place), f"expected 3 entries, got {len(came)}")
    expected = _EXPECTED.get(kind) or first["msg"].removeprefix("Input should be ")
    return RequestError(_path(place), f"expected {expected}, got {_shown(came)}")


def _path(place: Sequence[str | int]) -> str:
    path = ""
    for part in place:
        path += f"[{part}]" if isinstance(part, int) else f".{part}" if path else str(part)
    return path


_MODELS: dict[str, type[_Table]] = {
    "limits": LimitsModel,
    "quaternion": QuaternionModel,
    "euler": EulerModel,
    "keyframes": KeyframeModel,
}


def _known_keys(place: Sequence[str | int]) -> list[str]:
    names = [part for part in place if isinstance(part, str)]
    model = _MODELS[names[-1]] if names else MotionModel
    return list(model.model_fields)


def _shown(came: object) -> str:
    """Return what came, in the words of a file, on one short line."""
    if came is None:
        return "nothing"
    if isinstance(came, str):
        text = f"the text {came!r}"
        if _is_number(came):
            text += (
                " (YAML takes it for a number when written with a point and a sign: 1.0e+3)"
                if "e" in came.lower()
                else " (without quotes it would be a number)"
            )
        return text if len(text) <= 120 else f"{text[:117]}..."
    if isinstance(came, bool):
        return "true" if came else "false"
    # Aliases can make a value that would take for ever to write out in full.
    text = reprlib.repr(came)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
