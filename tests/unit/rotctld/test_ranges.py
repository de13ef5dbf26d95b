"""Directions in the form that is in the ranges of a rotator."""

import random

import numpy as np
import pytest

from orientd_rotctld.pointer import vector
from orientd_rotctld.ranges import Ranges
from orientd_serving.pointing import Direction

FLIPPING = Ranges((-180.0, 540.0), (0.0, 180.0))
PLAIN = Ranges((0.0, 450.0), (0.0, 90.0))
HALF = Ranges((90.0, 270.0), (0.0, 90.0))


@pytest.mark.parametrize("ranges", [FLIPPING, PLAIN])
def test_every_direction_above_the_horizon_has_a_form_in_a_whole_turn(ranges):
    chosen = random.Random(1)
    for _ in range(500):
        asked = Direction(chosen.uniform(-720.0, 720.0), chosen.uniform(0.0, 180.0))
        near = Direction(chosen.uniform(-180.0, 540.0), chosen.uniform(0.0, 90.0))
        found = ranges.form(asked, near)
        assert ranges.problem(found) == ""
        np.testing.assert_allclose(vector(found), vector(asked), atol=1e-12)


def test_of_several_forms_it_is_the_one_near_another_direction():
    assert FLIPPING.form(Direction(10.0, 20.0), Direction(400.0, 0.0)) == Direction(370.0, 20.0)
    assert FLIPPING.form(Direction(10.0, 85.0), Direction(190.0, 90.0)) == Direction(190.0, 95.0)


def test_a_form_outside_is_not_taken_because_it_is_near():
    """A device that has just turned left from 0, 61 to 355, 61, on its way to -120, 0."""
    found = FLIPPING.form(Direction(355.4, 60.8), Direction(-170.0, 118.0))
    assert (found.azimuth, found.elevation) == pytest.approx((-4.6, 60.8))


def test_a_measured_direction_just_beyond_an_end_is_that_end():
    near = Direction(450.0, 10.0)
    assert PLAIN.form(Direction(450.2, 10.0), near, 0.5) == near
    assert PLAIN.form(Direction(450.2, 10.0), near).azimuth == pytest.approx(90.2)
    assert PLAIN.form(Direction(20.0, -0.1), Direction(20.0, 0.0), 0.5) == Direction(20.0, 0.0)


def test_a_direction_without_a_form_in_the_ranges_is_named_as_it_is():
    assert HALF.form(Direction(300.0, 10.0), Direction(270.0, 10.0)) == Direction(300.0, 10.0)
    assert not HALF.has_form(Direction(300.0, 10.0))
    assert HALF.has_form(Direction(-100.0, 10.0))
