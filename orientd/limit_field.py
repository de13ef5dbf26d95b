"""Limits in the tables of the configuration; see :func:`.plain_values.angular_rate`.

>>> from pydantic import TypeAdapter
>>> TypeAdapter(AngularLimit).validate_python([2, 1, 3])
(2.0, 1.0, 3.0)
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, PlainSerializer, PlainValidator, WithJsonSchema
from pydantic_core import PydanticCustomError

from orientd.plain_values import angular_rate


def _angular_limit(content: object) -> float | tuple[float, float, float]:
    try:
        return angular_rate(content)
    except ValueError as error:
        # As pydantic words it for the other numbers of a table.
        expected = str(error).replace("a number greater", "greater")
        raise PydanticCustomError("limit", "{expected}", {"expected": expected}) from None


_POSITIVE: dict[str, Any] = {"type": "number", "exclusiveMinimum": 0}

AngularLimit = Annotated[
    float | tuple[float, float, float],
    PlainValidator(_angular_limit),
    # By itself pydantic takes three numbers for a list that should be a tuple, and warns.
    PlainSerializer(lambda limit: limit, return_type=Any),
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
