"""A device of ASCOM Alpaca: its members, and their answers to requests.

Facts from the ASCOM Alpaca API reference and from the protocol test of ConformU.  The names of the
parameters of a GET may have any case, those of a PUT may not.  A malformed request gets HTTP
status 400.  A well-formed request that the device refuses gets status 200 and an error number.
"""

from __future__ import annotations

import inspect
import itertools
import math
import threading
import uuid
from collections import OrderedDict
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from functools import partial
from typing import Any, NamedTuple
from urllib.parse import parse_qsl

import orientd
from orientd.errors import DaemonError, DeviceError, OrientdError, PlanError, RequestError
from orientd.own_socket import MOST_CLIENTS
from orientd_serving.served import Served

NOT_IMPLEMENTED = 0x400
INVALID_VALUE = 0x401
VALUE_NOT_SET = 0x402
NOT_CONNECTED = 0x407
PARKED = 0x408
INVALID_OPERATION = 0x40B
ACTION_NOT_IMPLEMENTED = 0x40C
DRIVER = 0x500

_INTERFACE = 4
"""Version of ITelescope and IRotator, as of ASCOM Platform 7."""

_MOST_FIELDS = 50
_LARGEST = 2**32 - 1

Members = Mapping[str, Any]
"""Members by their names in an address: a value, or a function with annotated parameters.

The parameter ``right_ascension`` is ``RightAscension`` in requests.
"""


class BadRequest(Exception):  # noqa: N818 - the name of HTTP status 400
    """A malformed request; its text goes to the client with HTTP status 400."""


class AlpacaError(Exception):
    """A refusal with an error number of ASCOM."""

    def __init__(self, number: int, message: str) -> None:
        super().__init__(message)
        self.number = number


def check_range(name: str, given: float, low: float, high: float) -> None:
    """Check the range of a parameter.

    Raises:
        AlpacaError: the value is outside of it.
    """
    if not low <= given <= high:
        expected = f"expected {low:g} to {high:g}, got {given:g}"
        raise AlpacaError(INVALID_VALUE, f"{name}: {expected}")


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
    numbers = []
    for name in ("ClientID", "ClientTransactionID"):
        text = fields.get(name if is_put else name.lower(), "0")
        if not (text.isascii() and text.isdecimal() and len(text) <= 10 and int(text) <= _LARGEST):
            raise BadRequest(f"{name}: expected a whole number of 32 bits, got {text[:40]!r}")
        numbers.append(int(text))
    return Call(is_put, fields, *numbers)


_transactions = itertools.count(1)


def envelope(transaction: int, error: int = 0, message: str = "") -> dict[str, Any]:
    """Return the beginning of an answer."""
    return {
        "ClientTransactionID": transaction,
        "ServerTransactionID": next(_transactions) & _LARGEST,
        "ErrorNumber": error,
        "ErrorMessage": message,
    }


class AlpacaDevice:
    """A device of an Alpaca server.

    Attributes:
        kind: ``Telescope`` or ``Rotator``.
        name: for people.
        unique_id: the same after every start.
    """

    kind = ""

    def __init__(
        self, served: Served, *, gets: Members, puts: Members, lacks: str, state: str
    ) -> None:
        """Serve a device of the daemon.

        Args:
            served: the device.
            gets: the properties of this kind of device.
            puts: its methods.
            lacks: members of its kind that it does not implement.
            state: names of the properties in ``DeviceState``.
        """
        self._served = served
        self.name = f"orientd {self.kind.lower()} {served.name}"
        self.unique_id = str(uuid.uuid5(uuid.NAMESPACE_DNS, f"{uuid.getnode()}/{self.name}"))
        self._clients: OrderedDict[int, None] = OrderedDict()
        self._lock = threading.Lock()
        self._gets, self._puts, self._state = gets, puts, state.split()
        self._lacks = {*lacks.split(), "commandblind", "commandbool", "commandstring"}
        self._general = {
            "connecting": False,
            "description": f"device {served.name} of orientd",
            "driverinfo": f"orientd {orientd.__version__}",
            "driverversion": ".".join(orientd.__version__.split(".")[:2]),
            "interfaceversion": _INTERFACE,
            "name": self.name,
            "supportedactions": [],
        }

    def answer(self, name: str, call: Call) -> dict[str, Any]:
        """Return the answer to a call of a member.

        Raises:
            BadRequest: the device has no such member, or a parameter is malformed.
        """
        with self._lock:
            is_connected, is_free = call.client in self._clients, bool(self._clients)
            if is_connected:
                self._clients.move_to_end(call.client)
        free: Members = {**self._general, "connected": is_connected}
        own: Members = {**self._gets, "devicestate": self._device_state}
        if call.is_put:
            connect = partial(self._connect, call.client)
            ends = {"connect": partial(connect, True), "disconnect": partial(connect, False)}
            free, own = {"action": _no_action, "connected": connect, **ends}, self._puts
        if name not in {*free, *own, *self._lacks}:
            raise BadRequest(f"{name[:40]!r} is not a member of a {self.kind.lower()}")
        member = {**own, **free}.get(name, _not_implemented)
        arguments = _arguments(member, call) if callable(member) else []
        try:
            if not (is_free or name in free):
                raise AlpacaError(NOT_CONNECTED, "connect to the device first")
            value = member(*arguments) if callable(member) else member
        except AlpacaError as error:
            return envelope(call.transaction, error.number, str(error))
        except OrientdError as error:
            return envelope(call.transaction, _number_of(error), str(error))
        answered = envelope(call.transaction)
        return answered if call.is_put else {**answered, "Value": value}

    def _connect(self, client: int, connected: bool) -> None:
        if connected:
            self._served.enable()
        with self._lock:
            self._clients.pop(client, None)
            if connected:
                self._clients[client] = None
            if len(self._clients) > MOST_CLIENTS:
                # A program that ends without disconnecting comes back with another number.
                self._clients.popitem(last=False)

    def _device_state(self) -> list[dict[str, Any]]:
        members = [(name, self._gets[name.lower()]) for name in self._state]
        found = [
            {"Name": name, "Value": member() if callable(member) else member}
            for name, member in members
        ]
        return [*found, {"Name": "TimeStamp", "Value": stamp()}]


def stamp() -> str:
    """Return the time of day, UTC, as ASCOM writes it."""
    return datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")


def _arguments(member: Callable[..., object], call: Call) -> list[Any]:
    """Return the arguments of a call, in the order of the member's parameters.

    Raises:
        BadRequest: a parameter is missing, or its value is malformed.
    """
    found = []
    for parameter in inspect.signature(member).parameters.values():
        name = parameter.name.title().replace("_", "")
        text = call.fields.get(name if call.is_put else name.lower())
        if text is None:
            raise BadRequest(f"{name}: the parameter is missing; check its case")
        expected, read = _READERS[parameter.annotation]
        try:
            value = read(text)
            # Python's numbers may have underscores, and may not be finite.
            is_odd = isinstance(value, float) and not math.isfinite(value)
            if is_odd or (isinstance(value, float | int) and "_" in text):
                raise ValueError
            found.append(value)
        except (KeyError, ValueError) as error:
            raise BadRequest(f"{name}: expected {expected}, got {text[:40]!r}") from error
    return found


_READERS: Mapping[str, tuple[str, Callable[[str], Any]]] = {
    "bool": ("true or false", lambda text: {"true": True, "false": False}[text.lower()]),
    "float": ("a number", float),
    "int": ("a whole number", int),
    "str": ("text", str),
}
"""Description and reader of a parameter by its annotation."""


def _no_action(action: str, parameters: str) -> None:
    del parameters
    raise AlpacaError(ACTION_NOT_IMPLEMENTED, f"there is no action {action[:40]!r}")


def _not_implemented() -> None:
    raise AlpacaError(NOT_IMPLEMENTED, "this device does not have that")


def _number_of(error: OrientdError) -> int:
    if isinstance(error, RequestError | PlanError):
        return INVALID_VALUE
    return DRIVER if isinstance(error, DaemonError | DeviceError) else INVALID_OPERATION
