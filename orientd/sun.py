"""The direction of the sun at a place and a time."""

from __future__ import annotations

from math import asin, atan2, cos, radians, sin
from typing import NamedTuple

from orientd.driver import Vector3

NORTH = 0.0
"""Azimuth of true north if nothing else is given, degrees: x points north, y west, z up."""

_EPOCH = 946_728_000
"""Unix time of 2000-01-01 12:00 UTC, s."""


def sidereal_time(time: float, longitude: float) -> float:
    """Return the local mean sidereal time, degrees, of any number of turns.

    UT1 is taken for UTC, which is within 1 s.

    Args:
        time: s since 1970, UTC; an array of NumPy gives an array.
        longitude: degrees, east positive.

    Source: Meeus, Astronomical Algorithms (1998), equation 12.4, without its terms below an arc
    second a century.
    """
    days = (time - _EPOCH) / 86_400.0
    return 280.460_618_37 + 360.985_647_366_29 * days + longitude


def horizontal(hour_angle: float, declination: float, latitude: float) -> Vector3:
    """Return where a point of the sky stands: its parts to the east, to the north and up.

    Args:
        hour_angle: how far the point is west of the meridian, rad.
        declination: rad.
        latitude: of the place, rad.
    """
    east = -cos(declination) * sin(hour_angle)
    along = cos(declination) * cos(hour_angle)
    north = sin(declination) * cos(latitude) - along * sin(latitude)
    return east, north, sin(declination) * sin(latitude) + along * cos(latitude)


class Sun(NamedTuple):
    """The sun as seen from a place on the earth.

    Attributes:
        latitude: degrees, north positive.
        longitude: degrees, east positive.
        north: azimuth of true north in the device's base frame, degrees.
    """

    latitude: float
    longitude: float
    north: float = NORTH

    def direction(self, unix_ns: int) -> Vector3:
        """Return the unit vector towards the sun's centre in the base frame, whose z is up.

        The apparent direction without refraction and parallax, within 0.02 degrees from 1950 to
        2050.  Refraction lifts the sun by up to 0.6 degrees at the horizon.  The radius of its
        disc is 0.27 degrees.

        Args:
            unix_ns: time, ns since 1970-01-01 UTC.

        Source: Astronomical Almanac, section C, low precision formulas for the sun's coordinates
        (0.01 degrees).
        """
        days = (unix_ns * 1e-9 - _EPOCH) / 86_400.0
        anomaly = radians(357.528 + 0.985_600_3 * days)
        longitude = radians(
            280.460 + 0.985_647_4 * days + 1.915 * sin(anomaly) + 0.020 * sin(2.0 * anomaly)
        )
        obliquity = radians(23.439 - 0.000_000_4 * days)
        ascension = atan2(cos(obliquity) * sin(longitude), cos(longitude))
        declination = asin(sin(obliquity) * sin(longitude))
        hour = radians(sidereal_time(unix_ns * 1e-9, self.longitude)) - ascension
        east, north, up = horizontal(hour, declination, radians(self.latitude))
        turn = radians(self.north)
        return (
            north * cos(turn) + east * sin(turn),
            north * sin(turn) - east * cos(turn),
            up,
        )
