"""The arm of a controller, read from its primary interface.

This gives its model, its own calibration, and its joints' speeds, accelerations and ranges.  An
unknown model is accepted as the controller describes it, if it has the usual geometry.

Big endian: ``i32 size, u8 type`` and, in a robot state message, sub-packages with the same header.
Layout: Universal Robots, "Client Interfaces", 3.14 and 5.9 and newer, which append only.
"""

from __future__ import annotations

import struct
from math import inf, tau

from orientd.driver import AxisLimits
from orientd.errors import LinkError
from orientd_ur.arm import FASTEST_CHANGE, JOINT_NAMES, MODELS, Arm, ArmModel
from orientd_ur.kinematics import Kinematics, Links, Six, Table
from orientd_ur.wire import PRIMARY_PORT, Connection, take

_ROBOT_STATE = 16
_KINEMATICS, _CONFIGURATION = 5, 6

_HEADER = struct.Struct(">iB")
_LARGEST = 1 << 16
# Checksums; then four lists of six.
_KINEMATICS_CONTENTS = struct.Struct(">6I 6d 6d 6d 6d")
# Lowest and highest angle of each joint; speed and acceleration; five defaults; the table; numbers.
_CONFIGURATION_CONTENTS = struct.Struct(">12d 12d 5d 6d 6d 6d 6d 4i")
# Messages come ten times a second, and some have only parts.
_MESSAGES = 3

_SAME_TABLE = 0.002
"""Largest distance from the published table of the same model, m; others differ by 10 mm."""
_SAME_ANGLE = 0.02
_CALIBRATED = 1e-9
"""Least difference of calibrated parameters from published ones, rad and m."""
_ENDLESS = 10.0 * tau


def ask(address: str, timeout: float) -> Arm:
    """Return the arm that the controller at *address* describes.

    Args:
        address: of the controller.
        timeout: s for the whole answer.

    Raises:
        LinkError: the controller gives no description, or one of an arm with unusual geometry.
    """
    with Connection(address, PRIMARY_PORT, "primary interface", timeout, total=timeout) as link:
        configuration, own = link.receive(_find, "a description of its arm")
    return _described(_CONFIGURATION_CONTENTS.unpack_from(configuration), own)


def _find(stream: bytes) -> tuple[tuple[bytes, Table | None], bytes] | None:
    """Return the configuration in a stream, and the arm's own table if it comes in time."""
    configuration, heard = b"", 0
    while (taken := take(stream, _HEADER, _LARGEST)) is not None:
        kind, message, stream = taken
        found = _parts(message) if kind == _ROBOT_STATE else {}
        if len(contents := found.get(_CONFIGURATION, b"")) >= _CONFIGURATION_CONTENTS.size:
            configuration = contents
        own = found.get(_KINEMATICS, b"")
        heard += bool(configuration)
        if configuration and len(own) >= _KINEMATICS_CONTENTS.size:
            numbers = _KINEMATICS_CONTENTS.unpack_from(own)
            theta, a, d, alpha = (numbers[k : k + 6] for k in (6, 12, 18, 24))
            return (configuration, Table(theta, a, d, alpha)), stream
        if heard >= _MESSAGES:
            return (configuration, None), stream
    return None


def _parts(message: bytes) -> dict[int, bytes]:
    """Return the sub-packages of a robot state message by their types.

    Raises:
        ValueError: the bytes are no sub-packages.
    """
    found: dict[int, bytes] = {}
    while message:
        taken = take(message, _HEADER, _LARGEST)
        if taken is None:
            raise ValueError("a sub-package is longer than its message")
        kind, contents, message = taken
        found[kind] = contents
    return found


def _described(numbers: tuple[float, ...], own: Table | None) -> Arm:
    """Return the arm that the *numbers* of a controller's configuration describe."""
    a, d, alpha = numbers[29:35], numbers[35:41], numbers[41:47]
    kind = int(numbers[55])
    lengths = Links(d[0], -a[1], -a[2], d[3], d[4], d[5])
    if _farthest(alpha, lengths.table.alpha) > _SAME_ANGLE:
        raise LinkError(
            f"the controller describes an arm (type {kind}) that is not built like the known ones; "
            "`check_joints = false` plans without its joints"
        )
    model = _published(lengths)
    links = lengths if model is None else model.links
    axes = []
    for k, name in enumerate(JOINT_NAMES):
        low, high = numbers[2 * k], numbers[2 * k + 1]
        speed, acceleration = numbers[12 + 2 * k], numbers[13 + 2 * k]
        if model is not None:
            # At most the published values; less if the installation limits them.
            most = model.ranges[k]
            low, high = (max(-most, low), min(most, high)) if low < high else (-most, most)
            speed = min(model.speeds[k], speed) if speed > 0.0 else model.speeds[k]
        if high - low > _ENDLESS:
            low, high = -inf, inf
        acceleration = acceleration if acceleration > 0.0 else FASTEST_CHANGE
        axes.append(AxisLimits(name, low, high, speed, acceleration))
    is_own = own is not None and any(
        _farthest(mine, theirs) > _CALIBRATED for mine, theirs in zip(own, links.table, strict=True)
    )
    name = f"arm of type {kind}" if model is None else model.name
    return Arm(name, Kinematics(links, own if is_own else None), tuple(axes))


def _published(lengths: Links) -> ArmModel | None:
    """Return the published model with these lengths."""
    best = min(MODELS.values(), key=lambda model: _farthest(model.links, lengths))
    return best if _farthest(best.links, lengths) < _SAME_TABLE else None


def _farthest(one: Six | tuple[float, ...], other: Six | tuple[float, ...]) -> float:
    return max(abs(a - b) for a, b in zip(one, other, strict=True))
