"""Turn pydantic's errors into one line with the path to the field."""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import fields
from typing import Any, NotRequired, TypeVar, get_args, get_origin, get_type_hints

from pydantic import ValidationError

from orientd.errors import RequestError
from orientd.model.plain import joined, shown
from orientd.spelling import unknown_key

_EXPECTED = {
    "float_type": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_parsing_size": "a smaller whole number",
    "bool_type": "true or false",
    "string_type": "a text",
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a mapping",
    "dataclass_type": "a mapping",
    "mapping_type": "a mapping",
    "is_instance_of": "a path",
    "string_pattern_mismatch": "a letter, then at most 31 letters, digits, '-' or '_'",
}
_NEXT_STEPS = {
    "float_type": "give a number such as 1.5",
    "finite_number": "give a number such as 1.5",
    "int_type": "give a number such as 2",
    "int_parsing_size": "give a number such as 2",
    "bool_type": "write one of the two",
    "string_type": "put it in quotes",
    "tuple_type": "write it as [..., ...]",
    "list_type": "write it as [..., ...]",
    "dict_type": "write it as {KEY: VALUE}",
    "dataclass_type": "write it as {KEY: VALUE}",
    "mapping_type": "write it as {KEY: VALUE}",
    "literal_error": "give one of them",
    "is_instance_of": "put it in quotes",
    "string_pattern_mismatch": "choose another name",
    "too_short": "add one",
    **dict.fromkeys(
        ("greater_than", "greater_than_equal", "less_than", "less_than_equal"),
        "give a number in this range, or leave the key out for its default",
    ),
}
"""The next step after an error of validation, by its kind."""
_UNKNOWN = ("unexpected_keyword_argument", "extra_forbidden", "invalid_key")

Kind = TypeVar("Kind")


def refusing(kind: type[Kind]) -> type[Kind]:
    """Make the constructor of a model raise :class:`RequestError` for malformed values."""
    construct: Any = kind.__init__

    @functools.wraps(construct)
    def init(self: Kind, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401 - any model's
        try:
            construct(self, *args, **kwargs)
        except ValidationError as error:
            raise refused(error, kind) from None

    kind.__init__ = init  # type: ignore[method-assign,assignment] # for every model
    return kind


def refused(error: ValidationError, of: Any) -> RequestError:  # noqa: ANN401 - any type
    """Return the exception for the first error.

    Args:
        error: pydantic's error.
        of: the type that was read.
    """
    found = error.errors(include_url=False)
    for one in found:  # name a positional argument by its field
        if one["loc"] and isinstance(one["loc"][0], int) and hasattr(of, "__pydantic_fields__"):
            named = [field.name for field in fields(of) if not field.kw_only]
            one["loc"] = (_names(of)[named[one["loc"][0]]], *one["loc"][1:])
    # A missing key is more often misspelt than forgotten.
    first = next((one for one in found if one["type"] in _UNKNOWN), found[0])
    loc, kind, came = first["loc"], first["type"], first["input"]
    if kind in _UNKNOWN:
        return RequestError(_path(loc), unknown_key(str(loc[-1]), _keys(of, loc[:-1])))
    if kind == "value_error":
        problem = first["ctx"]["error"]
        if isinstance(problem, RequestError):
            return RequestError(joined(_path(loc), problem.field), problem.problem)
        return RequestError(_path(loc), str(problem))
    if kind == "missing" and isinstance(loc[-1], int):
        count = max(int(one["loc"][-1]) for one in found if one["loc"][:-1] == loc[:-1]) + 1
        problem = f"expected {count} entries, got {len(came)}: {shown(came)}"
        return RequestError(_path(loc[:-1]), f"{problem}; give {count}, with decimal points")
    if kind == "missing":
        return RequestError(_path(loc), "missing; add this key")
    if kind == "too_long":
        count, size = first["ctx"]["max_length"], first["ctx"]["actual_length"]
        problem = f"expected {count} entries, got {size}: {shown(came)}"
        return RequestError(_path(loc), f"{problem}; give {count}, with decimal points")
    if kind in ("model_type", "dict_type") and hasattr(of, "model_fields"):
        # Of a configuration, which is TOML.
        brackets = "in single brackets" if isinstance(came, list) else f"as [{_path(loc)}]"
        problem = f"expected a table, got {shown(came)}; write its heading {brackets}"
        return RequestError(_path(loc), problem)
    expected = _EXPECTED.get(kind) or first.get("ctx", {}).get("expected")
    expected = expected or first["msg"].removeprefix("Input should be ")
    if kind == "dict_type" and (needed := _needed(of, loc)):
        expected = f"{{{', '.join(f'{key}: ...' for key in needed)}}}"
    if kind == "too_short":
        least = f"at least {first['ctx']['min_length']}"
        expected = f"at least one table [{_path(loc)}.NAME]" if came == {} else least
    value = shown(came)
    if kind == "bool_type" and came in ("true", "false"):
        value += " (without quotes it would be one)"
    is_hinted = value.endswith(")")  # how this text would be a number
    step = "" if kind not in _NEXT_STEPS or is_hinted else f"; {_NEXT_STEPS[kind]}"
    return RequestError(_path(loc), f"expected {expected}, got {value}{step}")


def _path(loc: Iterable[int | str]) -> str:
    place = ""
    for part in loc:
        if part != "[key]":
            place = joined(place, f"[{part}]" if isinstance(part, int) else part)
    return place


def _needed(of: Any, loc: Iterable[int | str]) -> list[str]:  # noqa: ANN401 - any type
    """Return the keys that the table at *loc* must have."""
    table = _type_at(of, loc)
    needed = getattr(table, "__required_keys__", ())
    return [key for key in getattr(table, "__annotations__", ()) if key in needed]


def _keys(of: Any, loc: Iterable[int | str]) -> list[str]:  # noqa: ANN401 - any type
    """Return the keys of the table at *loc* in a value of the type *of*."""
    return list(_names(_type_at(of, loc)).values())


def _type_at(of: Any, loc: Iterable[int | str]) -> Any:  # noqa: ANN401 - any type
    """Return the type at *loc* in a value of the type *of*."""
    for part in loc:
        of = _table(of)
        if hasattr(of, "__annotations__"):
            named = {name: key for key, name in _names(of).items()}
            of = get_type_hints(of, include_extras=True)[named[str(part)]]
        else:
            of = get_args(of)[-1 if isinstance(part, str) else 0]
    return _table(of)


def _names(of: Any) -> dict[str, str]:  # noqa: ANN401 - a table
    """Return the keys of a table by the names of its attributes."""
    if not hasattr(of, "__pydantic_fields__"):
        return {name: name for name in of.__annotations__}
    known, implied = of.__pydantic_fields__, getattr(of, "implied", ())
    return {
        name: str(field.validation_alias or name)
        for name, field in known.items()
        if name not in implied
    }


def _table(of: Any) -> Any:  # noqa: ANN401 - any type
    """Return the table, list or mapping type inside an annotated type."""
    while (
        hasattr(of, "__metadata__") or get_origin(of) is NotRequired or type(None) in get_args(of)
    ):
        of = next(one for one in get_args(of) if one is not type(None))
    return of
