"""What the controller says of its arm at the primary interface, as bytes; no sockets here.

Big endian: ``i32 size, u8 type`` and, of a robot state message, sub-packages that begin alike.
Layout: Universal Robots, "Client Interfaces", 3.14 and 5.9 and newer, which append only.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from orientd_ur.kinematics import Calibration, Six

_ROBOT_STATE = 16
_KINEMATICS, _CONFIGURATION = 5, 6

_HEADER = struct.Struct(">iB")
# Checksums; then four lists of six.
_KINEMATICS_DATA = struct.Struct(">6I 6d 6d 6d 6d")
# Lowest and highest angle of each joint; speed and acceleration; five defaults; the table; numbers.
_CONFIGURATION_DATA = struct.Struct(">12d 12d 5d 6d 6d 6d 6d 4i")
_LARGEST = 1 << 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Configuration:
    """An arm as its controller is set up for.

    Attributes:
        lowest, highest: angle of each joint, rad.
        speeds: largest of each joint, rad/s.
        accelerations: largest of each joint, rad/s^2.
        table: its Denavit-Hartenberg parameters.
        kind: the controller's number for the model.
    """

    lowest: Six
    highest: Six
    speeds: Six
    accelerations: Six
    table: Calibration
    kind: int


def take(stream: bytes) -> tuple[int, bytes, bytes] | None:
    """Return type and contents of the first message and what follows it, or ``None`` so far.

    Raises:
        ValueError: the bytes are no message.
    """
    if len(stream) < _HEADER.size:
        return None
    size, kind = _HEADER.unpack_from(stream)
    if not _HEADER.size <= size <= _LARGEST:
        raise ValueError(f"a message of {size} bytes")
    if len(stream) < size:
        return None
    return kind, stream[_HEADER.size : size], stream[size:]


def parts(kind: int, message: bytes) -> dict[int, bytes]:
    """Return the sub-packages of a message by their types; none of any but a robot state.

    Raises:
        ValueError: the bytes are no sub-packages.
    """
    found: dict[int, bytes] = {}
    while kind == _ROBOT_STATE and message:
        taken = take(message)
        if taken is None:
            raise ValueError("a sub-package is longer than its message")
        number, contents, message = taken
        found[number] = contents
    return found


def configuration(found: dict[int, bytes]) -> Configuration | None:
    """Return the configuration among sub-packages, if it is there."""
    contents = found.get(_CONFIGURATION, b"")
    if len(contents) < _CONFIGURATION_DATA.size:
        return None
    numbers = _CONFIGURATION_DATA.unpack_from(contents)
    return Configuration(
        lowest=numbers[0:12:2],
        highest=numbers[1:12:2],
        speeds=numbers[12:24:2],
        accelerations=numbers[13:24:2],
        table=Calibration(
            a=numbers[29:35], d=numbers[35:41], alpha=numbers[41:47], theta=numbers[47:53]
        ),
        kind=numbers[55],
    )


def calibration(found: dict[int, bytes]) -> Calibration | None:
    """Return the arm's own parameters among sub-packages, if they are there."""
    contents = found.get(_KINEMATICS, b"")
    if len(contents) < _KINEMATICS_DATA.size:
        return None
    numbers = _KINEMATICS_DATA.unpack_from(contents)
    return Calibration(
        theta=numbers[6:12], a=numbers[12:18], d=numbers[18:24], alpha=numbers[24:30]
    )
