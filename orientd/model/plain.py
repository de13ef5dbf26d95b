"""Plain values as in YAML and JSON: made from Python's, and shown in errors."""

from __future__ import annotations

import reprlib
from collections.abc import Mapping
from typing import Any

from orientd.spelling import is_number, number_hint


def to_plain(content: Any) -> Any:  # noqa: ANN401 - any value of a request
    """Return *content* as plain values; convert NumPy's types, tuples and records."""
    if hasattr(content, "tolist"):
        return content.tolist()
    if content is None or isinstance(content, str | int | float):
        return content
    if isinstance(content, Mapping):
        return {key: to_plain(inner) for key, inner in content.items()}
    if isinstance(content, list | tuple):
        return [to_plain(inner) for inner in content]
    if hasattr(content, "__dataclass_fields__"):
        return {name: to_plain(getattr(content, name)) for name in content.__dataclass_fields__}
    return content


def joined(place: str, field: str) -> str:
    """Return the path of a field below the path *place*."""
    return f"{place}{'.' if place and field and not field.startswith('[') else ''}{field}"


def shown(came: object) -> str:
    """Return a value on one short line, as a file would write it."""
    if came is None:
        return "nothing"
    if isinstance(came, str):
        said = f"the text {came!r}"
        if is_number(came) and "e" in came.lower():
            said += " (YAML takes it for a number when written with a point and a sign: 1.0e+3)"
        else:
            said += number_hint(came)
        return said if len(said) <= 120 else f"{said[:117]}..."
    if isinstance(came, bool):
        return "true" if came else "false"
    # YAML aliases can make a value that takes for ever to write out in full.
    said = reprlib.repr(came)
    return said if len(said) <= 60 else f"{said[:57]}..."
