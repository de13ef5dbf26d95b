"""What there is: devices of a configuration, families of curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from orientd.planner import Limits

if TYPE_CHECKING:
    from orientd.rotation import Floats

Outline = tuple["Floats", ...]
"""A device's shape: lines from point to point in the world, m, each of shape ``(n, 3)``."""


@dataclass(frozen=True, slots=True)
class DeviceDescription:
    """A device of the configuration.

    Attributes:
        name: what requests call it.
        driver: name of its driver.
        rate_hz: cycles a second.
        limits: what no motion of it may exceed.
        lead: how long before its time each setpoint is sent, s; 0 for a device that is not led.
        phase: where in a period of the monotonic clock its cycles begin, as a share of it.
    """

    name: str
    driver: str
    rate_hz: float
    limits: Limits
    lead: float = 0.0
    phase: float = 0.0


@dataclass(frozen=True, slots=True)
class MethodDescription:
    """A family of curves.

    Attributes:
        name: what a request calls it.
        summary: one line.
        source: where the mathematics is from.
        interpolates: whether it passes through the keyframes.
        is_local: whether a keyframe moves only the part of the curve near it.
        meets_end_velocities: whether velocities asked for at the ends are met.
    """

    name: str
    summary: str
    source: str
    interpolates: bool
    is_local: bool
    meets_end_velocities: bool


@dataclass(frozen=True, slots=True)
class PartReport:
    """How one part of a device is: a servo, a joint.

    Attributes:
        name: of the part.
        age: how long ago it was measured, s.
        is_stale: whether that is longer ago than it should be.
        voltage: of its supply, V; ``None`` where it is not told.
        temperature: degrees Celsius; ``None`` where it is not told.
        current: A; ``None`` where it is not told.
        warning: what is soon to go wrong, in words; empty where nothing is.
    """

    name: str
    age: float
    is_stale: bool = False
    voltage: float | None = None
    temperature: float | None = None
    current: float | None = None
    warning: str = ""
