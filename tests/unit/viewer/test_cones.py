"""The edges of keep-out cones on the page."""

import math

import numpy as np
import pytest

from orientd.keep_out import KeepOut
from orientd.protocol.cones import cone_message
from orientd.sun import Sun
from orientd.viewer.view import edges

LASER = KeepOut("laser", (0.0, 0.6, 0.8), math.radians(15.0))


def test_an_edge_is_as_far_from_the_direction_as_the_cone_is_wide():
    (drawn,) = edges(cone_message(LASER))
    assert drawn["name"] == "laser"
    cosine = np.array(drawn["edge"]) @ np.array(LASER.direction)
    assert np.degrees(np.arccos(cosine)) == pytest.approx(15.0, abs=0.05)
    assert drawn["middle"] == pytest.approx(LASER.direction)


def test_a_cone_of_device_and_plan_is_drawn_once():
    sun = KeepOut("sun", Sun(48.0, 11.0), 0.2)
    drawn = edges(cone_message(sun), cone_message(LASER), cone_message(sun.frozen(0)))
    assert sorted(one["name"] for one in drawn) == ["laser", "sun"]
    (now,) = [one["middle"] for one in drawn if one["name"] == "sun"]
    assert now != pytest.approx(sun.direction_at(0))
