import json
from pathlib import Path

import numpy as np
import pytest

from orientd import floats
from orientd.servo.path.acceleration_step import find_kink
from orientd.servo.path.path_point import PathPoint
from orientd.servo.path.segment import Segment

GOLDEN = Path(__file__).parents[2] / "data" / "golden"


def point(q, omega, alpha=(0.0, 0.0, 0.0), position=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0)):
    return PathPoint(
        *(tuple(float(c) for c in part) for part in (q, omega, alpha)), position, velocity
    )


@pytest.fixture
def without_kinks(monkeypatch):
    """Segments that know only orientations and velocities."""
    monkeypatch.setattr("orientd.servo.path.segment.find_kink", lambda *records: None)


@pytest.mark.usefixtures("without_kinks")
def test_a_segment_is_the_hermite_curve_of_kim_kim_and_shin():
    case = json.loads((GOLDEN / "kks_hermite_body.json").read_text())
    params = case["params"]
    q0, q1 = (np.array(params[k]) / np.linalg.norm(params[k]) for k in ("q0", "q1"))
    period = params["t1"] - params["t0"]
    segment = Segment(point(q0, params["omega0"]), point(q1, params["omega1"]), period)
    for t, q, omega in zip(case["t"][:-1], case["q"], case["omega"], strict=False):
        found = segment.at((t - params["t0"]) / period)
        assert floats.norm(floats.difference(tuple(q), found.q)) < 1e-14
        np.testing.assert_allclose(found.omega_body, omega, atol=1e-12)


@pytest.mark.usefixtures("without_kinks")
def test_the_velocity_is_the_derivative_of_the_orientation():
    random = np.random.default_rng(2)
    a = floats.exp((0.1, 0.2, -0.3))
    b = floats.multiply(a, floats.exp((0.004, -0.002, 0.001)))
    segment = Segment(point(a, random.normal(size=3)), point(b, random.normal(size=3)), 0.002)
    u, step = 0.37, 1e-4
    turned = floats.difference(segment.at(u - step).q, segment.at(u + step).q)
    velocity = np.array(turned) / (2 * step * 0.002)
    np.testing.assert_allclose(segment.at(u).omega_body, velocity, rtol=1e-6)


def test_a_record_is_returned_untouched():
    start = point((0.6, 0.0, 0.8, 0.0), (1.0, 2.0, 3.0))
    assert Segment(start, start, 0.002).at(0.0) is start


def test_position_follows_a_cubic_with_its_velocities():
    start = point((1, 0, 0, 0), (0, 0, 0), position=(0.0, 1.0, 2.0), velocity=(0.5, 0.0, -0.5))
    end = point((1, 0, 0, 0), (0, 0, 0), position=(0.001, 1.0, 1.999), velocity=(0.5, 0.0, -0.5))
    middle = Segment(start, end, 0.002).at(0.5)
    assert middle.position == pytest.approx((0.0005, 1.0, 1.9995))
    assert middle.velocity == pytest.approx((0.5, 0.0, -0.5))


PERIOD = 0.002


def turn_with_a_step(place, before, behind, jerk=0.0):
    """Return a turn about one axis, a function of the fraction of the period."""
    axis = np.array([0.6, 0.0, -0.8])

    def at(u):
        t, late = u * PERIOD, max(u - place, 0.0) * PERIOD
        alpha = (behind if u > place else before) + jerk * t
        omega = 1.5 + before * t + (behind - before) * late + 0.5 * jerk * t * t
        angle = 1.5 * t + 0.5 * (before * t * t + (behind - before) * late * late)
        angle += jerk * t**3 / 6
        return point(floats.exp(tuple(angle * axis)), omega * axis, alpha * axis)

    return at


@pytest.mark.parametrize("jerk", [0.0, 900.0, -900.0])
@pytest.mark.parametrize("place", [0.02, 0.2, 0.4, 0.49, 0.5, 0.7, 0.95])
def test_a_step_of_the_acceleration_is_met_where_it_is(place, jerk):
    at = turn_with_a_step(place, 4.0, -13.0, jerk)
    segment = Segment(at(0.0), at(1.0), PERIOD)
    for u in np.linspace(0.01, 0.99, 33):
        planned, found = at(float(u)), segment.at(float(u))
        assert floats.norm(floats.difference(planned.q, found.q)) < 1e-13
        np.testing.assert_allclose(planned.omega_body, found.omega_body, atol=1e-10)


@pytest.mark.parametrize("jerk", [200.0, 8500.0])
def test_a_path_that_changes_evenly_has_no_kink(jerk):
    at = turn_with_a_step(1.0, 4.0, 4.0, jerk)
    assert find_kink(at(0.0), at(1.0), PERIOD) is None
