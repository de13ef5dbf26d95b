"""The angles and rates that a gimbal announces, and keeps: one value, made from its device."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from orientd_mavlink.setpoint import NEUTRAL, RETRACT, Wish, level

NAMES = ("roll", "pitch", "yaw")

_EVERY = 1 | 2 | 4096
"""Capabilities of every device: retract, neutral, yaw in the earth frame."""

_OF_AXES = {"X": 0b111 << 2, "Y": 0b111 << 5, "Z": 0b111 << 8}
"""Capabilities of an axis: there is one, it follows the vehicle, it is locked."""

_ENDLESS_YAW = 2048

_WHOLE = (-math.pi, math.pi)
_ANY: tuple[tuple[float, float], ...] = (_WHOLE, (-0.5 * math.pi, 0.5 * math.pi), _WHOLE)
"""Ranges of a device without axes of its own: every direction, each with one pitch and yaw."""

_ROUNDING = 1e-5
"""Rounding of an angle that comes in float32 radians or degrees, rad, and of a rate, relative."""


@dataclass(frozen=True, slots=True)
class Ranges:
    """The ranges of a gimbal.

    Attributes:
        angles: least and largest roll, pitch and yaw relative to the base, rad.
        rate: largest rate of an angle, rad/s.
        capabilities: flags of a gimbal manager.
    """

    angles: Sequence[tuple[float, float]]
    rate: float
    capabilities: int

    @classmethod
    def of_device(cls, options: Mapping[str, Any], rate: float) -> Ranges:
        """Return the ranges of a device.

        Args:
            options: of its driver; a gimbal has ``axes``.
            rate: the device's velocity limit, rad/s.
        """
        if "axes" not in options or {"mount", "tool"} & set(options):
            return cls(_ANY, rate, sum(_OF_AXES.values()) | _EVERY)
        capabilities, ranges = _EVERY, dict.fromkeys("XYZ", (0.0, 0.0))
        for letter, axis in zip(options.get("order", "ZYX"), options["axes"], strict=True):
            capabilities |= _OF_AXES[letter]
            given = axis.get("limits_deg", (-180.0, 180.0))
            if given == "endless":
                capabilities |= _ENDLESS_YAW if letter == "Z" else 0
                given = (-180.0, 180.0)
            low, high = map(math.radians, given)
            ranges[letter] = (low, high) if letter == "X" else (0.0 - high, 0.0 - low)
        return cls(tuple(ranges[letter] for letter in "XYZ"), rate, capabilities)

    def announced(self) -> list[float]:
        """Return the least and largest roll, pitch and yaw, rad."""
        return [end for one in self.angles for end in one]

    def problem(self, wish: Wish, heading: float) -> str:
        """Return why a request is beyond the ranges, in one line; empty if it is within.

        A yaw of at most half a turn may be in another turn than the range.  A yaw from north may be
        any within a whole turn whose direction is in the range.

        Args:
            wish: the request; every number is finite or NaN.
            heading: of the base, rad.
        """
        for name, rate in zip(NAMES, wish.rates, strict=True):
            if abs(rate) > self.rate * (1.0 + _ROUNDING):
                return (
                    f"a {name} rate of {math.degrees(rate):.6g} degrees/s is denied: expected at "
                    f"most {math.degrees(self.rate):.6g}, the velocity limit of the device"
                )
        if wish.flags & (RETRACT | NEUTRAL):
            return ""  # they have angles of their own
        problems = [self._beyond(one, heading) for one in (wish, _tipped(wish))]
        return problems[0] if all(problems) else ""

    def of_sticks(self, message: Any) -> Wish:  # noqa: ANN401 - pymavlink has no types
        """Return the request of sticks, from -1 to 1: a full one asks for an end of a range."""
        widest = (0.5 * math.pi, math.pi)
        angles = [
            stick * most if not abs(stick) <= 1.0 else min(max(stick * most, low), high)
            for stick, most, (low, high) in zip(
                (message.pitch, message.yaw), widest, self.angles[1:], strict=True
            )
        ]
        rates = self.rate * message.pitch_rate, self.rate * message.yaw_rate
        return level(message.flags, (angles[0], angles[1]), rates)

    def _beyond(self, wish: Wish, heading: float) -> str:
        for name, angle, ends in zip(NAMES, wish.angles, self.angles, strict=True):
            is_from_north = name == "yaw" and wish.is_from_north
            is_within = math.isnan(angle) or (not is_from_north and _is_within(angle, ends))
            widest = math.tau if is_from_north else math.pi
            if not is_within and name == "yaw" and abs(angle) <= widest + _ROUNDING:
                past_low = angle - (heading if is_from_north else 0.0) - ends[0] + _ROUNDING
                is_within = _is_within(ends[0] + past_low % math.tau - _ROUNDING, ends)
            if not is_within:
                low, high = map(math.degrees, ends)
                return (
                    f"a {name} of {math.degrees(angle):.6g} degrees"
                    f"{' from north' if is_from_north else ''} is denied: the gimbal announces "
                    f"{low:.6g} to {high:.6g} degrees{' from forward' if is_from_north else ''}"
                )
        return ""


def _is_within(angle: float, ends: tuple[float, float]) -> bool:
    return ends[0] - _ROUNDING <= angle <= ends[1] + _ROUNDING


def _tipped(wish: Wish) -> Wish:
    """Return an attitude with a roll of more than 90 degrees in its other form, or the wish."""
    roll, pitch, yaw = wish.angles
    if not abs(roll) > 0.5 * math.pi or math.isnan(pitch + yaw):
        return wish
    turned = (roll + math.pi, math.pi - pitch, yaw + math.pi)
    return replace(wish, angles=[math.remainder(one, math.tau) for one in turned])
