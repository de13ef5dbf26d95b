"""Which charts there are."""

from itertools import combinations

import pytest
from test_words import DEVICE, changed

from orientd.model.limits import DEFAULT_LIMITS
from orientd.protocol.limits import limits_to_message
from orientd.viewer.charts import COLUMNS, charts_of

BY_AXIS = changed(
    DEVICE, limits=limits_to_message(DEFAULT_LIMITS.with_rates({"velocity": (2.0, 1.0, 3.0)}))
)


def levels(chart):
    return [line["level"] for line in chart["lines"] if line["column"] is None]


def columns(chart):
    return [COLUMNS[line["column"] - 1] for line in chart["lines"] if line["column"] is not None]


@pytest.mark.parametrize("device", [DEVICE, BY_AXIS])
def test_no_two_strips_of_a_chart_look_alike_without_colour(device):
    for chart in charts_of(device, None):
        strips = [line for line in chart["lines"] if line["column"] is not None]
        for one, other in combinations(strips, 2):
            assert one["dashes"] != other["dashes"]


def test_limits_of_the_device_are_drawn():
    velocity, acceleration, *_ = charts_of(DEVICE, None)
    assert levels(velocity) == [DEFAULT_LIMITS.velocity]
    assert levels(acceleration) == [DEFAULT_LIMITS.acceleration]
    assert columns(velocity) == ["velocity", "velocity_measured"]


def test_limits_of_the_body_axes_stand_beside_their_components():
    velocity = charts_of(BY_AXIS, None)[0]
    assert columns(velocity) == ["velocity_x", "velocity_y", "velocity_z"]
    assert levels(velocity) == [2.0, 1.0, 3.0]


def test_lateness_is_in_milliseconds_and_half_a_period_is_marked():
    lateness = charts_of(DEVICE, None)[-1]
    assert lateness["scale"] == 1e3
    assert levels(lateness) == [pytest.approx(1e-3)]
