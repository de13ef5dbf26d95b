"""Limits that a caller asks for, on the wire."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from orientd.errors import RequestError
from orientd.planner import ANGULAR, Limits, Rate
from orientd.rpc import control_pb2 as pb
from orientd.rpc.wire.values import RATES, to_vector, vector


def limits_message(rates: Mapping[str, Rate]) -> pb.Limits:
    """Return the message of limits; infinite ones are left out.

    Raises:
        RequestError: there is no such limit.
    """
    message = pb.Limits()
    for name, limit in rates.items():
        if name not in RATES:
            raise RequestError(f"limits.{name}", f"expected one of {', '.join(RATES)}")
        if not isinstance(limit, int | float):
            x, y, z = map(float, limit)
            getattr(message, f"axis_{name}").CopyFrom(vector((x, y, z)))
        elif math.isfinite(limit):
            setattr(message, name, limit)
    return message


def limits_to_wish(message: pb.Limits) -> Limits:
    """Return limits that a caller asks for, infinite where the message says nothing.

    Raises:
        RequestError: one is not positive, or is given twice.
    """
    try:
        return Limits.partial(**asked_rates(message))
    except RequestError as error:
        raise RequestError(f"limits.{error.field}", error.problem) from None
    except ValueError as error:
        raise RequestError("limits", str(error)) from error


def asked_rates(message: pb.Limits) -> dict[str, Any]:
    """Return the limits that *message* gives, each as a person would write it.

    Raises:
        RequestError: one is given twice.
    """
    rates: dict[str, Any] = {
        name: getattr(message, name) for name in RATES if message.HasField(name)
    }
    for name in ANGULAR:
        axes = f"axis_{name}"
        if message.HasField(axes):
            if name in rates:
                raise RequestError(name, f"expected one of {name} and {axes}, got both")
            rates[name] = list(to_vector(getattr(message, axes)))
    return rates
