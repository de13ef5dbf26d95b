"""Cones that the tool's axis stays out of, and the direction of the sun."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from orientd.keep_out import FASTEST_SUN, KeepOut
from orientd.rotation import exp
from orientd.sun import Sun

SUN = json.loads((Path(__file__).parents[1] / "data" / "sun" / "sun.json").read_text())


def separation(a, b):
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(np.dot(a, b)))


def test_the_sun_is_where_astropy_has_it_within_a_fiftieth_of_a_degree():
    for second, latitude, longitude, azimuth, elevation in SUN["rows"]:
        a, e = math.radians(azimuth), math.radians(elevation)
        # x east, y north, z up
        there = (math.sin(a) * math.cos(e), math.cos(a) * math.cos(e), math.sin(e))
        found = Sun(latitude, longitude).direction(second * 1_000_000_000)
        assert math.hypot(*found) == pytest.approx(1.0, abs=1e-12)
        assert math.degrees(separation(found, there)) < 0.02


def test_north_turns_the_direction_of_the_sun():
    time = 1_700_000_000_000_000_000
    east, north, up = Sun(48.0, 11.0).direction(time)
    x, y, z = Sun(48.0, 11.0, north=0.0).direction(time)
    assert (x, y, z) == pytest.approx((north, -east, up), abs=1e-12)


def test_the_bound_of_the_suns_motion_holds_all_year():
    sun = Sun(10.0, 20.0)
    for day in range(0, 366, 5):
        time = (1_750_000_000 + 86_400 * day) * 1_000_000_000
        ahead = separation(sun.direction(time), sun.direction(time + 3_600_000_000_000))
        assert ahead <= 3600.0 * FASTEST_SUN


def test_clearance_is_the_angle_beyond_the_edge():
    cone = KeepOut("laser", (0.0, 0.0, 1.0), half_angle=math.radians(10.0))
    up = tuple(exp([0.0, -math.pi / 2, 0.0]).tolist())
    assert cone.clearance((1.0, 0.0, 0.0, 0.0), 0) == pytest.approx(math.radians(80.0))
    assert cone.clearance(up, 0) == pytest.approx(math.radians(-10.0))


def test_a_cone_of_another_axis_of_the_tool():
    cone = KeepOut("mast", (0.0, 0.0, 1.0), half_angle=0.1, axis=(0.0, 0.0, 1.0))
    assert cone.clearance((1.0, 0.0, 0.0, 0.0), 0) == pytest.approx(-0.1)
    turned = tuple(exp([0.3, 0.0, 0.0]).tolist())
    assert cone.clearance(turned, 0) == pytest.approx(0.2)
