"""Limits on the wire: those of a device, and those that a caller asks for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from orientd.errors import RequestError
from orientd.model.limits import ANGULAR, NO_AXES, Limits, Rate
from orientd.protocol import control_pb2 as pb
from orientd.protocol.values import RATES, to_vector, vector


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
    rates = _asked_rates(message)
    try:
        return Limits.partial(**rates)
    except ValueError as error:
        raise RequestError("limits", str(error)) from error


def _asked_rates(message: pb.Limits) -> dict[str, Any]:
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
                problem = f"expected one of {name} and {axes}, got both"
                raise RequestError(f"limits.{name}", problem)
            rates[name] = list(to_vector(getattr(message, axes)))
    return rates


def limits_to_message(limits: Limits) -> pb.Limits:
    """Return all limits of a device; those of the axes only if there are any."""
    message = pb.Limits(**{name: getattr(limits, name) for name in RATES})
    for name in ANGULAR:
        if limits.axes(name) != NO_AXES:
            getattr(message, f"axis_{name}").CopyFrom(vector(limits.axes(name)))
    return message


def limits_from_message(message: pb.Limits) -> Limits:
    """Return the limits of a device."""
    axes = (
        to_vector(getattr(message, f"axis_{name}")) if message.HasField(f"axis_{name}") else NO_AXES
        for name in ANGULAR
    )
    return Limits(*(getattr(message, name) for name in RATES), *axes)
