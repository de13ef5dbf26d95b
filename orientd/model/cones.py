"""Keep-out cones of a motion file or configuration: the table, and how it is read and written."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, NotRequired

from pydantic import BeforeValidator, TypeAdapter, ValidationError, WrapValidator

from orientd.errors import RequestError
from orientd.keep_out import MOST_CONES, KeepOut
from orientd.model.fields import AzimuthElevation, Number, StrictTable, Text, Vector3
from orientd.model.orientation import read
from orientd.model.plain import shown, to_plain
from orientd.model.refusal import refused
from orientd.sun import NORTH, Sun
from orientd.tolerances import ROUNDING

if TYPE_CHECKING:
    from orientd import driver

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,31}")
_WIDEST = 90.0
"""Largest angle from a cone's direction to the end of its margin, degrees."""
_FORMS = "direction", "azimuth_elevation", "sun"
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


class Place(StrictTable):
    """The location of the device on the earth.

    Attributes:
        latitude: degrees, north positive.
        longitude: degrees, east positive.
        north: azimuth of true north in the device's base frame, degrees; 0 by default: x points
            north.
    """

    latitude: Number
    longitude: Number
    north: NotRequired[Number]


class Cone(StrictTable):
    """A cone around a direction that an axis of the tool stays outside of.

    Give exactly one of *direction*, *azimuth_elevation* and *sun*, in the device's base frame.

    Attributes:
        name: name of the cone in messages.
        direction: a vector of any length.
        azimuth_elevation: the direction as angles.
        sun: the sun, seen from a location on the earth; z of the base frame points up.
        half_angle_deg: from the direction to the edge of the cone, degrees.
        margin_deg: extra angle outside the edge, which paths avoid if possible, degrees; 0 by
            default.
        axis: tool axis that stays outside: ``x`` (the default), ``y``, ``z`` or a vector.
    """

    name: Text
    direction: NotRequired[Vector3]
    azimuth_elevation: NotRequired[AzimuthElevation]
    sun: NotRequired[Place]
    half_angle_deg: Number
    margin_deg: NotRequired[Number]
    axis: NotRequired[Annotated[Vector3, BeforeValidator(lambda given: _axis(given))]]


def _axis(given: object) -> object:
    if isinstance(given, str):
        if given not in _AXES:
            raise RequestError("", f"expected x, y, z or a vector, got {shown(given)}; give one")
        return _AXES[given]
    return given


def _cone(content: object, read_table: Any) -> KeepOut:  # noqa: ANN401 - pydantic's
    """Return the cone that a table describes."""
    if isinstance(content, KeepOut):
        return content
    table = read_table(to_plain(content))
    name = table["name"]
    if not _NAME.fullmatch(name):
        expected = "expected a letter, then at most 31 letters, digits, '-' or '_'"
        raise RequestError("name", f"{expected}, got {name[:40]!r}; choose another name")
    given = [form for form in _FORMS if form in table]
    if len(given) != 1:
        came = f"{' and '.join(given)}; keep one" if given else "none of them; add one"
        raise RequestError("", f"expected one of {', '.join(_FORMS)}; got {came}")
    half, margin = table["half_angle_deg"], table.get("margin_deg", 0.0)
    if not 0.0 < half <= _WIDEST:
        expected = f"expected above 0, at most {_WIDEST:g}, got {half:g}"
        raise RequestError("half_angle_deg", f"{expected}; give half of the angle, in degrees")
    if not 0.0 <= margin <= _WIDEST - half:
        most = f"expected from 0 to {_WIDEST - half:g}, so that it ends within {_WIDEST:g} degrees"
        raise RequestError("margin_deg", f"{most}, got {margin:g}; give a smaller one")
    return KeepOut(
        name=name,
        direction=_direction(given[0], table[given[0]]),
        half_angle=math.radians(half),
        margin=math.radians(margin),
        axis=_unit("axis", table.get("axis", _AXES["x"])),
    )


def _direction(form: str, given: Any) -> driver.Vector3 | Sun:  # noqa: ANN401 - of the form
    if form == "direction":
        return _unit(form, given)
    if form == "azimuth_elevation":
        (w, x, y, z), _ = read(form, given, 0.0)
        return _unit(
            form, (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y))
        )
    for name, most in (("latitude", 90.0), ("longitude", 360.0), ("north", 360.0)):
        if abs(given.get(name, 0.0)) > most:
            expected = f"expected degrees from {-most:g} to {most:g}"
            step = "check the decimal point"
            raise RequestError(f"sun.{name}", f"{expected}, got {given[name]:g}; {step}")
    return Sun(given["latitude"], given["longitude"], given.get("north", NORTH))


def _unit(field: str, vector: Sequence[float]) -> driver.Vector3:
    x, y, z = vector
    length = math.hypot(x, y, z)
    if not 0.0 < length < math.inf:
        step = "give one that is not zero"
        raise RequestError(field, f"expected a direction, got {list(vector)}; {step}")
    if abs(length - 1.0) < ROUNDING:
        return x, y, z  # the same to the last bit when it is read again
    return x / length, y / length, z / length


def _distinct(cones: tuple[KeepOut, ...]) -> tuple[KeepOut, ...]:
    if len(cones) > MOST_CONES:
        raise RequestError("", f"expected at most {MOST_CONES}, got {len(cones)}; join some")
    names = [cone.name for cone in cones]
    for index, name in enumerate(names):
        if name in names[:index]:
            problem = f"{name!r} is the name of keep_out[{names.index(name)}] too; rename one"
            raise RequestError(f"[{index}].name", problem)
    return cones


if TYPE_CHECKING:
    Cones = tuple[KeepOut, ...]
else:
    Cones = Annotated[
        tuple[Annotated[Cone, WrapValidator(_cone)], ...],
        BeforeValidator(lambda given: tuple(given) if isinstance(given, list) else given),
        WrapValidator(lambda given, read: _distinct(read(given))),
    ]


def read_cones(content: object) -> tuple[KeepOut, ...]:
    """Return the keep-out cones that a list of tables describes.

    Raises:
        RequestError: one is not well formed, or two have one name.
    """
    try:
        cones: tuple[KeepOut, ...] = TypeAdapter(Cones).validate_python(content)
    except ValidationError as error:
        raise refused(error, Cones) from None
    return cones


def written_cone(cone: KeepOut) -> dict[str, Any]:
    """Return the table of a cone that :func:`read_cones` reads, without defaults."""
    table: dict[str, Any] = {"name": cone.name}
    if isinstance(cone.direction, Sun):
        table["sun"] = dict(cone.direction._asdict())
    else:
        table["direction"] = list(cone.direction)
    table["half_angle_deg"] = _degrees(cone.half_angle)
    if cone.margin:
        table["margin_deg"] = _degrees(cone.margin)
    if cone.axis != _AXES["x"]:
        table["axis"] = list(cone.axis)
    return table


def _degrees(angle: float) -> float:
    """Return the degrees that are read as exactly the same angle in rad."""
    near = math.degrees(angle)
    for one in (near, math.nextafter(near, 0.0), math.nextafter(near, math.inf)):
        if math.radians(one) == angle:
            return one
    return near
