"""The few RTDE packages that a look at a controller takes, as bytes; no sockets here.

Version 2 of the protocol, from the client's side, big endian: ``u16 size, u8 kind, payload``.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

VERSION = ord("V")
CONTROLLER_VERSION = ord("v")
OUTPUTS = ord("O")
INPUTS = ord("I")
START = ord("S")
DATA = ord("U")

_HEADER = struct.Struct(">HB")

PROBED = ("timestamp", "robot_mode", "safety_mode", "runtime_state")
TCP_OFFSET = "tcp_offset"
PLACE = ("target_q", "target_TCP_pose", TCP_OFFSET)
_NUMBER = 8
_VECTOR = 6
_SAMPLE = struct.Struct(">BdiiI")
_TIMESTAMP = struct.Struct(">Bd")


def package(kind: int, payload: bytes = b"") -> bytes:
    """Return a package with its header."""
    return _HEADER.pack(_HEADER.size + len(payload), kind) + payload


def version_request() -> bytes:
    """Ask for version 2 of the protocol."""
    return package(VERSION, struct.pack(">H", 2))


def outputs_request(frequency: float, names: Sequence[str] = PROBED) -> bytes:
    """Ask for the variables *names*, *frequency* times a second."""
    return package(OUTPUTS, struct.pack(">d", frequency) + ",".join(names).encode())


def inputs_request(*names: str) -> bytes:
    """Ask to be the one that writes *names*."""
    return package(INPUTS, ",".join(names).encode())


def take(stream: bytes) -> tuple[int, bytes, bytes] | None:
    """Return kind and payload of the first package and what follows it, or ``None`` so far.

    Raises:
        ValueError: the bytes are no RTDE package.
    """
    if len(stream) < _HEADER.size:
        return None
    size, kind = _HEADER.unpack_from(stream)
    if size < _HEADER.size:
        raise ValueError(f"a package of {size} bytes is shorter than its header")
    if len(stream) < size:
        return None
    return kind, stream[_HEADER.size : size], stream[size:]


def controller_version(payload: bytes) -> tuple[int, ...]:
    """Return the four numbers of the controller's version.

    Raises:
        ValueError: the payload is not four numbers.
    """
    if len(payload) != 16:
        raise ValueError(f"a controller version is 16 bytes, got {len(payload)}")
    return struct.unpack(">4I", payload)


def sample(payload: bytes) -> tuple[float, int, int, int]:
    """Return timestamp (s), robot mode, safety mode and runtime state of a data package.

    Raises:
        ValueError: the payload is not as asked for.
    """
    if len(payload) != _SAMPLE.size:
        raise ValueError(f"a sample is {_SAMPLE.size} bytes, got {len(payload)}")
    _, timestamp, robot_mode, safety_mode, runtime_state = _SAMPLE.unpack(payload)
    return timestamp, robot_mode, safety_mode, runtime_state


def timestamp(payload: bytes) -> float:
    """Return the timestamp (s) of a data package that begins with it.

    Raises:
        ValueError: the payload is too short.
    """
    if len(payload) < _TIMESTAMP.size:
        raise ValueError(f"a timestamp takes {_TIMESTAMP.size} bytes, got {len(payload)}")
    return float(_TIMESTAMP.unpack_from(payload)[1])


def missing(answer: bytes, names: Sequence[str]) -> list[str]:
    """Return which of the variables *names* a controller does not know, by its *answer*."""
    kinds = answer[1:].decode("ascii", "replace").split(",")
    return [one for one, kind in zip(names, kinds, strict=False) if kind.strip() == "NOT_FOUND"]


def vectors(payload: bytes, count: int) -> list[tuple[float, ...]]:
    """Return the numbers of a data package of *count* variables of six numbers each.

    Raises:
        ValueError: the payload is not as asked for.
    """
    size = 1 + count * _VECTOR * _NUMBER
    if len(payload) != size:
        raise ValueError(f"a place is {size} bytes, got {len(payload)}")
    numbers = struct.unpack(f">B{count * _VECTOR}d", payload)[1:]
    return [numbers[_VECTOR * k : _VECTOR * (k + 1)] for k in range(count)]
