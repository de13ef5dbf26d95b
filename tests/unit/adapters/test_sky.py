"""Where satellites are seen, against an independent computation."""

import math

import numpy as np
import pytest

from orientd.adapters import from_elements

ELEMENTS = """0 VANGUARD 1
1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753
2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667
"""
"""The first case of "Revisiting Spacetrack Report #3" (Vallado et al. 2006)."""


def test_a_satellite_is_seen_where_its_place_in_space_says(tmp_path):
    """Vallado's TEME position 360 minutes after the epoch, turned by hand into a direction."""
    pytest.importorskip("sgp4")
    file = tmp_path / "one.tle"
    file.write_text(ELEMENTS)
    (target,) = from_elements(file, (0.0, 0.0, 0.0))
    assert target.name == "VANGUARD 1"
    days = 179.78495062 + 360.0 / 1440.0
    since_1970 = (10957.0 + days - 1.0) * 86400.0
    place = np.array([-7154.03120202, -3783.17682504, -3536.19412294])  # km, of that report
    julian = 2451544.5 + days - 1.0
    # The Earth Rotation Angle, and the precession of the equinox since 2000 in right ascension.
    angle = 2.0 * math.pi * (0.7790572732640 + 1.00273781191135448 * (julian - 2451545.0))
    angle += math.radians((0.014506 + 4612.156534 * (julian - 2451545.0) / 36525.0) / 3600.0)
    x = place[0] * math.cos(angle) + place[1] * math.sin(angle)
    y = place[1] * math.cos(angle) - place[0] * math.sin(angle)
    seen = np.array([place[2], -y, x - 6378.137])  # from 0 north, 0 east: north, west, up
    (found,) = target.at(np.array([since_1970]))
    assert found == pytest.approx(seen / np.linalg.norm(seen), abs=2e-5)
