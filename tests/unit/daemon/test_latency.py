"""The delay between setpoints and measurements is found, between two steps too."""

import math

import pytest

from orientd.daemon.calls.latency_identification import identify
from orientd.floats import exp


def sway(t):
    return exp((0.2 * math.sin(t), 0.3 * (1 - math.cos(1.3 * t)), -0.1 * math.sin(0.7 * t)))


@pytest.mark.parametrize("delay", [0.0, 0.0137, 0.1, 0.1031])
def test_delay_is_found(delay):
    times = [0.002 * k for k in range(1500)]
    found = identify(
        [(t, sway(t)) for t in times],
        [(t, sway(t - delay) if t > delay else sway(0.0)) for t in times[::2]],
    )
    assert found.seconds == pytest.approx(delay, abs=2e-4)
    assert found.error_led <= found.error
    if delay > 0.05:
        assert found.error > 20 * found.error_led


def test_motion_that_does_not_turn_tells_nothing():
    still = [(0.002 * k, exp((0.0, 0.0, 1e-4))) for k in range(10)]
    with pytest.raises(ValueError, match=r"turn by 0\.01 rad"):
        identify(still, still)
