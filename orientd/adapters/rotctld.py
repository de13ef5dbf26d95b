"""Serve the protocol of Hamlib's rotctld, so that antenna programs point a device."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import orientd
from orientd.adapters import rotctl_protocol as protocol
from orientd.adapters.pointing import Direction, direction, orientation
from orientd.adapters.rotctl_protocol import Command
from orientd.adapters.served import Served
from orientd.errors import DaemonError, DeviceError, OrientdError, RequestError
from orientd.own_socket import own_socket
from orientd.protocol import control_pb2 as pb
from orientd.protocol import to_quaternion
from orientd.rotation import Quaternion

_IDLE = 0.5
"""Seconds from one look to the next at whether the server ends."""


@dataclass(frozen=True, slots=True)
class Ranges:
    """The directions that a client may ask for.

    Attributes:
        azimuth: the least and the largest, degrees.
        elevation: the least and the largest, degrees.
    """

    azimuth: tuple[float, float]
    elevation: tuple[float, float]

    def has(self, wanted: Direction) -> bool:
        """Return whether a direction is among them."""
        (west, east), (low, high) = self.azimuth, self.elevation
        return west <= wanted.azimuth <= east and low <= wanted.elevation <= high


class Rotctld:
    """A server for the clients of rotctld.

    Attributes:
        endpoint: address and port.
    """

    def __init__(
        self, served: Served, *, host: str, port: int, ranges: Ranges, north: float, park: Direction
    ) -> None:
        """Listen at *host* and *port*.

        Args:
            served: the device.
            host: an address of this machine.
            port: 0 for any.
            ranges: what clients may ask for.
            north: angle of north from the world's x axis, counted towards y, degrees.
            park: direction of the command ``K``.

        Raises:
            DaemonError: the port is in use, or the address is not one of this machine.
        """
        self._served, self._ranges, self._north, self._park = served, ranges, north, park
        self._listener = own_socket(host, port)
        host, port = self._listener.getsockname()[:2]
        self.endpoint = f"{host}:{port}"
        self._clients: dict[threading.Thread, socket.socket] = {}
        self._asked: Direction | None = None
        self._do: dict[str, Callable[[Command], Mapping[str, str] | None]] = {
            "set_pos": self._set_position,
            "get_pos": self._position,
            "stop": self._stop,
            "park": self._go_to_park,
            "reset": self._reset,
            "get_info": self._info,
        }

    def serve(self) -> None:
        """Serve until the process is interrupted."""
        while True:
            client, _ = self._listener.accept()
            thread = threading.Thread(target=self._talk, args=(client,), daemon=True)
            self._clients[thread] = client
            thread.start()

    def close(self) -> None:
        """Hang up on every client, and wait for their commands to end."""
        self._listener.close()
        for thread, client in list(self._clients.items()):
            with contextlib.suppress(OSError):
                client.shutdown(socket.SHUT_RDWR)
            thread.join()

    def _talk(self, client: socket.socket) -> None:
        """Answer a client until it hangs up."""
        with client, contextlib.suppress(OSError):
            for line in _lines(client):
                for command in protocol.commands(line):
                    if command.kind is not None and command.kind.name == "quit":
                        return
                    client.sendall(self._answer(command).encode())
        self._clients.pop(threading.current_thread(), None)

    def _answer(self, command: Command) -> str:
        if command.kind is None or command.kind.name not in self._do:
            return protocol.failed(command, command.error or protocol.UNAVAILABLE)
        try:
            return protocol.answered(command, self._do[command.kind.name](command))
        except (ValueError, RequestError):
            return protocol.failed(command, protocol.INVALID)
        except (DaemonError, DeviceError):
            return protocol.failed(command, protocol.IO_ERROR)
        except OrientdError:
            return protocol.failed(command, protocol.REJECTED)

    def _set_position(self, command: Command) -> None:
        wanted = Direction(*map(protocol.number, command.arguments))
        if not self._ranges.has(wanted):
            raise ValueError(f"expected a direction in {self._ranges}, got {wanted}")
        self._go(wanted)

    def _go(self, wanted: Direction) -> None:
        self._asked = wanted
        w, x, y, z = orientation(wanted, self._north)
        self._served.move([Quaternion(w=w, x=x, y=y, z=z)], approach=True)

    def _position(self, command: Command) -> Mapping[str, str]:
        del command
        cycle = self._served.report().cycle
        if not cycle.HasField("feedback_q"):
            raise DaemonError("the device has measured nothing yet")
        found = direction(to_quaternion(cycle.feedback_q), self._north)
        with self._served.lock:
            found = found.in_turn_of(self._asked or Direction(180.0, 45.0))
        return {"Azimuth": f"{found.azimuth:.2f}", "Elevation": f"{found.elevation:.2f}"}

    def _stop(self, command: Command) -> None:
        del command
        self._served.stop()

    def _go_to_park(self, command: Command) -> None:
        del command
        self._go(self._park)

    def _reset(self, command: Command) -> None:
        protocol.number(command.arguments[0])
        if self._served.report().state == pb.STATE_FAULT:
            self._served.robot.reset(self._served.name)

    def _info(self, command: Command) -> Mapping[str, str]:
        del command
        return {"Info": f"orientd {orientd.__version__}: {self._served.name}"}


def _lines(client: socket.socket) -> Iterator[bytes]:
    """Yield the lines that a client sends; one that is too long ends the conversation."""
    rest = b""
    while chunk := client.recv(4096):
        *lines, rest = (rest + chunk).split(b"\n")
        yield from lines
        if len(rest) > protocol.LONGEST:
            return
