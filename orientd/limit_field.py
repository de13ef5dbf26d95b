"""Limits as files write them: one number for a norm, or three for the components in the body frame.

>>> from pydantic import TypeAdapter
>>> TypeAdapter(AngularLimit).validate_python([2, 1, 3])
(2.0, 1.0, 3.0)
"""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import Field, PlainValidator, WithJsonSchema
from pydantic_core import PydanticCustomError

_TRIPLE = "three finite numbers greater than 0, for the body's x, y and z axes"


def check_angular_limit(content: object) -> float | tuple[float, float, float]:
    """Return a limit or three of them.

    Raises:
        PydanticCustomError: *content* is neither; the message says what was expected.
    """
    if isinstance(content, list | tuple):
        try:
            x, y, z = map(_number, content)
        except (PydanticCustomError, ValueError):
            raise PydanticCustomError("angular_limit", _TRIPLE) from None
        return x, y, z
    return _number(content)


def _number(content: object) -> float:
    # The kinds are pydantic's own for a single number, so that the complaints read alike.
    if isinstance(content, bool) or not isinstance(content, int | float):
        raise PydanticCustomError("float_type", "a number")
    if not math.isfinite(content):
        raise PydanticCustomError("finite_number", "a finite number")
    if not content > 0.0:
        raise PydanticCustomError("greater_than", "greater than 0")
    return float(content)


_POSITIVE: dict[str, Any] = {"type": "number", "exclusiveMinimum": 0}

AngularLimit = Annotated[
    float | tuple[float, float, float],
    PlainValidator(check_angular_limit),
    WithJsonSchema(
        {
            "anyOf": [
                _POSITIVE,
                {"type": "array", "items": _POSITIVE, "minItems": 3, "maxItems": 3},
            ]
        }
    ),
]
LinearLimit = Annotated[float, Field(gt=0, allow_inf_nan=False)]
