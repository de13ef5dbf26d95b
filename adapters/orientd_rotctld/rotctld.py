"""Serve the protocol of Hamlib's rotctld, so that antenna programs point a device."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable, Mapping, Sequence

import orientd
from orientd.errors import DaemonError, DeviceError, OrientdError
from orientd.own_socket import ClientListener, own_socket
from orientd.protocol import control_pb2 as pb
from orientd_rotctld import rotctl_protocol as protocol
from orientd_rotctld.passes import Passes
from orientd_rotctld.pointer import Pointer
from orientd_rotctld.ranges import Ranges
from orientd_rotctld.rotctl_protocol import Command
from orientd_rotctld.sky import Target
from orientd_serving.pointing import Direction
from orientd_serving.served import Denials, Served

_MODEL = "2"
"""Hamlib's number of the rotators that are reached over this protocol."""
_ABILITIES = ("set Position", "get Position", "Stop", "Park", "Reset", "Move", "get Info")
_DIRECTIONS = {
    "UP": (0, 1),
    "DOWN": (0, -1),
    "LEFT": (-1, 0),
    "RIGHT": (1, 0),
    "UP_LEFT": (-1, 1),
    "UP_RIGHT": (1, 1),
    "DOWN_LEFT": (-1, -1),
    "DOWN_RIGHT": (1, -1),
}
"""Signs of the turn in azimuth and elevation."""
_CODES = {str(2 << place): name for place, name in enumerate(_DIRECTIONS)}
_CODES |= {name.replace("LEFT", "CCW").replace("RIGHT", "CW"): name for name in _DIRECTIONS}
_PARK = Direction(0.0, 0.0)
_UNCHANGED = -1.0
"""The speed that stands for the present one."""


class Rotctld:
    """A server for the clients of rotctld.

    Attributes:
        endpoint: address and port.
    """

    def __init__(
        self,
        served: Served,
        *,
        host: str,
        port: int,
        ranges: Ranges,
        targets: Sequence[Target] = (),
        notify: Callable[[str], None],
    ) -> None:
        """Listen at *host* and *port*.

        Args:
            served: the device.
            host: an address of this machine.
            port: 0 for any.
            ranges: what clients may ask for.
            targets: whose passes are planned whole.
            notify: takes lines for people.

        Raises:
            DaemonError: the port is in use, or the address is not one of this machine.
        """
        self._served, self._ranges, self._notify = served, ranges, notify
        self._passes = Passes(served, targets, ranges=ranges, notify=notify)
        self._pointer = Pointer(served, self._passes, ranges)
        self._deny = Denials(notify)
        listening = own_socket(host, port)
        self._listener = ClientListener(listening)
        host, port = listening.getsockname()[:2]
        self.endpoint = f"{host}:{port}"
        self._clients: dict[threading.Thread, socket.socket] = {}
        self._do: dict[str, Callable[..., Mapping[str, str] | None]] = {
            "set_pos": self._set_position,
            "get_pos": self._position,
            "stop": self._stop,
            "park": self._go_to_park,
            "reset": self._reset,
            "move": self._turn,
            "get_info": self._info,
            "get_status": self._status,
            "dump_caps": self._capabilities,
            "dump_state": self._state,
        }

    def serve(self) -> None:
        """Serve until the process is interrupted."""
        while True:
            try:
                client, _ = self._listener.accept()
            except ConnectionError:
                continue
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
        self._passes.close()

    def _talk(self, client: socket.socket) -> None:
        """Answer a client until it hangs up."""
        with client, client.makefile("rb") as stream, contextlib.suppress(OSError):
            while line := stream.readline(protocol.LONGEST + 1):
                is_too_long = len(line) > protocol.LONGEST
                if not (is_too_long or line.endswith(b"\n")):
                    break  # the client has hung up within a line
                for command in protocol.commands(line):
                    if command.name == "quit":
                        return
                    client.sendall(self._answer(command).encode())
                if is_too_long:
                    break
        self._clients.pop(threading.current_thread(), None)

    def _answer(self, command: Command) -> str:
        if command.name not in self._do:
            self._deny(command.problem)
            return protocol.failed(command, command.error or protocol.UNAVAILABLE)
        shown = " ".join((command.name, *command.arguments))
        try:
            return protocol.answered(command, self._do[command.name](*command.arguments))
        except ValueError as error:
            self._deny(f"{shown}: {error}")
            return protocol.failed(command, protocol.INVALID)
        except OrientdError as error:
            self._deny(f"{command.name} was refused: {error}")
            is_lost = isinstance(error, DaemonError | DeviceError)
            return protocol.failed(command, protocol.IO_ERROR if is_lost else protocol.REJECTED)

    def _set_position(self, *angles: str) -> None:
        wanted = Direction(*map(protocol.number, angles))
        if problem := self._ranges.problem(wanted):
            raise ValueError(problem)
        with self._served.lock:
            self._pointer.go(wanted, max(map(protocol.rounding, angles)))

    def _position(self) -> Mapping[str, str]:
        found = self._pointer.measured()
        if found is None:
            raise DaemonError("the device has measured nothing yet")
        return {"Azimuth": f"{found.azimuth:.2f}", "Elevation": f"{found.elevation:.2f}"}

    def _stop(self) -> None:
        self._pointer.stop()

    def _go_to_park(self) -> None:
        with self._served.lock:
            self._pointer.go(self._ranges.nearest(self._ranges.form(_PARK, _PARK)))

    def _reset(self, kind: str) -> None:
        if not kind.isdecimal():
            raise ValueError(f"expected the number of a reset, such as 1 for all, got {kind!r}")
        if self._served.report().state == pb.STATE_FAULT:
            self._served.robot.reset(self._served.name)

    def _turn(self, word: str, speed: str) -> None:
        """Turn in a direction, at a percentage of the velocity limit, until a stop."""
        percent = protocol.number(speed)
        signs = _DIRECTIONS.get(word) or _DIRECTIONS.get(_CODES.get(word, ""))
        if signs is None:
            known = ", ".join(_DIRECTIONS)
            raise ValueError(f"expected a direction, one of {known}, or its number, got {word!r}")
        if not (1.0 <= percent <= 100.0 or percent == _UNCHANGED):
            raise ValueError(
                f"expected a speed from 1 to 100 percent, or -1 for no change, got {percent:g}"
            )
        share = 1.0 if percent == _UNCHANGED else 0.01 * percent
        with self._served.lock:
            self._pointer.turn(signs, share)

    def _status(self) -> Mapping[str, str]:
        is_moving = self._served.report().state == pb.STATE_STREAMING
        return {"Status flags": "MOVING" if is_moving else ""}

    def _capabilities(self) -> Mapping[str, str]:
        (west, east), (low, high) = self._ranges.azimuth, self._ranges.elevation
        return {
            "Caps dump for model": _MODEL,
            "Model name": self._served.name,
            "Mfg name": "orientd",
            "Backend version": orientd.__version__,
            "Rot type": "Az-El",
            "Min Azimuth": f"{west:.2f}",
            "Max Azimuth": f"{east:.2f}",
            "Min Elevation": f"{low:.2f}",
            "Max Elevation": f"{high:.2f}",
            **{f"Can {name}": "Y" for name in _ABILITIES},
        }

    def _state(self) -> Mapping[str, str]:
        (west, east), (low, high) = self._ranges.azimuth, self._ranges.elevation
        return {
            "rotctld Protocol Ver": "1",
            "Rotor Model": _MODEL,
            "min_az": f"{west:.6f}",
            "max_az": f"{east:.6f}",
            "min_el": f"{low:.6f}",
            "max_el": f"{high:.6f}",
            "south_zero": "0",
            "rot_type": "AzEl",
        }

    def _info(self) -> Mapping[str, str]:
        return {"Info": f"orientd {orientd.__version__}: {self._served.name}"}
