"""Directions of antenna and telescope programs: orientations of a tool, points of the sky.

Azimuth counts clockwise from north, seen from above, and elevation up from the horizon, both in
degrees.  The world has z up.  The x axis of the tool points, and its y axis stays level.

Unit vectors of directions have x to the north, y to the west and z up.  Right ascension and
declination are those of the date, without refraction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from orientd.driver import Quaternion
from orientd.errors import RequestError
from orientd.floats import exp, multiply, rotate
from orientd.rotation import Floats
from orientd.sun import horizontal, sidereal_time

_LEVEL = 0.02
"""Largest rise of the tool's y axis at which it gives the azimuth, sine of the angle."""


@dataclass(frozen=True, slots=True)
class Direction:
    """A direction as programs name it.

    Attributes:
        azimuth: degrees clockwise from north, of any number of turns.
        elevation: degrees above the horizon; above 90 the tool has tipped over.
    """

    azimuth: float
    elevation: float

    def tipped(self) -> Direction:
        """Return the same direction of a tool that has tipped over."""
        return Direction(self.azimuth + 180.0, 180.0 - self.elevation)


def vectors(azimuth: ArrayLike, elevation: ArrayLike) -> Floats:
    """Return the unit vectors of directions, degrees, shape ``(..., 3)``."""
    east, up = np.radians(azimuth), np.radians(elevation)
    parts = np.cos(up) * np.cos(east), -np.cos(up) * np.sin(east), np.sin(up)
    points: Floats = np.stack(parts, axis=-1)
    return points


def angles(points: ArrayLike) -> Floats:
    """Return azimuth, from -180 to 180, and elevation of vectors, degrees, shape ``(..., 2)``."""
    x, y, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
    found: Floats = np.stack([np.arctan2(-y, x), np.arctan2(z, np.hypot(x, y))], axis=-1)
    return np.degrees(found)


def orientation(direction: Direction, north: float = 0.0) -> Quaternion:
    """Return the orientation ``(w, x, y, z)`` of a level tool that points in a direction.

    Args:
        direction: where to.
        north: angle of north from the world's x axis, counted towards y, degrees.

    >>> orientation(Direction(0.0, 0.0))
    (1.0, 0.0, 0.0, 0.0)
    """
    azimuth, elevation = math.radians(north - direction.azimuth), math.radians(direction.elevation)
    # A turn about z, then one about the new y, by minus the elevation.
    return multiply(exp((0.0, 0.0, azimuth)), exp((0.0, -elevation, 0.0)))


def direction(q: Quaternion, north: float = 0.0) -> Direction:
    """Return the direction of a tool, with an azimuth of 0 to 360 degrees.

    A level tool has an azimuth at the zenith too, and an elevation above 90 if it has tipped over.

    >>> zenith = direction(orientation(Direction(90.0, 90.0), 30.0), 30.0)
    >>> round(zenith.azimuth, 9), round(zenith.elevation, 9)
    (90.0, 90.0)
    """
    ahead, side = rotate(q, (1.0, 0.0, 0.0)), rotate(q, (0.0, 1.0, 0.0))
    level = math.hypot(ahead[0], ahead[1])
    if abs(side[2]) < _LEVEL:
        heading = math.atan2(-side[0], side[1])
        level = ahead[0] * math.cos(heading) + ahead[1] * math.sin(heading)
    else:
        heading = math.atan2(ahead[1], ahead[0])
    azimuth = (north - math.degrees(heading)) % 360.0
    return Direction(azimuth, math.degrees(math.atan2(ahead[2], level)))


class Equatorial(NamedTuple):
    """A point of the sky: right ascension in hours, declination in degrees."""

    right_ascension: float
    declination: float


class Place(NamedTuple):
    """A place on the earth: degrees north, degrees east, and m above the sea."""

    latitude: float
    longitude: float
    elevation: float = 0.0

    def sidereal_time(self, time: float) -> float:
        """Return the local sidereal time, hours.

        Args:
            time: s since 1970, UTC.
        """
        return (sidereal_time(time, self.longitude) % 360.0) / 15.0

    def direction(self, target: Equatorial, time: float) -> Direction:
        """Return where a point of the sky stands at a time.

        >>> north_pole = Place(50.0, 8.0).direction(Equatorial(3.0, 90.0), 0.0)
        >>> round(math.remainder(north_pole.azimuth, 360.0), 6), round(north_pole.elevation, 6)
        (0.0, 50.0)
        """
        hour = math.radians(15.0 * (self.sidereal_time(time) - target.right_ascension))
        azimuth, elevation = _turned(hour, math.radians(target.declination), self.latitude)
        return Direction(math.degrees(azimuth) % 360.0 % 360.0, math.degrees(elevation))

    def equatorial(self, direction: Direction, time: float) -> Equatorial:
        """Return the point of the sky that stands in a direction at a time.

        >>> place = Place(50.0, 8.0)
        >>> there = place.equatorial(place.direction(Equatorial(3.0, 20.0), 1e9), 1e9)
        >>> round(there.right_ascension, 9), round(there.declination, 9)
        (3.0, 20.0)
        """
        hour, declination = _turned(
            math.radians(direction.azimuth), math.radians(direction.elevation), self.latitude
        )
        hours = self.sidereal_time(time) - math.degrees(hour) / 15.0
        return Equatorial(hours % 24.0 % 24.0, math.degrees(declination))


def _turned(around: float, up: float, latitude: float) -> tuple[float, float]:
    """Return hour angle and declination as azimuth and elevation, or the other way round, rad.

    Both directions have one formula, since they exchange the pole and the zenith.
    """
    east, north, rise = horizontal(around, up, math.radians(latitude))
    return math.atan2(east, north), math.atan2(rise, math.hypot(east, north))


def observer_of(text: str) -> tuple[float, float, float]:
    """Return latitude, longitude and height from ``LAT,LON[,M]``.

    Raises:
        RequestError: the text is not of that form.

    >>> observer_of("52.5,13.4")
    (52.5, 13.4, 0.0)
    """
    try:
        latitude, longitude, *height = map(float, text.split(","))
        metres = height[0] if height else 0.0
        is_place = abs(latitude) <= 90.0 and abs(longitude) <= 360.0 and abs(metres) < 1e5
    except ValueError:
        is_place = False
    if not is_place or len(height) > 1:
        raise RequestError("observer", f"expected LAT,LON or LAT,LON,METRES, got {text!r}")
    return latitude, longitude, metres
