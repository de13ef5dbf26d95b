"""A satellite and a place that it passes at a time of one's choice, as two-line elements."""

import math
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from reference.sky import EARTH, FLATTENING, MU, in_earth, look, site
from sgp4.api import WGS72, Satrec
from sgp4.exporter import export_tle

NUMBER = 99001
ALTITUDE = 510.0
INCLINATION = 51.6
_EPOCH_1950 = datetime(1949, 12, 31, tzinfo=UTC)
"""Days since then are SGP4's."""


@dataclass(frozen=True)
class DuePass:
    """A pass of a satellite over a place.

    Attributes:
        elements: the two lines.
        place: latitude and longitude, degrees, and height, m.
    """

    elements: tuple[str, str]
    place: tuple[float, float, float]

    def directions(self, times):
        """Return azimuth and elevation, degrees, at times in s since the epoch, shape ``(n,)``."""
        satellite = Satrec.twoline2rv(*self.elements)
        days = satellite.jdsatepoch - 2440587.5 + satellite.jdsatepochF
        return look(satellite, (np.asarray(times) / 86400.0 - days) * 1440.0, site(*self.place[:2]))


def pass_due(peak, *, elevation, heading):
    """Return a pass of a satellite in an orbit of 510 km.

    Args:
        peak: when the satellite is highest, s since the epoch.
        elevation: of its highest point, degrees.
        heading: ``"north"`` if it then goes north-east, and passes west of the place; ``"east"`` if
            it goes east, and passes north of the place.
    """
    along = math.radians({"north": 20.0, "east": 90.0}[heading])
    satellite = Satrec()
    days = (datetime.fromtimestamp(peak, UTC) - _EPOCH_1950).total_seconds() / 86400.0
    satellite.sgp4init(
        WGS72, "i", NUMBER, days, 0.0, 0.0, 0.0, 1e-4, 0.0, math.radians(INCLINATION), along,
        MU / ((EARTH + ALTITUDE) / EARTH) ** 1.5, math.radians(80.0),
    )  # fmt: skip
    elements = export_tle(satellite)
    before, below, after = in_earth(Satrec.twoline2rv(*elements), [-0.1, 0.0, 0.1])
    up, course = below / np.linalg.norm(below), after - before
    right = np.cross(course, up) / np.linalg.norm(np.cross(course, up))
    high = math.radians(elevation)
    aside = math.acos(EARTH * math.cos(high) / np.linalg.norm(below)) - high
    x, y, z = math.cos(aside) * up + math.sin(aside) * right
    latitude = math.atan(z / math.hypot(x, y) / (1.0 - FLATTENING) ** 2)
    return DuePass(elements, (math.degrees(latitude), math.degrees(math.atan2(y, x)), 0.0))
