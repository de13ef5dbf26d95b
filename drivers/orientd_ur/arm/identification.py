"""Which arm a controller has: its model, its own calibration, its joints' speeds and ranges.

The controller is asked at its primary interface.  A model that is not among the published ones is
taken as the controller describes it, where it is built like the others.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, pi, tau

from orientd.errors import LinkError
from orientd_ur.arm import primary
from orientd_ur.arm.models import MODELS, ArmModel
from orientd_ur.kinematics import Calibration, Kinematics, Links, Six

PRIMARY_PORT = 30001

_SAME_TABLE = 0.002
"""How near a table is to a published one of the same model, m; others differ by 10 mm."""
_TWISTS = (0.5 * pi, 0.0, 0.0, 0.5 * pi, -0.5 * pi, 0.0)
_SAME_ANGLE = 0.02
_CALIBRATED = 1e-9
"""By how much calibrated parameters differ from published ones at least, rad and m."""
# Messages come ten times a second, and not each one tells everything.
_MESSAGES = 3
_ENDLESS = 10.0 * tau
FASTEST_CHANGE = 40.0
"""Acceleration of a joint where the controller says nothing of it, rad/s^2: what it is set to."""


@dataclass(frozen=True, slots=True)
class Arm:
    """One arm, as far as its joints are concerned.

    Attributes:
        name: of its model.
        links: the published lengths of the model.
        kinematics: of this very arm where its calibration is known, else of the model.
        speeds: largest speed of each joint, rad/s.
        ranges: lowest and highest angle of each joint, rad.
        accelerations: largest acceleration of each joint, rad/s^2.
    """

    name: str
    links: Links
    kinematics: Kinematics
    speeds: Six
    ranges: tuple[tuple[float, float], ...]
    accelerations: Six = (FASTEST_CHANGE,) * 6

    @property
    def is_calibrated(self) -> bool:
        """Whether the kinematics are those of this very arm."""
        return self.kinematics.is_calibrated


def published(model: ArmModel) -> Arm:
    """Return the arm of a model as it is published."""
    ranges = tuple((-most, most) for most in model.ranges)
    return Arm(model.name, model.links, Kinematics(model.links), model.speeds, ranges)


def ask(address: str, timeout: float) -> Arm:
    """Return the arm that the controller at *address* describes.

    Args:
        address: of the controller.
        timeout: s for the whole answer.

    Raises:
        LinkError: it does not say, or describes an arm that is not built like the known ones.
    """
    where = f"{address}:{PRIMARY_PORT}"
    ends = time.monotonic() + timeout
    try:
        with socket.create_connection((address, PRIMARY_PORT), timeout) as sock:
            told, own = _listen(sock, ends)
    except (OSError, ValueError) as error:
        raise LinkError(f"{where} does not say which arm it has: {error}") from error
    return _described(told, own, where)


def _listen(sock: socket.socket, ends: float) -> tuple[primary.Configuration, Calibration | None]:
    told: primary.Configuration | None = None
    pending, heard = b"", 0
    while True:
        taken = primary.take(pending)
        if taken is None:
            left = ends - time.monotonic()
            if left <= 0.0:
                raise TimeoutError("timed out")
            sock.settimeout(left)
            chunk = sock.recv(65536)
            if not chunk:
                raise ConnectionResetError("it closed the connection")
            pending += chunk
            continue
        kind, message, pending = taken
        found = primary.parts(kind, message)
        told = primary.configuration(found) or told
        own = primary.calibration(found)
        heard += told is not None
        if told is not None and (own is not None or heard >= _MESSAGES):
            return told, own


def _described(told: primary.Configuration, own: Calibration | None, where: str) -> Arm:
    """Return the arm of which a controller tells."""
    table = told.table
    lengths = Links(table.d[0], -table.a[1], -table.a[2], table.d[3], table.d[4], table.d[5])
    if max(abs(a - b) for a, b in zip(table.alpha, _TWISTS, strict=True)) > _SAME_ANGLE:
        raise LinkError(
            f"{where} describes an arm (type {told.kind}) that is not built like the known ones; "
            "`check_joints = false` plans without its joints"
        )
    model = _nearest(lengths)
    links = lengths if model is None else model.links
    speeds, ranges = list(told.speeds), list(zip(told.lowest, told.highest, strict=True))
    if model is not None:
        # Never more than is published; less where the installation says so.
        speeds = [
            min(most, said) if said > 0.0 else most
            for most, said in zip(model.speeds, told.speeds, strict=True)
        ]
        ranges = [
            (max(-most, low), min(most, high)) if low < high else (-most, most)
            for most, (low, high) in zip(model.ranges, ranges, strict=True)
        ]
    ranges = [(-inf, inf) if high - low > _ENDLESS else (low, high) for low, high in ranges]
    return Arm(
        model.name if model is not None else f"arm of type {told.kind}",
        links,
        Kinematics(links, own if own is not None and _differs(own, links) else None),
        tuple(speeds),  # type: ignore[arg-type] # six of them
        tuple(ranges),
        tuple(a if a > 0.0 else FASTEST_CHANGE for a in told.accelerations),  # type: ignore[arg-type] # six of them
    )


def _nearest(lengths: Links) -> ArmModel | None:
    """Return the published model with these lengths."""

    def off(model: ArmModel) -> float:
        return max(abs(a - b) for a, b in zip(model.links, lengths, strict=True))

    best = min(MODELS.values(), key=off)
    return best if off(best) < _SAME_TABLE else None


def _differs(own: Calibration, links: Links) -> bool:
    d1, upper_arm, forearm, d4, d5, d6 = links
    table: tuple[Sequence[float], ...] = (
        (0.0,) * 6,
        (0.0, -upper_arm, -forearm, 0.0, 0.0, 0.0),
        (d1, 0.0, 0.0, d4, d5, d6),
        _TWISTS,
    )
    return any(
        abs(a - b) > _CALIBRATED
        for mine, theirs in zip(own, table, strict=True)
        for a, b in zip(mine, theirs, strict=True)
    )
