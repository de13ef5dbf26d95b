"""The forms of an orientation in a request, and their conversion to quaternions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from orientd.errors import RequestError
from orientd.tolerances import NORM_TOLERANCE, ROUNDING

if TYPE_CHECKING:
    from orientd.driver import Quaternion, Vector3

_ROUNDED = 1e-9  # rounding of an angle of a whole turn
_LONGEST = 1e100  # squares of larger numbers overflow
_MOST_DEG = {"azimuth": 720.0, "elevation": 180.0}
"""Largest angles of a direction, degrees; elevations above 90 point backwards."""

Read = tuple["Quaternion", str]
"""A quaternion, and a note of the certificate on how it was read."""


def unit(q: Quaternion, tolerance: float) -> Read:
    """Return *q* with norm 1, with a note if it was off by more than rounding.

    Raises:
        RequestError: its norm is off by more than the tolerance.
    """
    w, x, y, z = q
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    error = abs(norm - 1.0)
    if not error <= tolerance:
        step = "divide it by its norm" if 0.0 < norm < math.inf else "give a rotation"
        problem = f"norm must be 1 within {tolerance:g}, got {norm:.9g}; {step}"
        raise RequestError("quaternion", problem)
    if error <= ROUNDING:
        return q, ""
    note = f"of norm {norm:.6f} was scaled to norm 1" if error > NORM_TOLERANCE else ""
    return (w / norm, x / norm, y / norm, z / norm), note


def _from_vector(vector: Vector3) -> Read:
    from orientd.rotation import exp

    angle, note = math.hypot(*vector), ""
    if angle > _LONGEST:
        raise RequestError(
            "rotation_vector", f"expected an angle in rad, got {angle:g}; give fewer turns"
        )
    if angle > math.pi + _ROUNDED:
        rest = math.degrees(math.remainder(angle, 2.0 * math.pi))
        note = (
            f"is {angle:.6g} rad long, more than half a turn, read as {rest:.4g} deg: its unit "
            "is rad, `euler` takes degrees, `turns` whole turns"
        )
    return exp(vector).tolist(), note


def _from_matrix(rows: Sequence[Vector3]) -> Read:
    from orientd.rotation import from_matrix

    if (largest := max(abs(entry) for row in rows for entry in row)) > _LONGEST:
        raise RequestError("matrix", f"must be a rotation, got an entry of {largest:g}")
    try:
        return from_matrix(rows).tolist(), ""
    except ValueError as error:
        problem = str(error).removeprefix("matrix ")
        step = "give orthonormal rows, or another form"
        raise RequestError("matrix", f"{problem}; {step}") from None


def _from_euler(given: Any) -> Read:  # noqa: ANN401 - EulerAngles
    from orientd.rotation import from_euler

    axes, degrees = given["axes"], given["degrees"]
    try:
        from_euler(axes, [0.0] * len(axes))
    except ValueError as error:
        problem = str(error).removeprefix("axes ")
        raise RequestError("euler.axes", f"{problem}; give for example xyz") from None
    if len(degrees) != len(axes):
        expected = f"expected {len(axes)} angles for the axes {axes!r}"
        raise RequestError("euler.degrees", f"{expected}, got {len(degrees)}; give one for each")
    angle, note = max(degrees, key=abs), ""
    if abs(angle) > _LONGEST:
        raise RequestError("euler.degrees", f"expected degrees, got {angle:g}; give fewer turns")
    q = from_euler(axes, [math.radians(angle) for angle in degrees]).tolist()
    if abs(angle) > 360.0 + _ROUNDED:
        rest = math.remainder(angle, 360.0) + 0.0  # of nothing no negative
        note = (
            f"has an angle of {angle:.6g} deg, more than a whole turn, read as {rest:.4g} "
            "deg: `turns` takes whole turns"
        )
    return q, note


def _from_direction(vector: Vector3, form: str = "direction") -> Read:
    x, y, z = vector
    if not math.hypot(x, y, z) > 0.0:
        raise RequestError(form, "expected a direction, got none: the vector is zero; give another")
    return _level(math.atan2(y, x), math.atan2(z, math.hypot(x, y)))


def _from_angles(given: Any) -> Read:  # noqa: ANN401 - AzimuthElevation
    for name, most in _MOST_DEG.items():
        if not abs(given[name]) <= most:
            raise RequestError(
                f"azimuth_elevation.{name}",
                f"expected {-most:g} to {most:g} deg, got {given[name]:.10g}; check the decimal "
                "point",
            )
    return _level(math.radians(given["azimuth"]), math.radians(given["elevation"]))


def _from_point(given: Any) -> Read:  # noqa: ANN401 - LookAt
    x, y, z = map(float.__sub__, given["point"], given.get("place", (0.0, 0.0, 0.0)))
    return _from_direction((x, y, z), "look_at")


def _level(azimuth: float, elevation: float) -> Read:
    """Return the orientation without roll whose x axis points somewhere."""
    # A turn about z, then one about the new y, by minus the elevation.
    c, s, b, d = (f(0.5 * a) for a in (azimuth, elevation) for f in (math.cos, math.sin))
    return (c * b, s * d, -c * d, s * b), ""


READERS: dict[str, Callable[[Any], Read]] = {
    "rotation_vector": _from_vector,
    "euler": _from_euler,
    "matrix": _from_matrix,
    "direction": _from_direction,
    "azimuth_elevation": _from_angles,
    "look_at": _from_point,
}
"""The reader of each form except the quaternion."""

FORMS = ("quaternion", *READERS)
DIRECTIONS = FORMS[4:]
"""Forms that only give a pointing direction."""


def read(form: str, given: Any, tolerance: float) -> Read:  # noqa: ANN401 - depends on the form
    """Return the quaternion of an orientation in one form, and a note on how it was read.

    Args:
        form: one of :data:`FORMS`.
        given: the value of the form.
        tolerance: largest deviation of a quaternion's norm from one.

    Raises:
        RequestError: the value is not an orientation.
    """
    if form == "quaternion":
        return unit(given, tolerance)
    (w, x, y, z), note = READERS[form](given)
    return unit((w, x, y, z), tolerance)[0], note
