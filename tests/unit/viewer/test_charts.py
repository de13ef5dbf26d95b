"""Which charts there are."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from test_words import DEVICE

pytest.importorskip("viser")

from orientd.planner import DEFAULT_LIMITS
from orientd.viewer.charts import charts_of
from orientd.viewer.strips import COUNT, NAMES

STRIPS = {name: np.full(COUNT, 0.5) for name in NAMES}
TIMES = np.linspace(-10.0, 0.0, COUNT)
BY_AXIS = replace(DEVICE, limits=DEFAULT_LIMITS.with_rates({"velocity": (2.0, 1.0, 3.0)}))


@pytest.mark.parametrize("device", [DEVICE, BY_AXIS])
def test_no_two_strips_of_a_chart_look_alike_without_colour(device):
    for chart in charts_of(device):
        for one, other in combinations([line for line in chart.lines if line.strip], 2):
            assert one.dashes != other.dashes
        assert all(line.label in chart.heading for line in chart.lines)


def test_limits_of_the_device_are_drawn():
    velocity, acceleration, *_ = charts_of(DEVICE)
    assert velocity.data(TIMES, STRIPS, {})[-1][0] == DEFAULT_LIMITS.velocity
    assert acceleration.data(TIMES, STRIPS, {})[-1][0] == DEFAULT_LIMITS.acceleration


def test_a_motion_with_a_narrower_limit_is_drawn_against_that():
    velocity = charts_of(DEVICE)[0]
    assert velocity.data(TIMES, STRIPS, {"velocity": 0.4})[-1][0] == 0.4


def test_limits_of_the_body_axes_stand_beside_their_components():
    velocity = charts_of(BY_AXIS)[0]
    strips = [line.strip for line in velocity.lines if line.strip]
    assert strips == ["velocity_x", "velocity_y", "velocity_z"]
    levels = [line.level for line in velocity.lines if not line.strip]
    assert levels == [2.0, 1.0, 3.0]


def test_lateness_is_in_milliseconds_and_half_a_period_is_marked():
    _, lateness, half = charts_of(DEVICE)[-1].data(TIMES, STRIPS, {})
    assert lateness[0] == pytest.approx(500.0)
    assert half[0] == pytest.approx(1.0)
