"""Plain values, as YAML and JSON have them: readers for the fields of a request, and the way back.

A reader returns what it has read, or raises :class:`~orientd.errors.RequestError` with the place
*within what it was given*: the first reader knows nothing of the last one's keys.

>>> vector([0, 0, "x"])
Traceback (most recent call last):
    ...
orientd.errors.RequestError: [2]: expected a number, got the text 'x'
"""

from __future__ import annotations

import math
import reprlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from orientd.errors import RequestError
from orientd.spelling import unknown_key

Reader = Callable[[object], Any]


def wrong(expected: str, came: object, place: str = "") -> RequestError:
    """Return the error to raise where something else was expected."""
    return RequestError(place, f"expected {expected}, got {shown(came)}")


def placed(place: str, error: RequestError) -> RequestError:
    """Return *error* with *place* in front of the field that it names."""
    is_nested = error.field and not error.field.startswith("[")
    return RequestError(f"{place}{'.' if is_nested else ''}{error.field}", error.problem)


def text(content: object) -> str:
    """Return a text."""
    if not isinstance(content, str):
        raise wrong("a text", content)
    return content


def flag(content: object) -> bool:
    """Return true or false."""
    if not isinstance(content, bool):
        raise wrong("true or false", content)
    return content


def whole(content: object) -> int:
    """Return a whole number, which 1.0 is not."""
    if isinstance(content, bool) or not isinstance(content, int):
        raise wrong("a whole number", content)
    return content


def number(content: object) -> float:
    """Return a finite number."""
    if isinstance(content, bool) or not isinstance(content, int | float):
        raise wrong("a number", content)
    try:
        if math.isfinite(content):
            return float(content)
    except OverflowError:  # a whole number beyond all floats
        pass
    raise wrong("a finite number", content)


def each(content: object, reader: Reader, count: int | None = None) -> list[Any]:
    """Return the entries of a list, of which there must be *count* if that is given."""
    if not isinstance(content, list):
        raise wrong("a list", content)
    if count is not None and len(content) != count:
        raise RequestError("", f"expected {count} entries, got {len(content)}")
    read: list[Any] = []
    try:
        for entry in content:
            read.append(reader(entry))  # noqa: PERF401 - how far it came is in the error
    except RequestError as error:
        raise placed(f"[{len(read)}]", error) from None
    return read


def vector(content: object) -> tuple[float, float, float]:
    """Return three finite numbers."""
    x, y, z = each(content, number, 3)
    return x, y, z


def rows(content: object) -> list[tuple[float, float, float]]:
    """Return three rows of three finite numbers."""
    return each(content, vector, 3)


def options(content: object) -> Mapping[str, Any]:
    """Return a mapping of texts to whatever its reader makes of it."""
    given = table(content)
    for key in given:
        if not isinstance(key, str):
            raise wrong("a text", key, str(key))
    return given


def table(content: object) -> Mapping[Any, Any]:
    """Return a mapping."""
    if not isinstance(content, Mapping):
        raise wrong("a mapping", content)
    return content


def angular_limit(content: object) -> float | tuple[float, float, float]:
    """Return the limit of a norm, or three of the components in the body frame."""
    try:
        return angular_rate(content)
    except ValueError as error:
        raise wrong(str(error), content) from None


def linear_limit(content: object) -> float:
    """Return the limit of a norm."""
    try:
        return positive(content)
    except ValueError as error:
        raise wrong(str(error), content) from None


def angular_rate(content: object) -> float | tuple[float, float, float]:
    """Return a limit or three of them; for :func:`angular_limit`, and for tables of settings.

    Raises:
        ValueError: *content* is neither; the message is what was expected.
    """
    if not isinstance(content, list | tuple):
        return positive(content)
    try:
        x, y, z = map(positive, content)
    except ValueError:
        raise ValueError(
            "three finite numbers greater than 0, for the body's x, y and z axes"
        ) from None
    return x, y, z


def positive(content: object) -> float:
    """Return a limit.

    Raises:
        ValueError: *content* is none; the message is what was expected.
    """
    if isinstance(content, bool) or not isinstance(content, int | float):
        raise ValueError("a number")
    try:
        is_finite = math.isfinite(content)
    except OverflowError:  # a whole number beyond all floats
        is_finite = False
    if not is_finite:
        raise ValueError("a finite number")
    if not content > 0.0:
        raise ValueError("a number greater than 0")
    return float(content)


def one_of(choices: Sequence[str]) -> Callable[[object], str]:
    """Return the reader of a text that is one of *choices*."""

    def choice(content: object) -> str:
        if not isinstance(content, str) or content not in choices:
            raise wrong(" or ".join(map(repr, choices)), content)
        return content

    return choice


def keys(content: object, readers: Mapping[str, Reader], needed: Sequence[str]) -> dict[str, Any]:
    """Return what a mapping says under known keys, each as its reader returns it.

    Args:
        content: the mapping.
        readers: by key.
        needed: the keys that must be there.
    """
    given = table(content)
    # First, since a key that is missing is more often misspelt than forgotten.
    for key in given:
        if key not in readers:
            raise RequestError(str(key), unknown_key(str(key), readers))
    read: dict[str, Any] = {}
    for key, reader in readers.items():
        if key in given:
            try:
                read[key] = reader(given[key])
            except RequestError as error:
                raise placed(key, error) from None
        elif key in needed:
            raise RequestError(key, "missing")
    return read


def shown(came: object) -> str:
    """Return what came, in the words of a file, on one short line."""
    if came is None:
        return "nothing"
    if isinstance(came, str):
        said = f"the text {came!r}"
        if _is_number(came):
            said += (
                " (YAML takes it for a number when written with a point and a sign: 1.0e+3)"
                if "e" in came.lower()
                else " (without quotes it would be a number)"
            )
        return said if len(said) <= 120 else f"{said[:117]}..."
    if isinstance(came, bool):
        return "true" if came else "false"
    # Aliases can make a value that would take for ever to write out in full.
    said = reprlib.repr(came)
    return said if len(said) <= 60 else f"{said[:57]}..."


def to_plain(content: Any) -> Any:  # noqa: ANN401 - whatever a request holds
    """Return *content* with NumPy's arrays and numbers, tuples and dataclasses made plain."""
    if isinstance(content, Mapping):
        return {key: to_plain(inner) for key, inner in content.items()}
    if isinstance(content, list | tuple):
        return [to_plain(inner) for inner in content]
    if hasattr(content, "tolist"):
        return content.tolist()
    if is_dataclass(content):
        return {entry.name: to_plain(getattr(content, entry.name)) for entry in fields(content)}
    return content


def _is_number(came: str) -> bool:
    try:
        float(came)
    except ValueError:
        return False
    return True
