"""Right ascension and declination, and the horizon of a place.

Angles are in degrees.  Coordinates are those of the date, without refraction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from orientd.errors import RequestError
from orientd.sun import horizontal, sidereal_time
from orientd_serving.pointing import Direction


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
