"""Cones that the tool's axis stays out of, and the direction of the sun."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from orientd.config import DeviceSettings
from orientd.errors import RequestError
from orientd.keep_out import KeepOut
from orientd.keep_out.cone import FASTEST_SUN
from orientd.model.cones import read_cones
from orientd.model.request import Keyframe
from orientd.rotation import exp
from orientd.sun import Sun

SUN = json.loads((Path(__file__).parents[2] / "data" / "sun" / "sun.json").read_text())


def separation(a, b):
    return math.atan2(float(np.linalg.norm(np.cross(a, b))), float(np.dot(a, b)))


def test_the_sun_is_where_astropy_has_it_within_a_fiftieth_of_a_degree():
    for second, latitude, longitude, azimuth, elevation in SUN["rows"]:
        a, e = math.radians(azimuth), math.radians(elevation)
        # x north, y west, z up, as for passes and antenna programs
        there = (math.cos(a) * math.cos(e), -math.sin(a) * math.cos(e), math.sin(e))
        found = Sun(latitude, longitude).direction(second * 1_000_000_000)
        assert math.hypot(*found) == pytest.approx(1.0, abs=1e-12)
        assert math.degrees(separation(found, there)) < 0.02


def test_north_turns_the_direction_of_the_sun():
    time = 1_700_000_000_000_000_000
    north, west, up = Sun(48.0, 11.0).direction(time)
    # x points east
    x, y, z = Sun(48.0, 11.0, north=90.0).direction(time)
    assert (x, y, z) == pytest.approx((-west, north, up), abs=1e-12)


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


CONE = {"name": "laser", "direction": [0, 0, 2], "half_angle_deg": 10.0}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"name": "two words"}, "[0].name: expected a letter"),
        ({"half_angle_deg": 95}, "[0].half_angle_deg: expected above 0, at most 90, got 95"),
        ({"margin_deg": 85}, "[0].margin_deg: expected from 0 to 80"),
        ({"direction": [0, 0, 0]}, "[0].direction: expected a direction"),
        ({"sun": {"latitude": 1, "longitude": 2}}, "got direction and sun"),
        ({"axis": "w"}, "[0].axis: expected x, y, z or a vector"),
        ({"half_angel_deg": 3}, "did you mean 'half_angle_deg'?"),
    ],
)
def test_a_malformed_cone_is_refused_by_its_key(change, says):
    with pytest.raises(RequestError) as refused:
        read_cones([CONE | change])
    assert says in str(refused.value)


def test_at_most_eight_cones_each_with_its_own_name():
    with pytest.raises(RequestError, match=r"\[1\].name: 'laser' is the name of keep_out\[0\] too"):
        read_cones([CONE, CONE])
    with pytest.raises(RequestError, match="expected at most 8, got 9"):
        read_cones([CONE | {"name": f"c{number}"} for number in range(9)])


def test_azimuth_and_elevation_point_as_those_of_a_keyframe():
    (cone,) = read_cones(
        [{"name": "a", "azimuth_elevation": {"azimuth": 90, "elevation": 30}, "half_angle_deg": 5}]
    )
    assert cone.direction == pytest.approx((0.0, math.cos(math.pi / 6), 0.5))
    pointing = Keyframe(azimuth_elevation={"azimuth": 90.0, "elevation": 30.0}).q
    assert cone.clearance(pointing, 0) == pytest.approx(-cone.half_angle, abs=1e-9)


def test_a_device_has_its_cones_in_its_configuration():
    settings = DeviceSettings(name="head", driver="loopback", keep_out=[CONE])
    assert settings.to_keep_out() == read_cones([CONE])
    with pytest.raises(ValueError, match=r"keep_out\[0\].half_angle_deg"):
        DeviceSettings(name="head", driver="loopback", keep_out=[CONE | {"half_angle_deg": -1}])
