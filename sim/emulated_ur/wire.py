"""RTDE packages as bytes: headers, variable types, recipes; no sockets here.

The Real-Time Data Exchange protocol of a UR controller, versions 1 and 2, as the controller
speaks it.  Everything is big endian.  A package is ``u16 size, u8 kind, payload`` where the size
counts the three bytes of the header.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum

HEADER = struct.Struct(">HB")
LARGEST = 4096

Scalar = int | float
Value = Scalar | tuple[Scalar, ...]


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
    """One package: its kind (a known one or not) and what follows the header."""

    kind: int
    payload: bytes


class Splitter:
    """Cut a stream of bytes into packages, however the stream was cut by the network."""

    def __init__(self) -> None:
        self._pending = bytearray()

    def feed(self, chunk: bytes) -> list[Package]:
        """Return the packages completed by *chunk*, oldest first.

        Raises:
            WireError: a header announces a size that no package has.
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


# How a variable's type is packed, and how many numbers it holds.
TYPES: dict[str, tuple[str, int]] = {
    "BOOL": ("B", 1),
    "UINT8": ("B", 1),
    "UINT32": ("I", 1),
    "INT32": ("i", 1),
    "UINT64": ("Q", 1),
    "DOUBLE": ("d", 1),
    "VECTOR3D": ("3d", 3),
    "VECTOR6D": ("6d", 6),
    "VECTOR6INT32": ("6i", 6),
    "VECTOR6UINT32": ("6I", 6),
}


class Layout:
    """How the values of one recipe lie in a data package.

    Args:
        names: the variables in their order on the wire.
        types: their types, keys of :data:`TYPES`.
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


def package(kind: PackageKind, payload: bytes = b"") -> bytes:
    """Return a package with its header."""
    return HEADER.pack(HEADER.size + len(payload), kind) + payload


def split_names(text: bytes) -> list[str]:
    """Return the variable names of a comma list; clients differ in the comma at its end."""
    return [name.strip() for name in text.decode("ascii", "replace").split(",") if name.strip()]


def requested_outputs(payload: bytes, protocol: int) -> tuple[float, list[str]]:
    """Return the frequency (Hz) and the names of a request for outputs.

    Version 1 names no frequency; its packages come at 125 Hz.

    Raises:
        WireError: the payload is shorter than its frequency.
    """
    if protocol < 2:
        return 125.0, split_names(payload)
    if len(payload) < 8:
        raise WireError(f"a request for outputs needs at least 8 bytes, got {len(payload)}")
    (frequency,) = struct.unpack_from(">d", payload)
    return frequency, split_names(payload[8:])


def requested_version(payload: bytes) -> int:
    """Return the protocol version a client asks for.

    Raises:
        WireError: the payload is not two bytes long.
    """
    if len(payload) != 2:
        raise WireError(f"a version is 2 bytes, got {len(payload)}")
    (version,) = struct.unpack(">H", payload)
    return int(version)


def recipe_reply(kind: PackageKind, recipe: int, types: Sequence[str], protocol: int) -> bytes:
    """Return the reply to a request for outputs or inputs: the types, and the recipe's number."""
    text = ",".join(types).encode("ascii")
    return package(
        kind, text if protocol < 2 and kind is PackageKind.OUTPUTS else bytes([recipe]) + text
    )


def accepted_reply(kind: PackageKind, is_accepted: bool) -> bytes:
    """Return the one-byte reply to a version, start or pause request."""
    return package(kind, bytes([is_accepted]))


def message(text: str, source: str, level: int, protocol: int) -> bytes:
    """Return a text message; *level* is 0 exception, 1 error, 2 warning, 3 information."""
    body = text.encode("utf-8")[:255]
    origin = source.encode("utf-8")[:255]
    if protocol < 2:
        return package(PackageKind.MESSAGE, bytes([level]) + body)
    return package(
        PackageKind.MESSAGE,
        bytes([len(body)]) + body + bytes([len(origin)]) + origin + bytes([level]),
    )
