import json
from pathlib import Path

import numpy as np
import pytest

from orientd.driver import floats
from orientd.servo.segment import PathPoint, Segment

GOLDEN = Path(__file__).parents[2] / "data" / "golden"


def point(q, omega, alpha=(0.0, 0.0, 0.0), position=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0)):
    return PathPoint(
        *(tuple(float(c) for c in part) for part in (q, omega, alpha)), position, velocity
    )


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
