"""RTDE as bytes, and the protocol of one client with the controller; no sockets here.

The Real-Time Data Exchange protocol, versions 1 and 2, of a UR controller.  Everything is big
endian.  A package is ``u16 size, u8 kind, payload``; the size includes the three bytes of the
header.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, MutableMapping, Sequence
from dataclasses import dataclass
from enum import IntEnum

from emulated_ur.arm import TICK
from emulated_ur.connection import Talk
from emulated_ur.controller import Controller, Event
from emulated_ur.variables import TYPES, VARIABLES, Scalar, Value

HEADER = struct.Struct(">HB")
LARGEST = 4096

Writer = Callable[[tuple[str, ...], list[Value]], None]


class PackageKind(IntEnum):
    """The eight kinds of package; each number is the ASCII code of a letter."""

    VERSION = ord("V")
    CONTROLLER_VERSION = ord("v")
    MESSAGE = ord("M")
    DATA = ord("U")
    OUTPUTS = ord("O")
    INPUTS = ord("I")
    START = ord("S")
    PAUSE = ord("P")


class WireError(Exception):
    """Bytes that are not a package of the protocol."""


@dataclass(frozen=True, slots=True)
class Package:
    """One package: its kind (known or not) and its payload."""

    kind: int
    payload: bytes

    def packed(self) -> bytes:
        """Return the package with its header, as bytes."""
        return HEADER.pack(HEADER.size + len(self.payload), self.kind) + self.payload


class PackageSplitter:
    """Split a stream of bytes into packages, independent of the network's segments."""

    def __init__(self) -> None:
        self._pending = bytearray()

    def feed(self, chunk: bytes) -> list[Package]:
        """Return the packages completed by *chunk*, oldest first.

        Raises:
            WireError: a header has an impossible size.
        """
        pending = self._pending
        pending += chunk
        packages: list[Package] = []
        start = 0
        while len(pending) - start >= HEADER.size:
            size, kind = HEADER.unpack_from(pending, start)
            if not HEADER.size <= size <= LARGEST:
                raise WireError(f"package size must be {HEADER.size} to {LARGEST}, got {size}")
            if len(pending) - start < size:
                break
            packages.append(Package(kind, bytes(pending[start + HEADER.size : start + size])))
            start += size
        del pending[:start]
        return packages


class Layout:
    """The layout of one recipe's values in a data package.

    Args:
        names: the variables in their order on the wire.
        types: their types, keys of :data:`~emulated_ur.variables.TYPES`.
    """

    def __init__(self, names: Sequence[str], types: Sequence[str]) -> None:
        self.names = tuple(names)
        self._widths = tuple(TYPES[kind][1] for kind in types)
        self._body = struct.Struct(">" + "".join(TYPES[kind][0] for kind in types))

    @property
    def size(self) -> int:
        """Bytes of the packed values, without header and recipe id."""
        return self._body.size

    def pack(self, values: Iterable[Value]) -> bytes:
        """Return *values*, one for each variable, as bytes."""
        flat: list[Scalar] = []
        for value in values:
            if isinstance(value, tuple):
                flat.extend(value)
            else:
                flat.append(value)
        return self._body.pack(*flat)

    def unpack(self, packed: bytes) -> list[Value]:
        """Return one value for each variable; bytes beyond the layout are tolerated.

        Raises:
            WireError: *packed* is too short.
        """
        if len(packed) < self.size:
            raise WireError(f"values need {self.size} bytes, got {len(packed)}")
        flat = self._body.unpack_from(packed)
        values: list[Value] = []
        at = 0
        for width in self._widths:
            values.append(flat[at] if width == 1 else flat[at : at + width])
            at += width
        return values


class RtdeSession(Talk):
    """One client: its recipes, start and pause.

    Args:
        robot: the controller it talks to.
        owners: the session of each input variable; shared by all sessions of a robot.
        write: receives a package of inputs.

    Attributes:
        malformed: number of dropped packages of inputs.
    """

    def __init__(
        self, robot: Controller, owners: MutableMapping[str, RtdeSession], write: Writer
    ) -> None:
        self.robot = robot
        self.protocol = 1
        self.is_started = False
        self.malformed = 0
        self._owners = owners
        self._write = write
        self._splitter = PackageSplitter()
        self._inputs: dict[int, Layout] = {}
        self._outputs: Layout | None = None
        self._divider = 1

    def feed(self, chunk: bytes) -> bytes:
        """Receive bytes from the client and return the replies.

        Raises:
            WireError: the client does not speak the protocol.
        """
        replies = [self._handle(package) for package in self._splitter.feed(chunk)]
        return b"".join(reply.packed() for reply in replies if reply)

    def tick(self) -> bytes:
        """Return the data package of this tick, or nothing if none is due."""
        layout = self._outputs
        if not self.is_started or layout is None or self.robot.ticks % self._divider:
            return b""
        packed = layout.pack([self.robot.value(name) for name in layout.names])
        recipe = b"" if self.protocol < 2 else b"\x01"
        return Package(PackageKind.DATA, recipe + packed).packed()

    def tell(self, event: Event) -> bytes:
        """Return a line of the controller's log as a message to a listening client."""
        # Clients in the middle of a handshake mistake any package for the awaited reply.
        if event.kind != "log" or not self.is_started:
            return b""
        information, source = b"\x03", b"emulated_ur"
        body = event.text.encode()[:255]
        if self.protocol < 2:
            return Package(PackageKind.MESSAGE, information + body).packed()
        words = b"".join(bytes([len(one)]) + one for one in (body, source))
        return Package(PackageKind.MESSAGE, words + information).packed()

    def close(self) -> None:
        """Release the input variables."""
        for name in [name for name, owner in self._owners.items() if owner is self]:
            del self._owners[name]

    def _handle(self, package: Package) -> Package | None:
        kind, payload = package.kind, package.payload
        if kind == PackageKind.DATA:
            self._take(payload)
        elif kind == PackageKind.VERSION:
            if len(payload) != 2:
                raise WireError(f"a version is 2 bytes, got {len(payload)}")
            wanted = int.from_bytes(payload, "big")
            is_spoken = wanted in (1, 2)
            self.protocol = wanted if is_spoken else self.protocol
            return Package(kind, bytes([is_spoken]))
        elif kind == PackageKind.CONTROLLER_VERSION:
            return Package(kind, struct.pack(">4I", *self.robot.behaviour.version))
        elif kind == PackageKind.OUTPUTS:
            return Package(kind, self._set_up_outputs(payload))
        elif kind == PackageKind.INPUTS:
            return Package(kind, self._set_up_inputs(_names(payload)))
        elif kind in (PackageKind.START, PackageKind.PAUSE):
            is_start = kind == PackageKind.START
            self.is_started = is_start and self._outputs is not None
            return Package(kind, bytes([self.is_started or not is_start]))
        return None

    def _set_up_outputs(self, payload: bytes) -> bytes:
        frequency = 125.0  # of version 1, whose clients name none
        if self.protocol >= 2:
            if len(payload) < 8:
                raise WireError(f"a request for outputs has 8 bytes or more, got {len(payload)}")
            (frequency,) = struct.unpack_from(">d", payload)
            payload = payload[8:]
        names = _names(payload)
        types = [self._type(name, is_output=True) for name in names]
        fastest = 1.0 / (TICK * self.robot.behaviour.cycle_ticks)
        is_valid = bool(names) and "NOT_FOUND" not in types and 1.0 <= frequency <= fastest
        if is_valid:
            self._outputs = Layout(names, types)
            self._divider = max(1, round(1.0 / (TICK * frequency)))
        text = ",".join(types).encode()
        return text if self.protocol < 2 else bytes([is_valid]) + text

    def _set_up_inputs(self, names: list[str]) -> bytes:
        types = [
            "IN_USE"
            if self._owners.get(name, self) is not self
            else self._type(name, is_output=False)
            for name in names
        ]
        number = 0
        if names and not {"NOT_FOUND", "IN_USE"} & set(types):
            number = len(self._inputs) + 1
            self._inputs[number] = Layout(names, types)
            self._owners.update(dict.fromkeys(names, self))
        return bytes([number]) + ",".join(types).encode()

    def _type(self, name: str, *, is_output: bool) -> str:
        one = VARIABLES.get(name)
        is_there = (
            one is not None
            and (one.is_output if is_output else one.is_input)
            and one.since.includes(self.robot.behaviour.version)
        )
        return one.kind if one and is_there else "NOT_FOUND"

    def _take(self, payload: bytes) -> None:
        layout = self._inputs.get(payload[0]) if payload else None
        try:
            if layout is None:
                raise WireError("no such recipe")
            values = layout.unpack(payload[1:])
        except WireError:
            # A pose with a missing number: a real controller also drops such a package.
            self.malformed += 1
        else:
            self._write(layout.names, values)


def _names(text: bytes) -> list[str]:
    """Return the variable names of a comma-separated list; some clients end it with a comma."""
    return [name.strip() for name in text.decode("ascii", "replace").split(",") if name.strip()]
