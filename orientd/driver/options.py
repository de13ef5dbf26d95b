"""Check the options of a driver in the configuration; every error names the option.

Each function returns the checked value and raises ``ValueError`` for a wrong one.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Any

from orientd.driver.values import IDENTITY, Quaternion
from orientd.spelling import did_you_mean
from orientd.tolerances import NORM_TOLERANCE


def check_names(options: Mapping[str, Any], known: Collection[str], where: str = "") -> None:
    """Refuse an option that is not among *known*; *where* precedes its name in errors."""
    for name in options:
        if name not in known:
            near = did_you_mean(name, known)
            raise ValueError(
                f"unknown option {where + name!r}, allowed are: {', '.join(sorted(known))}{near}"
            )


def number(
    option: str,
    given: Any,  # noqa: ANN401 - checked here
    least: float = -math.inf,
    most: float = math.inf,
) -> float:
    """Return a finite number within a range."""
    if not _is_finite(given) or not least <= given <= most:
        span = f" from {least:g} to {most:g}" if math.isfinite(least) else ""
        raise ValueError(f"{option} must be a number{span}, got {given!r}")
    return float(given)


def whole(option: str, given: object, least: int, most: int) -> int:
    """Return a whole number within a range."""
    if isinstance(given, bool) or not isinstance(given, int) or not least <= given <= most:
        raise ValueError(f"{option} must be a whole number from {least} to {most}, got {given!r}")
    return given


def numbers(option: str, given: object, count: int) -> tuple[float, ...]:
    """Return a list of *count* finite numbers."""
    if (
        not isinstance(given, (list, tuple))
        or len(given) != count
        or not all(map(_is_finite, given))
    ):
        raise ValueError(f"{option} must be {count} numbers, got {given!r}")
    return tuple(map(float, given))


def switch(option: str, given: object) -> bool:
    """Return a truth value."""
    if not isinstance(given, bool):
        raise ValueError(f"{option} must be true or false, got {given!r}")
    return given


def choice(option: str, given: Any, allowed: Collection[Any]) -> Any:  # noqa: ANN401 - checked here
    """Return one of the allowed values."""
    if not any(given == one and type(given) is type(one) for one in allowed):
        raise ValueError(f"{option} must be one of {', '.join(map(str, allowed))}, got {given!r}")
    return given


def quaternion(option: str, given: object) -> Quaternion:
    """Return an orientation of unit norm given as ``{w, x, y, z}``; ``None`` is the identity."""
    if given is None:
        return IDENTITY
    if not isinstance(given, Mapping) or set(given) != set("wxyz"):
        raise ValueError(f"{option} must be {{w, x, y, z}}, got {given!r}")
    w, x, y, z = (number(f"{option}.{key}", given[key]) for key in "wxyz")
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(length - 1.0) <= NORM_TOLERANCE:
        raise ValueError(f"{option} must have norm 1, got {length:.9g}")
    return (w / length, x / length, y / length, z / length)


def _is_finite(given: object) -> bool:
    return isinstance(given, (int, float)) and not isinstance(given, bool) and math.isfinite(given)
