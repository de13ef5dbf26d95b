"""The members that every device of Alpaca has."""

from __future__ import annotations

import threading
import uuid
from datetime import UTC, datetime
from typing import Any

import orientd
from orientd.adapters import alpaca_protocol as protocol
from orientd.adapters.alpaca_mount import Mount
from orientd.adapters.alpaca_protocol import (
    AlpacaError,
    BadRequest,
    Call,
    Member,
    Members,
    boolean,
    missing,
)

_INTERFACE = 4
"""Version of ITelescope and IRotator, as of ASCOM Platform 7."""


class AlpacaDevice:
    """A device of an Alpaca server.

    Attributes:
        kind: ``Telescope`` or ``Rotator``.
        name: for people.
        unique_id: the same after every start.
        gets, puts: its members by their names in an address.
        state: names of the properties in ``devicestate``.
    """

    kind = ""
    state: tuple[str, ...] = ()

    def __init__(self, mount: Mount) -> None:
        """Serve *mount*."""
        self._mount = mount
        served = mount.served.name
        self.name = f"orientd {self.kind.lower()} {served}"
        self.unique_id = str(uuid.uuid5(uuid.NAMESPACE_DNS, f"{uuid.getnode()}/{self.name}"))
        self._clients: set[int] = set()
        self._lock = threading.Lock()
        text = protocol.missing(Command=str, Raw=boolean)
        self.gets: dict[str, Member] = {
            "connecting": Member(lambda: False, is_free=True),
            "description": Member(lambda: f"device {served} of orientd", is_free=True),
            "driverinfo": Member(lambda: f"orientd {orientd.__version__}", is_free=True),
            "driverversion": Member(
                lambda: ".".join(orientd.__version__.split(".")[:2]), is_free=True
            ),
            "interfaceversion": Member(lambda: _INTERFACE, is_free=True),
            "name": Member(lambda: self.name, is_free=True),
            "supportedactions": Member(list, is_free=True),
            "devicestate": Member(self._device_state),
            **self.own_gets(),
        }
        self.puts: dict[str, Member] = {
            "action": Member(_no_action, {"Action": str, "Parameters": str}, is_free=True),
            "commandblind": text,
            "commandbool": text,
            "commandstring": text,
            **self.own_puts(),
        }

    def own_gets(self) -> Members:
        """Return the properties of this kind of device."""
        raise NotImplementedError

    def own_puts(self) -> Members:
        """Return the methods of this kind of device."""
        raise NotImplementedError

    def answer(self, name: str, call: Call) -> dict[str, Any]:
        """Return the answer to a call of a member.

        Raises:
            BadRequest: the device has no such member, or a parameter is malformed.
        """
        member = self._connection(call).get((call.is_put, name))
        if member is None:
            member = (self.puts if call.is_put else self.gets).get(name)
        if member is None:
            raise BadRequest(f"{name[:40]!r} is not a member of a {self.kind.lower()}")
        with self._lock:
            is_connected = bool(self._clients)
        return protocol.answer(member, call, is_connected=is_connected)

    def close(self) -> None:
        """Send the device no more targets."""
        self._mount.close()

    def _connection(self, call: Call) -> dict[tuple[bool, str], Member]:
        """Return the members that depend on who calls."""

        def is_connected() -> bool:
            with self._lock:
                return call.client in self._clients

        def connect(wanted: bool = True) -> None:
            if wanted:
                self._mount.connect()
            with self._lock:
                (self._clients.add if wanted else self._clients.discard)(call.client)

        return {
            (False, "connected"): Member(is_connected, is_free=True),
            (True, "connected"): Member(connect, {"Connected": boolean}, is_free=True),
            (True, "connect"): Member(connect, is_free=True),
            (True, "disconnect"): Member(lambda: connect(wanted=False), is_free=True),
        }

    def _device_state(self) -> list[dict[str, Any]]:
        found = [{"Name": name, "Value": self.gets[name.lower()].call()} for name in self.state]
        stamp = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%S.%fZ")
        return [*found, {"Name": "TimeStamp", "Value": stamp}]


def _no_action(name: str, parameters: str) -> None:
    del parameters
    raise AlpacaError(protocol.ACTION_NOT_IMPLEMENTED, f"there is no action {name[:40]!r}")


def unavailable(*names: str, **parameters: protocol.Reader) -> Members:
    """Return members of these names that the device does not have."""
    return {name: missing(**parameters) for name in names}
