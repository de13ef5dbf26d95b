"""The forms in which a request gives an orientation, and what quaternions they are."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from orientd import plain_values as plain
from orientd.errors import RequestError
from orientd.planner import Quaternion
from orientd.rotation import Floats, exp, from_euler, from_matrix

Written = tuple[str, Any]
"""An orientation as it is written: its form, and what its reader in :data:`FORMS` returns."""


def _quaternion(content: object) -> Quaternion:
    if not isinstance(content, Mapping):  # of four numbers nobody knows the order
        raise plain.wrong("{w: ..., x: ..., y: ..., z: ...}", content)
    read = plain.keys(content, dict.fromkeys("wxyz", plain.number), "wxyz")
    return read["w"], read["x"], read["y"], read["z"]


def _all_of(readers: Mapping[str, plain.Reader]) -> plain.Reader:
    """Return the reader of a mapping with all of these keys: of what they hold, in their order."""
    return lambda content: tuple(plain.keys(content, readers, tuple(readers)).values())


def _look_at(content: object) -> list[float]:
    """Return the direction of a point, seen from the origin or from a place."""
    if not isinstance(content, Mapping):
        return list(plain.vector(content))
    read = plain.keys(content, _LOOK_AT, ("point",))
    return [a - b for a, b in zip(read["point"], read.get("place", (0.0, 0.0, 0.0)), strict=True)]


_LOOK_AT: dict[str, plain.Reader] = {"point": plain.vector, "place": plain.vector}

FORMS: dict[str, plain.Reader] = {
    "quaternion": _quaternion,
    "rotation_vector": plain.vector,
    "euler": _all_of({"axes": plain.text, "degrees": partial(plain.each, reader=plain.number)}),
    "matrix": plain.rows,
    "direction": plain.vector,
    "azimuth_elevation": _all_of({"azimuth": plain.number, "elevation": plain.number}),
    "look_at": _look_at,
}
"""How each form is read from plain values."""

_ROUNDED = 1e-9  # what an angle may be beyond a turn

DIRECTIONS = ("direction", "azimuth_elevation", "look_at")
"""Forms that only say where to point."""


def implied(written: Written) -> dict[str, bool]:
    """Return what else holds of a keyframe that gives its orientation so."""
    return {"free_roll": True} if written[0] in DIRECTIONS else {}


def the_only(given: Mapping[str, Any]) -> Written:
    """Return the one orientation that is among *given*, by form.

    Raises:
        RequestError: there is none, or another.
    """
    forms = [form for form in FORMS if given.get(form) is not None]
    if len(forms) != 1:
        came = f"got {' and '.join(forms)}" if forms else "got none of them"
        raise RequestError("", f"expected one of {', '.join(FORMS)}; {came}")
    return forms[0], given[forms[0]]


def form_notes(written: Sequence[Written]) -> list[str]:
    """Return what the certificate says of angles that keyframes give beyond a turn.

    A quaternion knows no turns, so that only the rest of such an angle counts.
    """
    found: dict[str, list[str]] = {"rotation_vector": [], "euler": []}
    for index, (form, given) in enumerate(written):
        if form == "rotation_vector":
            found[form] += _vector_note(index, given)
        elif form == "euler":
            found[form] += _euler_note(index, given[1])
    return [
        notes[0] + (f"; so are {len(notes) - 1} more" if len(notes) > 1 else "")
        for notes in found.values()
        if notes
    ]


def _vector_note(index: int, vector: Sequence[float]) -> list[str]:
    angle = math.hypot(*vector)
    if not math.pi + _ROUNDED < angle < math.inf:
        return []
    rest = math.degrees(math.remainder(angle, 2.0 * math.pi))
    return [
        f"keyframes[{index}].rotation_vector is {angle:.6g} rad long, more than half a turn, and "
        f"taken for {rest:.4g} deg: its unit is rad, `euler` takes degrees, `turns` whole turns"
    ]


def _euler_note(index: int, degrees: Sequence[float]) -> list[str]:
    angle = max(degrees, key=abs, default=0.0)
    if not 360.0 + _ROUNDED < abs(angle) < math.inf:
        return []
    rest = math.remainder(angle, 360.0) + 0.0  # of nothing no negative
    return [
        f"keyframes[{index}].euler has an angle of {angle:.6g} deg, more than a whole turn, and "
        f"taken for {rest:.4g} deg: `turns` takes whole turns"
    ]


def quaternions(written: Sequence[Written]) -> list[Quaternion]:
    """Return the orientations of keyframes, those of one form converted together.

    Raises:
        RequestError: one is none, for example a matrix that is no rotation.
    """
    found: list[Any] = [q for _, q in written]
    _convert(found, written, "rotation_vector", exp)
    _convert(found, written, "matrix", from_matrix)
    for index, (form, euler) in enumerate(written):
        if form == "euler":
            found[index] = _from_euler(euler[0], euler[1], f"[{index}].euler")
        elif form in DIRECTIONS:
            found[index] = _level(form, euler, f"[{index}].{form}")
    return found


def _level(form: str, given: Sequence[float], place: str) -> Quaternion:
    """Return the orientation without roll whose x axis points somewhere."""
    if form == "azimuth_elevation":
        azimuth, elevation = map(math.radians, given)
    else:
        x, y, z = given
        if not x * x + y * y + z * z > 0.0:
            raise RequestError(place, "expected a direction, got none: the vector is zero")
        azimuth, elevation = math.atan2(y, x), math.atan2(z, math.hypot(x, y))
    # A turn about z, then one about the new y, by minus the elevation.
    c, s, b, d = (f(0.5 * a) for a in (azimuth, elevation) for f in (math.cos, math.sin))
    return c * b, s * d, -c * d, s * b


def _convert(
    found: list[Any], written: Sequence[Written], name: str, converted: Callable[[Any], Floats]
) -> None:
    indices = [index for index, (form, _) in enumerate(written) if form == name]
    if not indices:
        return
    given = np.array([found[index] for index in indices], dtype=np.float64)
    try:
        # What is out of all range becomes no number, which is refused as such.
        with np.errstate(over="ignore", invalid="ignore"):
            turned = converted(given).tolist()
        for index, q in zip(indices, turned, strict=True):
            found[index] = tuple(q)
    except ValueError:
        # Once more, one by one, to find the one that is wrong.
        for index, one in zip(indices, given, strict=True):
            try:
                converted(one)
            except ValueError as error:
                problem = str(error).removeprefix(f"{name} ")
                raise RequestError(f"[{index}].{name}", problem) from None


def _from_euler(axes: str, degrees: Sequence[float], place: str) -> Quaternion:
    try:
        from_euler(axes, [0.0] * len(axes))
    except ValueError as error:
        raise RequestError(f"{place}.axes", str(error).removeprefix("axes ")) from None
    if len(degrees) != len(axes):
        raise RequestError(
            f"{place}.degrees",
            f"expected {len(axes)} angles for the axes {axes!r}, got {len(degrees)}",
        )
    w, x, y, z = from_euler(axes, [math.radians(angle) for angle in degrees]).tolist()
    return w, x, y, z
