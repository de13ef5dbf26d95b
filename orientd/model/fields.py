"""The types of the fields of a request, and how their values are read.

Numbers must be finite numbers; text and booleans are refused.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, NotRequired

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainValidator,
    Strict,
    WithJsonSchema,
    WrapValidator,
)
from typing_extensions import TypedDict

from orientd.errors import RequestError
from orientd.model.limits import Limits, angular_rate, linear_rate
from orientd.model.plain import shown, to_plain

CONFIG = ConfigDict(extra="forbid", validate_by_name=True, validate_by_alias=True)
"""Every table refuses unknown keys."""

LONGEST_NAME = 80
"""Characters."""

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Text = Annotated[str, Strict()]
Flag = Annotated[bool, Strict()]
Whole = Annotated[int, Strict(), BeforeValidator(to_plain)]


class StrictTable(TypedDict):
    """A table that refuses unknown keys."""

    __pydantic_config__ = ConfigDict(extra="forbid")  # type: ignore[misc] # pydantic's way


class Components(StrictTable):
    """A unit quaternion, Hamilton's product, tool to world."""

    w: Number
    x: Number
    y: Number
    z: Number


class EulerAngles(StrictTable):
    """Successive turns about coordinate axes.

    Attributes:
        axes: one to three letters: xyz about fixed axes, XYZ about axes that turn with the body.
        degrees: one angle for each letter, degrees.
    """

    axes: Text
    degrees: list[Number]


class AzimuthElevation(StrictTable):
    """A pointing direction as angles; the roll is free.

    Attributes:
        azimuth: about z, from x towards y, degrees, from -720 to 720.
        elevation: above the plane of x and y, degrees, from -180 to 180; beyond 90 it points
            backwards.
    """

    azimuth: Number
    elevation: Number


def _components(content: object, read: Any) -> tuple[float, ...]:  # noqa: ANN401 - pydantic's
    """Return the components of a quaternion from a mapping; the order of a list is ambiguous."""
    if isinstance(content, tuple) or hasattr(content, "tolist"):
        numbers = content if isinstance(content, tuple) else tuple(content.tolist())
        if len(numbers) != 4:
            raise RequestError("", f"expected four numbers w, x, y, z, got {content}; give 4")
        if set(map(type, numbers)) == {float} and math.isfinite(sum(numbers)):
            return numbers
        content = dict(zip("wxyz", numbers, strict=True))
    if not isinstance(content, Mapping):
        expected = "expected {w: ..., x: ..., y: ..., z: ...}"
        raise RequestError("", f"{expected}, got {shown(content)}; name the components")
    return tuple(read(content).values())


def _three(content: object) -> object:
    """Return the components of a vector as a list, or refuse what is none."""
    plain = to_plain(content)
    if not isinstance(plain, list | tuple):
        step = "write them as [x, y, z]"
        raise RequestError("", f"expected three numbers, got {shown(content)}; {step}")
    return plain


def _printable(text: str) -> str:
    if len(text) > LONGEST_NAME or not text.isprintable():
        expected = f"expected at most {LONGEST_NAME} printable characters"
        raise RequestError("", f"{expected}, got {len(text)}: {text[:20]!r}; give a shorter one")
    return text


def _limits(content: object, read: Any) -> Limits | None:  # noqa: ANN401 - pydantic's
    """Return the limits of a request; ``None`` if it gives none."""
    if content is None or isinstance(content, Limits):
        return content
    rates = {name: rate for name, rate in read(to_plain(content)).items() if rate is not None}
    return Limits.partial(**rates) if rates else None


def _read_by(reader: Callable[[object], Any]) -> PlainValidator:
    def read(content: object) -> Any:  # noqa: ANN401 - a limit, or three
        try:
            return None if content is None else reader(content)
        except ValueError as error:
            value = shown(content)
            step = "" if value.endswith(")") else "; give such a limit, or leave it out"
            raise RequestError("", f"expected {error}, got {value}{step}") from None

    return PlainValidator(read)


_POSITIVE: dict[str, Any] = {"type": "number", "exclusiveMinimum": 0}
_AXES: dict[str, Any] = {"type": "array", "items": _POSITIVE, "minItems": 3, "maxItems": 3}
_NOTHING: dict[str, Any] = {"type": "null"}
AngularRate = Annotated[
    Any, _read_by(angular_rate), WithJsonSchema({"anyOf": [_POSITIVE, _AXES, _NOTHING]})
]
LinearRate = Annotated[Any, _read_by(linear_rate), WithJsonSchema({"anyOf": [_POSITIVE, _NOTHING]})]


class Rates(StrictTable, total=False):
    """Limits of a motion; a missing one is the device's own.

    Attributes:
        velocity: angular velocity, rad/s.
        acceleration: angular acceleration, rad/s^2.
        jerk: angular jerk, rad/s^3.
        linear_velocity: velocity of the position, m/s.
        linear_acceleration: acceleration of the position, m/s^2.
    """

    velocity: AngularRate
    acceleration: AngularRate
    jerk: AngularRate
    linear_velocity: LinearRate
    linear_acceleration: LinearRate


def word_or_number(word: str, most: float, unit: str) -> BeforeValidator:
    """Return a check for nothing, a *word*, or a number above 0 and at most *most*."""

    def check(content: object) -> object:
        if content is None or content == word:
            return content
        is_number = isinstance(content, int | float) and not isinstance(content, bool)
        if is_number and 0.0 < content <= most and content != math.inf:  # type: ignore[operator]
            return content
        value = shown(content)
        span = f", at most {most:g}" if most < math.inf else ""
        step = "" if value.endswith(")") else f"; give a number above 0{span}"
        raise RequestError("", f"expected {word!r} or {unit}, got {value}{step}")

    return BeforeValidator(check)


if TYPE_CHECKING:
    from orientd import driver

    Quaternion = driver.Quaternion
    Vector3 = driver.Vector3
    Name = str
    AskedLimits = Limits
    Options = Mapping[str, Any]
    Rows = Sequence[Vector3]
else:
    Quaternion = Annotated[Components, WrapValidator(_components)]
    Vector3 = Annotated[tuple[Number, Number, Number], BeforeValidator(_three)]
    Rows = Annotated[tuple[Vector3, Vector3, Vector3], BeforeValidator(to_plain)]
    Name = Annotated[Text, AfterValidator(_printable)]
    AskedLimits = Annotated[Rates, WrapValidator(_limits)]
    Options = Annotated[
        dict[Text, Any], BeforeValidator(to_plain), AfterValidator(MappingProxyType)
    ]


class PointFromPlace(StrictTable):
    """A point to look at, and the position to look from; the roll is free.

    Attributes:
        point: point to look at, m.
        place: position to look from, m; by default the origin.
    """

    point: Vector3
    place: NotRequired[Vector3]


def _seen_from(content: object) -> object:
    """Return a point alone as a point seen from the origin."""
    content = to_plain(content)
    return {"point": content} if isinstance(content, list) else content


LookAt = Annotated[
    PointFromPlace, BeforeValidator(_seen_from, json_schema_input_type=Vector3 | PointFromPlace)
]
