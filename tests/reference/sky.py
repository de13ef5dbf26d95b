"""Passes of satellites from elements of our own, seen from sites about the world.

The elements are of low orbits.  A third of the passes come within a degree of the zenith, a third
cross north, the rest are as they come.
"""

import math
from dataclasses import dataclass

import numpy as np
from sgp4.api import WGS72, Satrec

EARTH, FLATTENING = 6378.137, 1.0 / 298.257223563
MU = 0.0743669161  # sqrt(GM) in earth radii and minutes
SITES = [(52, 13), (47, 8), (35, 139), (-34, 151), (60, 25), (0.5, 36), (70, 20), (-23, -46)]
INCLINATIONS = [51.6, 66.0, 74.0, 86.4, 97.8, 98.6]
LEAST_ELEVATION = 5.0


@dataclass
class Pass:
    """A pass above the least elevation.

    Attributes:
        times: whole seconds from its beginning, shape ``(n,)``.
        azimuth: degrees from north towards east, unwrapped.
        elevation: degrees.
    """

    times: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray


def site(latitude, longitude):
    """Return a place, km, and north, east and up there, in coordinates fixed to the earth."""
    la, lo = math.radians(latitude), math.radians(longitude)
    radius = EARTH / math.sqrt(1 - (2 * FLATTENING - FLATTENING**2) * math.sin(la) ** 2)
    up = np.array([math.cos(la) * math.cos(lo), math.cos(la) * math.sin(lo), math.sin(la)])
    east = np.array([-math.sin(lo), math.cos(lo), 0.0])
    place = radius * up * [1.0, 1.0, (1 - FLATTENING) ** 2]
    return place, np.stack([np.cross(up, east), east, up])


def in_earth(satellite, minutes):
    """Return positions fixed to the earth, km, at minutes from the epoch, shape ``(n, 3)``."""
    day = satellite.jdsatepoch + satellite.jdsatepochF + np.asarray(minutes) / 1440.0
    _, place, _ = satellite.sgp4_array(np.floor(day), day - np.floor(day))
    turn = sidereal(day)
    x, y, z = place.T
    cos, sin = np.cos(turn), np.sin(turn)
    return np.stack([cos * x + sin * y, cos * y - sin * x, z], axis=1)


def sidereal(day):
    """Return the sidereal time of Greenwich at a Julian day, rad."""
    return np.radians((280.46061837 + 360.98564736629 * (day - 2451545.0)) % 360.0)


def look(satellite, minutes, seen_from):
    """Return azimuth and elevation, degrees."""
    place, axes = seen_from
    north, east, up = ((in_earth(satellite, minutes) - place) @ axes.T).T
    return (
        np.degrees(np.arctan2(east, north)) % 360.0,
        np.degrees(np.arctan2(up, np.hypot(north, east))),
    )


def below(satellite, minute, rng):
    """Return latitude and longitude within about half a degree of the point under a satellite."""
    ((x, y, z),) = in_earth(satellite, [minute])
    latitude = math.atan(z / math.hypot(x, y) / (1 - FLATTENING) ** 2)
    aside = rng.uniform(-0.08, 0.08, 2)
    return math.degrees(latitude) + aside[0], math.degrees(math.atan2(y, x)) + aside[1]


def passes(count, seed=1):
    """Return *count* passes."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        one = _pass(rng, ("zenith", "north", "any")[len(found) % 3])
        if one is not None:
            found.append(one)
    return found


def _pass(rng, kind):
    observer = SITES[rng.integers(len(SITES))]
    altitude, inclination = rng.uniform(400.0, 900.0), float(rng.choice(INCLINATIONS))
    satellite = Satrec()
    motion = MU / ((EARTH + altitude) / EARTH) ** 1.5
    raan, anomaly = np.radians(rng.uniform(0.0, 360.0, 2))
    satellite.sgp4init(WGS72, "i", 1, 27700.0, 1e-5, 0.0, 0.0, 0.001, 0.0,
                       math.radians(inclination), anomaly, motion, raan)  # fmt: skip
    minutes = np.arange(0.0, 5760.0, 0.5)
    _, height = look(satellite, minutes, site(*observer))
    peaks = np.flatnonzero((height[1:-1] > height[:-2]) & (height[1:-1] >= height[2:])) + 1
    for peak in minutes[peaks[height[peaks] > 20.0]]:
        if kind == "zenith":
            observer = below(satellite, peak, rng)
        fine = peak + np.arange(-720, 721) / 60.0
        azimuth, height = look(satellite, fine, site(*observer))
        is_up = height >= LEAST_ELEVATION
        if not is_up[720]:
            continue
        first = 720 - int(np.argmin(is_up[720::-1]))
        last = 720 + int(np.argmin(is_up[720:]))
        part = slice(first + 1, last)
        crosses = bool(np.any(np.abs(np.diff(azimuth[part])) > 180.0))
        is_meant = {"zenith": height.max() > 89.0, "north": crosses, "any": True}[kind]
        if is_meant and last - first > 200:
            turned = np.degrees(np.unwrap(np.radians(azimuth[part])))
            times = np.arange(last - first - 1.0)
            return Pass(times, turned, height[part])
    return None
