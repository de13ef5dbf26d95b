"""The device API of ASCOM Alpaca: requests to calls of a device's members, and their answers.

Facts from the ASCOM Alpaca API reference and from the protocol test of ConformU.  The names of the
parameters of a GET may have any case, those of a PUT may not.  A malformed request gets HTTP
status 400.  A well-formed request that the device refuses gets status 200 and an error number.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar
from urllib.parse import parse_qsl

from orientd.errors import DaemonError, DeviceError, OrientdError, PlanError, RequestError

NOT_IMPLEMENTED = 0x400
INVALID_VALUE = 0x401
VALUE_NOT_SET = 0x402
NOT_CONNECTED = 0x407
PARKED = 0x408
INVALID_OPERATION = 0x40B
ACTION_NOT_IMPLEMENTED = 0x40C
DRIVER = 0x500

_MOST_FIELDS = 50
_LARGEST = 2**32 - 1
_WHOLE = re.compile(r"-?[0-9]{1,18}")
_NUMBER = re.compile(r"[-+]?(?:[0-9]{1,30}\.?[0-9]{0,40}|\.[0-9]{1,40})(?:[eE][-+]?[0-9]{1,3})?")


class BadRequest(Exception):  # noqa: N818 - the name of HTTP status 400
    """A malformed request; its text goes to the client with HTTP status 400."""


class AlpacaError(Exception):
    """A refusal with an error number of ASCOM."""

    def __init__(self, number: int, message: str) -> None:
        super().__init__(message)
        self.number = number


def boolean(text: str) -> bool:
    """Return the truth value of a parameter.

    Raises:
        ValueError: it is neither true nor false.
    """
    if text.lower() not in {"true", "false"}:
        raise ValueError("expected true or false")
    return text.lower() == "true"


def whole(text: str) -> int:
    """Return the whole number of a parameter.

    Raises:
        ValueError: it is not one.
    """
    if not _WHOLE.fullmatch(text):
        raise ValueError("expected a whole number")
    return int(text)


def number(text: str) -> float:
    """Return the number of a parameter.

    Raises:
        ValueError: it is not a finite one.
    """
    if not _NUMBER.fullmatch(text) or not math.isfinite(float(text)):
        raise ValueError("expected a number")
    return float(text)


def check_range(name: str, given: float, low: float, high: float) -> None:
    """Check the range of a parameter.

    Raises:
        AlpacaError: the value is outside of it.
    """
    if not low <= given <= high:
        expected = f"expected {low:g} to {high:g}, got {given:g}"
        raise AlpacaError(INVALID_VALUE, f"{name}: {expected}")


Reader = Callable[[str], Any]


class Member(NamedTuple):
    """A property or a method of a device.

    Attributes:
        call: takes the values of the parameters, and returns the value of the answer.
        parameters: reader of each parameter by its name.
        is_free: whether it works without a connection.
    """

    call: Callable[..., Any]
    parameters: Mapping[str, Reader] = {}
    is_free: bool = False


def missing(**parameters: Reader) -> Member:
    """Return a member that the device does not have."""

    def call(*_: object) -> None:
        raise AlpacaError(NOT_IMPLEMENTED, "this device does not have that")

    return Member(call, parameters)


Members = Mapping[str, Member]


class Call(NamedTuple):
    """A request to a device.

    Attributes:
        is_put: whether it is a PUT rather than a GET.
        fields: the parameters by name, in lower case if it is a GET.
        client: number of the client, or 0.
        transaction: number of the request, or 0.
    """

    is_put: bool
    fields: Mapping[str, str]
    client: int
    transaction: int


def read_call(*, is_put: bool, text: str) -> Call:
    """Return the call that the query of a GET or the body of a PUT makes.

    Raises:
        BadRequest: it is malformed.
    """
    try:
        pairs = parse_qsl(
            text, keep_blank_values=True, errors="strict", max_num_fields=_MOST_FIELDS
        )
    except ValueError as error:
        raise BadRequest("the parameters are not form-encoded UTF-8") from error
    fields = {name if is_put else name.lower(): value for name, value in pairs}
    client, transaction = (
        _identifier(fields.get(name if is_put else name.lower(), "0"), name)
        for name in ("ClientID", "ClientTransactionID")
    )
    return Call(is_put, fields, client, transaction)


def _identifier(text: str, name: str) -> int:
    try:
        found = whole(text)
    except ValueError:
        found = -1
    if not 0 <= found <= _LARGEST:
        raise BadRequest(f"{name}: expected a whole number of 32 bits, got {text[:40]!r}")
    return found


Result = TypeVar("Result")
_transactions = itertools.count(1)


def envelope(transaction: int) -> dict[str, Any]:
    """Return the beginning of an answer without an error."""
    return {
        "ClientTransactionID": transaction,
        "ServerTransactionID": next(_transactions) & _LARGEST,
        "ErrorNumber": 0,
        "ErrorMessage": "",
    }


def answer(member: Member, call: Call, *, is_connected: bool) -> dict[str, Any]:
    """Call a member, and return the answer.

    Raises:
        BadRequest: a parameter is missing, or its value is malformed.
    """
    given = []
    for name, reader in member.parameters.items():
        text = call.fields.get(name if call.is_put else name.lower())
        if text is None:
            raise BadRequest(f"{name}: the parameter is missing; check its case")
        try:
            given.append(reader(text))
        except ValueError as error:
            raise BadRequest(f"{name}: {error}, got {text[:40]!r}") from error
    answered = envelope(call.transaction)
    try:
        if not (is_connected or member.is_free):
            raise AlpacaError(NOT_CONNECTED, "connect to the device first")
        value = member.call(*given)
    except AlpacaError as error:
        return answered | {"ErrorNumber": error.number, "ErrorMessage": str(error)}
    except OrientdError as error:
        return answered | {"ErrorNumber": _number_of(error), "ErrorMessage": str(error)}
    return answered if call.is_put and value is None else answered | {"Value": value}


def _number_of(error: OrientdError) -> int:
    if isinstance(error, RequestError | PlanError):
        return INVALID_VALUE
    return DRIVER if isinstance(error, DaemonError | DeviceError) else INVALID_OPERATION
