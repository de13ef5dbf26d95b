import numpy as np
import pytest

from orientd import floats
from orientd.planner.recorded import states_between
from orientd.servo.path.segment import PathPoint, Segment, law_between

PERIOD = 0.002


def point(q, omega, alpha=(0.0, 0.0, 0.0), position=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0)):
    return PathPoint(
        *(tuple(float(c) for c in part) for part in (q, omega, alpha)), position, velocity
    )


def turning_points(random, size):
    """Return two points of records between which the rates change as they like."""
    q = floats.exp(tuple(random.normal(size=3)))
    turn = tuple(size * x for x in random.normal(size=3))
    rates = [tuple(size / PERIOD * (turn + 0.2 * random.normal(size=3))) for _ in range(2)]
    pushes = [tuple(0.1 * size / PERIOD**2 * random.normal(size=3)) for _ in range(2)]
    places = [tuple(0.1 * random.normal(size=3)) for _ in range(4)]
    start = point(q, rates[0], pushes[0], places[0], places[1])
    end = point(floats.multiply(q, floats.exp(turn)), rates[1], pushes[1], places[2], places[3])
    return start, end


@pytest.mark.parametrize("size", [1e-4, 0.01, 0.1])
def test_the_servo_and_the_planner_have_one_law(size):
    random = np.random.default_rng(1)
    pairs = [turning_points(random, size) for _ in range(500)]
    here, there = (
        np.array([np.concatenate(pair[k]) for pair in pairs], dtype=np.float64) for k in (0, 1)
    )
    shares = random.uniform(size=len(pairs))
    # Of a rate as of the angle or the length that it comes from.
    scale = np.maximum(1.0, np.abs(there).max(axis=0))
    scale[4:7] = np.maximum(scale[4:7], 1.0 / PERIOD)
    scale[13:] = np.maximum(scale[13:], 1.0 / PERIOD)
    steps = 0
    for pair, share, state in zip(
        pairs, shares, states_between(here, there, PERIOD, shares), strict=True
    ):
        found = np.concatenate(Segment(*pair, PERIOD).at(float(share)))
        assert np.max(np.abs(found[:4] - state[:4])) <= 1e-15
        assert np.max(np.abs(found - state) / scale) <= 2e-15
        steps += law_between(*pair, PERIOD).step != (0.0, 0.0, 0.0)
    assert steps > 50


@pytest.mark.parametrize("size", [0.001, 0.05, 0.4])
def test_the_velocity_is_the_derivative_of_the_orientation(size):
    random = np.random.default_rng(2)
    for _ in range(20):
        segment = Segment(*turning_points(random, size), PERIOD)
        u, step = float(random.uniform(0.1, 0.9)), 1e-5
        turned = floats.difference(segment.at(u - step).q, segment.at(u + step).q)
        velocity = np.array(turned) / (2 * step * PERIOD)
        np.testing.assert_allclose(segment.at(u).omega_body, velocity, atol=1e-4 * size / PERIOD)


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


def turning_with_a_step(random):
    """Return two records of a turn whose acceleration steps at one of them or between them."""
    axis = random.normal(size=3)
    axis /= np.linalg.norm(axis)
    place = random.choice([0.0, 1.0, random.uniform()])
    rate, before, jerk = (
        random.choice([0.0, random.uniform(-size, size)]) for size in (3.0, 20.0, 9000.0)
    )
    step = random.uniform(-40.0, 40.0)
    first = floats.exp(tuple(random.normal(size=3)))

    def record(time, alpha):
        late = max(time - place * PERIOD, 0.0)
        angle = rate * time + 0.5 * (before * time**2 + step * late**2) + jerk * time**3 / 6.0
        omega = rate + before * time + step * late + 0.5 * jerk * time**2
        q = floats.multiply(first, floats.exp(tuple(angle * axis)))
        return point(q, omega * axis, (alpha + jerk * time) * axis)

    return record(0.0, before), record(PERIOD, before + step)


@pytest.mark.parametrize(
    "pairs", [2000, pytest.param(1_000_000, marks=[pytest.mark.slow, pytest.mark.timeout(3600)])]
)
def test_a_step_at_a_record_is_no_matter_of_rounding(pairs):
    random = np.random.default_rng(5)
    records = [turning_with_a_step(random) for _ in range(pairs)]
    here, there = (np.array([np.concatenate(pair[k]) for pair in records]) for k in (0, 1))
    shares = random.uniform(size=pairs)
    for pair, share, state in zip(
        records, shares, states_between(here, there, PERIOD, shares), strict=True
    ):
        found = np.concatenate(Segment(*pair, PERIOD).at(float(share)))
        assert np.max(np.abs(found[:4] - state[:4])) <= 1e-15
        np.testing.assert_allclose(found[4:7], state[4:7], atol=1e-12)
