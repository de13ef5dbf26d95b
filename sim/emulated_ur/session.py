"""One RTDE client's conversation with the controller: recipes, start and pause; no sockets here."""

from __future__ import annotations

import struct
from collections.abc import Callable, MutableMapping

from emulated_ur import wire
from emulated_ur.arm import TICK
from emulated_ur.controller import Controller
from emulated_ur.outputs import OUTPUT_GETTERS
from emulated_ur.variables import INPUTS, OUTPUTS, is_known
from emulated_ur.wire import Layout, Package, PackageKind, Value

Writer = Callable[[tuple[str, ...], list[Value]], None]


class ClientSession:
    """One client.

    Args:
        robot: the controller it talks to.
        owners: which session holds each input variable; shared by all sessions of a robot.
        write: what a package of inputs is handed to.
    """

    def __init__(
        self, robot: Controller, owners: MutableMapping[str, ClientSession], write: Writer
    ) -> None:
        self.robot = robot
        self.protocol = 1
        self.is_started = False
        self.malformed = 0
        self._owners = owners
        self._write = write
        self._splitter = wire.Splitter()
        self._inputs: dict[int, Layout] = {}
        self._outputs: Layout | None = None
        self._getters: list[Callable[[Controller], Value]] = []
        self._divider = 1

    def feed(self, chunk: bytes) -> bytes:
        """Take bytes from the client and return the replies.

        Raises:
            WireError: the client does not speak the protocol.
        """
        return b"".join(self._handle(package) for package in self._splitter.feed(chunk))

    def outputs(self) -> bytes:
        """Return the data package of this tick, or nothing where none is due."""
        layout = self._outputs
        if not self.is_started or layout is None or self.robot.ticks % self._divider:
            return b""
        robot = self.robot
        packed = layout.pack([getter(robot) for getter in self._getters])
        return wire.package(PackageKind.DATA, packed if self.protocol < 2 else b"\x01" + packed)

    def message(self, text: str) -> bytes:
        """Return *text* as a message to a client that is listening, or nothing."""
        # Clients in the middle of a handshake take any package for the reply they wait for.
        return wire.message(text, "emulated_ur", 3, self.protocol) if self.is_started else b""

    def close(self) -> None:
        """Give the input variables back."""
        for name in [name for name, owner in self._owners.items() if owner is self]:
            del self._owners[name]

    def _handle(self, package: Package) -> bytes:
        kind, payload = package.kind, package.payload
        if kind == PackageKind.DATA:
            self._take(payload)
            return b""
        if kind == PackageKind.VERSION:
            wanted = wire.requested_version(payload)
            if wanted in (1, 2):
                self.protocol = wanted
            return wire.accepted_reply(PackageKind.VERSION, wanted in (1, 2))
        if kind == PackageKind.CONTROLLER_VERSION:
            return wire.package(
                PackageKind.CONTROLLER_VERSION, struct.pack(">4I", *self.robot.behaviour.version)
            )
        if kind == PackageKind.OUTPUTS:
            return self._set_up_outputs(payload)
        if kind == PackageKind.INPUTS:
            return self._set_up_inputs(wire.split_names(payload))
        if kind == PackageKind.START:
            self.is_started = self._outputs is not None
            return wire.accepted_reply(PackageKind.START, self.is_started)
        if kind == PackageKind.PAUSE:
            self.is_started = False
            return wire.accepted_reply(PackageKind.PAUSE, True)
        return b""

    def _set_up_outputs(self, payload: bytes) -> bytes:
        frequency, names = wire.requested_outputs(payload, self.protocol)
        version = self.robot.behaviour.version
        types = [OUTPUTS[name] if is_known(name, version) else "NOT_FOUND" for name in names]
        fastest = 1.0 / (TICK * self.robot.behaviour.cycle_ticks)
        is_valid = bool(names) and "NOT_FOUND" not in types and 1.0 <= frequency <= fastest
        if is_valid:
            self._outputs = Layout(names, types)
            self._getters = [OUTPUT_GETTERS[name] for name in names]
            self._divider = max(1, round(1.0 / (TICK * frequency)))
        return wire.recipe_reply(PackageKind.OUTPUTS, int(is_valid), types, self.protocol)

    def _set_up_inputs(self, names: list[str]) -> bytes:
        types = [INPUTS.get(name, "NOT_FOUND") for name in names]
        taken = [self._owners.get(name, self) is not self for name in names]
        types = ["IN_USE" if used else kind for used, kind in zip(taken, types, strict=True)]
        number = 0
        if names and not {"NOT_FOUND", "IN_USE"} & set(types):
            number = len(self._inputs) + 1
            self._inputs[number] = Layout(names, types)
            for name in names:
                self._owners[name] = self
        return wire.recipe_reply(PackageKind.INPUTS, number, types, self.protocol)

    def _take(self, payload: bytes) -> None:
        layout = self._inputs.get(payload[0]) if payload else None
        if layout is None:
            self.malformed += 1
            return
        try:
            values = layout.unpack(payload[1:])
        except wire.WireError:
            # A pose with a number missing: a real controller drops such a package too.
            self.malformed += 1
            return
        self._write(layout.names, values)
