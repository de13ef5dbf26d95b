"""The ranges of azimuth and elevation that a server announces, and keeps."""

from __future__ import annotations

import math
from dataclasses import dataclass

from orientd_serving.pointing import Direction

SLACK = 0.5
"""Degrees by which a measured direction may be beyond a range and count as its end."""


@dataclass(frozen=True, slots=True)
class Ranges:
    """The directions that a client may ask for.

    Attributes:
        azimuth: the least and the largest, degrees.
        elevation: the least and the largest, degrees.
        north: angle of north from the world's x axis, counted towards y, degrees.
    """

    azimuth: tuple[float, float]
    elevation: tuple[float, float]
    north: float = 0.0

    @property
    def tips(self) -> bool:
        """Whether flip mode is allowed: elevations above 90 degrees."""
        return self.elevation[1] > 90.0

    def nearest(self, wanted: Direction) -> Direction:
        """Return the direction in the ranges that is nearest to *wanted*."""
        return Direction(
            min(max(wanted.azimuth, self.azimuth[0]), self.azimuth[1]),
            min(max(wanted.elevation, self.elevation[0]), self.elevation[1]),
        )

    def narrowed(self, margin: float) -> Ranges:
        """Return the ranges without what is within *margin* degrees of their ends."""
        (west, east), (low, high) = self.azimuth, self.elevation
        azimuth, elevation = (west + margin, east - margin), (low + margin, high - margin)
        return Ranges(azimuth, elevation, self.north)

    def problem(self, wanted: Direction) -> str:
        """Return which angle of a direction is beyond its range; empty if none is."""
        for name, angle, option in (
            ("azimuth", wanted.azimuth, self.azimuth),
            ("elevation", wanted.elevation, self.elevation),
        ):
            if not option[0] <= angle <= option[1]:
                return (
                    f"expected an {name} from {option[0]:g} to {option[1]:g} degrees, got "
                    f"{angle:.10g}; --{name} sets the range"
                )
        return ""

    def form(self, wanted: Direction, near: Direction, slack: float = 0.0) -> Direction:
        """Return a direction in the form that is in the ranges: its turn, and tipped over or not.

        Of several forms it is the one that is closest to *near*.  If no form is in the ranges, it
        is the one that is least beyond them.

        Args:
            wanted: the direction.
            near: another one, in the ranges.
            slack: how far beyond the ranges a form counts as their end, degrees.

        >>> Ranges((-180.0, 540.0), (0.0, 180.0)).form(
        ...     Direction(355.0, 61.0), near=Direction(-120.0, 0.0)
        ... )
        Direction(azimuth=-5.0, elevation=61.0)
        """

        def beyond(form: Direction) -> float:
            apart = _apart(form, self.nearest(form))
            return 0.0 if apart <= slack else apart

        forms = []
        for one in (wanted, wanted.tipped()):
            azimuth, elevation = one.azimuth % 360.0, math.remainder(one.elevation, 360.0)
            first = math.floor((self.azimuth[0] - azimuth) / 360.0)
            last = math.ceil((self.azimuth[1] - azimuth) / 360.0)
            forms += [
                Direction(azimuth + 360.0 * turn, elevation) for turn in range(first, last + 1)
            ]
        found = min(forms, key=lambda form: (beyond(form), _apart(form, near)))
        return found if beyond(found) else self.nearest(found)

    def has_form(self, wanted: Direction) -> bool:
        """Return whether a direction is in the ranges in some form, or almost."""
        found = self.form(wanted, wanted, SLACK)
        return self.nearest(found) == found


def _apart(one: Direction, other: Direction) -> float:
    return math.hypot(one.azimuth - other.azimuth, one.elevation - other.elevation)
