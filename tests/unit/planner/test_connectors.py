"""Joins and connectors against plain NumPy, and the laws that they keep."""

import numpy as np
import pytest
from reference import connectors, joins

from orientd import kernels
from orientd.planner import DEFAULT_LIMITS, Keyframe, Limits, MotionRequest, State, plan
from orientd.planner.certify.measuring import limit_table
from orientd.planner.connect.connector import connector, state_row, try_joins
from orientd.planner.connect.connector import joins as trajectory_of_joins
from orientd.planner.timing.axis_turn import double_s
from orientd.rotation import angle, exp, multiply, normalize

PERIOD = 0.002
FAR = 100.0  # rad, that a connector may turn
LONGEST = 86_400.0  # s
MOST_JOINS = 36
UNLIMITED = Limits.partial()
LIMITS = [DEFAULT_LIMITS, DEFAULT_LIMITS.with_rates({"velocity": [2.0, 0.7, 1.5], "jerk": 300.0})]


def random_state(rng, speed):
    return State(
        normalize(rng.normal(size=4)), speed * rng.normal(size=3), 4.0 * speed * rng.normal(size=3),
        np.zeros(3),
    )  # fmt: skip


def nearby(rng, state, speed):
    other = random_state(rng, speed)
    q = normalize(state.q + 1e-3 * rng.normal(size=4))
    return State(q, other.omega_body, other.alpha_body, other.position)


def joined(start, end, limits, period, least=0.0, *, as_found=False):
    """Return what the kernel finds, as the parts of the search in NumPy that take time."""
    found = np.empty((MOST_JOINS, 4)), np.empty((MOST_JOINS, 5, 3)), np.empty(MOST_JOINS + 1)
    tables = limit_table(limits.with_reserve()), limit_table(UNLIMITED)
    states = state_row(start), state_row(end)
    count = kernels.connect(
        *states, *tables, period, least, LONGEST, FAR, 1.0, as_found, False, *found
    )  # fmt: skip
    q, w, times = found
    return connectors.Way(q[:count], w[:count], times[: count + 1]) if count else None


def curve_of(way):
    return trajectory_of_joins(*way)


@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("speed", [0.0, 0.1, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("draws", [20, pytest.param(60, marks=pytest.mark.slow)])
def test_the_connectors_found_are_those_of_numpy(limits, speed, draws):
    rng = np.random.default_rng(11)
    count = 0
    for k in range(draws):
        start = random_state(rng, speed)
        slower = speed * rng.choice([0.0, 0.5, 1.0])
        end = nearby(rng, start, slower) if k % 7 == 0 else random_state(rng, slower)
        work = (start, end, limits, rng.choice([0.002, 0.008, 0.02]), rng.choice([0.0, 0.0, 3.0]))
        reference, found = connectors.search(*work), joined(*work, as_found=True)
        assert (found is None) == (reference is None)
        if found is not None:
            count += 1
            takes_time = np.diff(reference.times) > 0.0
            breaks = np.append(reference.times[:-1][takes_time], reference.times[-1])
            assert np.abs(found.times - breaks).max() <= 1e-12
            assert np.abs(found.q - reference.q[takes_time]).max() <= 1e-12
            assert np.abs(found.w - reference.w[takes_time]).max() <= 1e-12
    assert count >= 0.75 * draws


@pytest.mark.parametrize("speed", [0.0, 0.3, 1.0])
def test_a_connector_is_one_smooth_curve_from_state_to_state(speed):
    rng = np.random.default_rng(4)
    for _ in range(12):
        start, end = random_state(rng, speed), random_state(rng, speed)
        found = connector(start, end, limits=LIMITS[0], period=PERIOD)
        q, omega, alpha = found.ends()
        for k, state in enumerate((start, end)):
            assert angle(q[k], state.q) <= 1e-13
            assert omega[k] == pytest.approx(state.omega_body, abs=1e-12)
            assert alpha[k] == pytest.approx(state.alpha_body, abs=1e-9)
        inner = found.breaks[1:-1]
        before, after = (found.sample(np.nextafter(inner, side)) for side in (-1.0, 9.0))
        for part, other, bound in zip(before, after, (1e-12, 1e-9, 1e-6), strict=True):
            assert np.abs(part - other).max(initial=0.0) <= bound


def test_the_same_states_give_the_same_bits():
    rng = np.random.default_rng(8)
    start, end = random_state(rng, 0.3), random_state(rng, 0.3)
    one, other = (joined(start, end, LIMITS[1], PERIOD) for _ in range(2))
    for part, same in zip(one, other, strict=True):
        assert part.tobytes() == same.tobytes()


@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_joins_that_are_tried_are_those_of_numpy(limits, speed):
    rng = np.random.default_rng(5)
    first, last = (
        joins.Ends(
            normalize(rng.normal(size=(200, 4))),
            speed * rng.normal(size=(200, 3)),
            4.0 * speed * rng.normal(size=(200, 3)),
        )
        for _ in range(2)
    )
    durations = rng.uniform(0.3, 9.0, 200)
    around = random_state(rng, speed)
    w, kept = try_joins(first, last, durations, around, limits.with_reserve())
    reference = joins.increments(first, last, durations)[0]
    assert np.abs(w - reference).max() <= 1e-12
    bounds = connectors.Bounds.of(around, around, limits)
    is_kept = bounds.keeps(joins.rates(w, durations, with_axes=bounds.has_axes))
    assert kept.tolist() == np.flatnonzero(is_kept).tolist()
    assert 0 < len(kept) < 200


def test_a_curve_of_joins_is_sampled_as_numpy_does():
    rng = np.random.default_rng(6)
    q, w = normalize(rng.normal(size=(4, 4))), 0.7 * rng.normal(size=(4, 5, 3))
    w[1, 2] = 0.0
    durations = rng.uniform(0.1, 3.0, 4)
    breaks = np.concatenate([[-1.0], -1.0 + np.cumsum(durations)])
    found = trajectory_of_joins(q, w, breaks)
    u = np.linspace(0.0, 1.0, 30)[:-1]
    reference = joins.sampled(q, w, durations, joins.basis(u))
    samples = found.sample((breaks[:-1, None] + durations[:, None] * u).reshape(-1))
    # The sign of a quaternion goes on from one join to the next.
    signs = np.sign(np.sum(samples[0] * reference[0].reshape(-1, 4), axis=1, keepdims=True))
    assert np.abs(signs * samples[0] - reference[0].reshape(-1, 4)).max() <= 1e-8
    for part, other in zip(samples[1:], reference[1:], strict=True):
        assert np.abs(part - other.reshape(part.shape)).max() <= 1e-8
    at_ends = joins.sampled(q, w, durations, joins.basis(np.array([0.0, 1.0])))
    for part, other in zip(found.ends(), at_ends, strict=True):
        sign = signs[[0, -1]] if part.shape[1] == 4 else 1.0
        assert np.abs(sign * part - np.stack([other[0, 0], other[-1, 1]])).max() <= 1e-11


def test_what_is_not_a_number_has_no_connector():
    rng = np.random.default_rng(1)
    start, end = random_state(rng, 0.3), random_state(rng, 0.3)
    broken = State(start.q, start.omega_body * np.nan, start.alpha_body, start.position)
    assert joined(broken, end, LIMITS[0], PERIOD) is None
    assert joined(start, broken, LIMITS[0], PERIOD) is None


@pytest.mark.parametrize("place", range(4))
def test_arrays_of_other_shapes_are_refused(place):
    shapes = [(10,), (10,), (3, 4), (3, 4)]
    shapes[place] = (*shapes[place][:-1], shapes[place][-1] + 1)
    rows = [np.zeros(shape) for shape in shapes]
    out = np.empty((MOST_JOINS, 4)), np.empty((MOST_JOINS, 5, 3)), np.empty(MOST_JOINS + 1)
    with pytest.raises(ValueError, match="do not belong together"):
        kernels.connect(*rows, PERIOD, 0.0, LONGEST, FAR, 1.0, False, False, *out)


def shortened(start, end, limits, period, least=0.0):
    """Return the connector that the search finds and what it is shortened to, if it is."""
    way, shorter = (
        joined(start, end, limits, period, least, as_found=as_found) for as_found in (True, False)
    )
    assert way is not None
    is_shorter = shorter.times[-1] < way.times[-1]
    return way, curve_of(shorter) if is_shorter else None


def shares(curve, limits):
    """Return the largest shares of the limits of velocity, acceleration and jerk."""
    spots = np.arange(0.0, curve.domain[1], 2.5e-4)
    _, omega, alpha = curve.sample(spots)
    jerk = np.diff(alpha, axis=0) / np.diff(spots)[:, None]
    return [
        max(
            float(np.linalg.norm(rate, axis=1).max()) / getattr(limits, name),
            float(np.max(np.abs(rate) / limits.axes(name))),
        )
        for rate, name in ((omega, "velocity"), (alpha, "acceleration"), (jerk, "jerk"))
    ]


@pytest.mark.parametrize("limits", LIMITS)
@pytest.mark.parametrize("has_end_velocity", [False, True])
def test_a_shortened_connector_is_shorter_and_keeps_the_limits(limits, has_end_velocity):
    rng = np.random.default_rng(9)
    ratios = []
    for _ in range(30):
        start, end = random_state(rng, 0.3), random_state(rng, 0.3 * has_end_velocity)
        way, curve = shortened(start, end, limits, PERIOD)
        if curve is None:
            continue
        ratios.append(curve.domain[1] / way.times[-1])
        assert round(curve.domain[1] / PERIOD) * PERIOD == pytest.approx(curve.domain[1], abs=1e-12)
        reserved = limits.with_reserve()
        around = [
            max(shares_of(state, reserved)[order] for state in (start, end)) for order in (0, 1)
        ]
        velocity, acceleration, jerk = shares(curve, reserved)
        assert velocity <= max(1.0, around[0]) + 1e-3
        assert acceleration <= max(1.0, around[1]) + 0.02
        assert jerk <= 1.04
        q, omega, alpha = (part[-1] for part in curve.ends())
        assert angle(q, end.q) <= 1e-11
        assert omega == pytest.approx(end.omega_body, abs=1e-12)
        assert alpha == pytest.approx(end.alpha_body, abs=1e-9)
    assert len(ratios) >= 28
    assert max(ratios) < 1.0
    assert np.median(ratios) <= 0.93


def shares_of(state, limits):
    """Return shares of the limits of velocity and acceleration that a state has."""
    return [
        max(np.linalg.norm(v) / getattr(limits, name), np.max(np.abs(v) / limits.axes(name)))
        for v, name in ((state.omega_body, "velocity"), (state.alpha_body, "acceleration"))
    ]


def state(turn, omega, alpha=(0.0, 0.0, 0.0)):
    return State(exp(np.array(turn)), np.array(omega), np.array(alpha), np.zeros(3))


def test_a_device_that_gains_speed_just_below_its_limit_has_a_connector():
    limits = Limits(2.5, 17.0, 300.0, 1.0, 10.0)
    start = state(np.zeros(3), (1.251, -1.022, 1.277), (7.54, -7.7, 11.59))
    end = state((-0.174, 0.056, 0.055), (0.967, 0.077, -0.686))
    _, curve = shortened(start, end, limits, PERIOD)
    assert curve.domain[1] <= 0.65  # 0.76 before it is shortened


def test_a_guess_is_shortened_where_no_connector_is_found():
    limits = Limits(2.5, 17.0, 300.0, 1.0, 10.0, axis_velocity=(2.0, 0.7, 1.5))
    start = state(np.zeros(3), (1.956, -0.02, -0.048), (4.57, -11.72, -0.29))
    end = state((0.14, -1.28, 0.83), (-0.1, 0.2, 0.34))
    assert joined(start, end, limits, PERIOD, as_found=True) is None
    way = connector(start, end, limits=limits, period=PERIOD)
    assert way.duration <= 1.4  # by way of rest it is 2.03
    velocity, acceleration, jerk = shares(way, limits)
    assert max(velocity, acceleration, jerk) <= 1.0


NORMS = Limits(2.5, 17.0, 300.0, 1.0, 10.0)
ON_THE_VERGE = [
    # 1.91 s with a connector as it is found
    ((1.90985, 0.49148, 0.64849), (7.25734, 0.48637, -4.34911), (1.12, 0.23, 1.58),
     NORMS.with_rates({"velocity": [2.0, 0.7, 1.5]})),
    # refused with as little of the jerk's reserve as others have
    ((-0.39034, -2.31676, 0.49213), (9.89504, -8.4157, 1.93443), (0.34, -0.46, -1.88), NORMS),
]  # fmt: skip


@pytest.mark.parametrize(("omega", "alpha", "turn", "limits"), ON_THE_VERGE)
def test_a_device_on_the_verge_of_its_limits_is_led_as_quickly(omega, alpha, turn, limits):
    goal = Keyframe(tuple(exp(np.array(turn)).tolist()))
    start = state(np.zeros(3), omega, alpha)
    motion = plan(MotionRequest([goal]), start=start, limits=limits, period=PERIOD)
    assert motion.duration <= 1.2


def test_a_shortened_connector_from_rest_to_rest_is_the_quickest_turn():
    rng = np.random.default_rng(10)
    limits = DEFAULT_LIMITS.with_rates({"jerk": 300.0})
    for _ in range(10):
        axis = rng.normal(size=3)
        turn = rng.uniform(0.2, 2.5) * axis / np.linalg.norm(axis)
        start = State.at_rest(normalize(rng.normal(size=4)))
        end = State.at_rest(multiply(start.q, exp(turn)))
        _, curve = shortened(start, end, limits, PERIOD)
        reserved = limits.with_reserve()
        rates = reserved.velocity, reserved.acceleration, reserved.jerk
        least = float(double_s(float(np.linalg.norm(turn)), *rates).sum())
        assert least <= curve.domain[1] <= 1.015 * least + PERIOD


def test_a_shortened_connector_takes_the_time_that_it_must():
    rng = np.random.default_rng(12)
    start, end = random_state(rng, 0.3), random_state(rng, 0.0)
    way, _ = shortened(start, end, DEFAULT_LIMITS, PERIOD)
    least = 1.1 * way.times[-1]
    longer, curve = shortened(start, end, DEFAULT_LIMITS, PERIOD, least)
    assert least <= (longer.times[-1] if curve is None else curve.domain[1]) <= longer.times[-1]
