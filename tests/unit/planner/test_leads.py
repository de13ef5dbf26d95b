import math
from dataclasses import replace

import numpy as np
import pytest
from planned import LIMITS, PERIOD, differences, rotations, vector
from reference.ruckig_turn import fastest

from orientd.errors import PlanError
from orientd.model.limits import Limits, is_still
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.connect.connector import connector
from orientd.planner.connect.leads import (
    LEAD_SHARE,
    approach,
    approach_cycles,
    from_rest,
    lead_out,
)
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.planner.timing.axis_turn import usable
from orientd.rotation import angle, conjugate, exp, log, multiply

ARM, SOFT = LIMITS["arm"], LIMITS["soft"]


def state(seed, speed, size, *, parallel=False):
    random = np.random.default_rng(seed)
    q = np.array(rotations(random, 2, 1.0)[0])
    omega = np.array(vector(random, speed)) if speed else np.zeros(3)
    alpha = np.array(vector(random, size)) if size else np.zeros(3)
    if parallel:
        alpha = omega * (size / speed)
    return q, omega, alpha


def lead(seed, speed, size, limits=ARM, **fields):
    q, omega, alpha = state(seed, speed, size, **fields)
    start = State(q, omega, alpha, np.zeros(3))
    return q, omega, alpha, lead_out(start, limits=limits, period=PERIOD, share=LEAD_SHARE)


CASES = [(2.4, 0.0), (1.0, 10.0), (0.5, 16.9), (0.0, 12.0), (1e-3, 5.0), (1e-6, 1.0), (1.0, 1e-5)]


@pytest.mark.parametrize(("speed", "size"), CASES)
def test_a_lead_out_begins_in_the_state_it_was_given(speed, size):
    for seed in range(4):
        q, omega, alpha, curve = lead(seed, speed, size)
        first, w, a = (part[0] for part in curve.sample(np.array([0.0])))
        assert angle(first, q) < 1e-14
        assert w == pytest.approx(omega, abs=1e-12)
        assert a == pytest.approx(alpha, abs=1e-9)


@pytest.mark.parametrize(("speed", "size"), CASES)
def test_a_lead_out_ends_at_rest_without_acceleration(speed, size):
    for seed in range(4):
        *_, curve = lead(seed, speed, size)
        _, w, a = (part[0] for part in curve.sample(np.array([curve.domain[1]])))
        assert np.linalg.norm(w) < 1e-12
        assert np.linalg.norm(a) < 1e-9


@pytest.mark.parametrize("name", sorted(LIMITS))
@pytest.mark.parametrize("share", [0.1, 0.5, 0.8])
def test_a_lead_out_keeps_the_limits_at_the_rate_of_the_device(name, share):
    limits = LIMITS[name]
    for seed in range(5):
        *_, curve = lead(seed, share * limits.velocity, share * limits.acceleration, limits)
        times = np.arange(round(curve.domain[1] / PERIOD) + 1) * PERIOD
        q = curve.sample(np.minimum(times, curve.domain[1]))[0]
        velocity, acceleration, jerk = (rates[4:-3] for rates in differences(q, PERIOD))
        for rates, limit in (
            (velocity, limits.velocity),
            (acceleration, limits.acceleration),
            (jerk, limits.jerk),
        ):
            if len(rates):
                assert rates.max() <= limit


def test_a_lead_out_takes_whole_periods():
    for speed, size in CASES:
        *_, curve = lead(1, speed, size)
        cycles = curve.domain[1] / PERIOD
        assert cycles == pytest.approx(round(cycles), abs=1e-9)


@pytest.mark.parametrize(("speed", "limits"), [(2.0, ARM), (0.3, ARM), (0.3, SOFT)])
def test_the_shortest_fall_from_a_velocity_is_the_closed_form(speed, limits):
    # Half a double S: the acceleration rises and falls at the largest jerk.
    _, omega, _, curve = lead(4, speed, 0.0, limits)
    _, most, jerk = (LEAD_SHARE * one for one in limits.along((omega / speed).tolist()))
    is_long = speed * jerk > most**2
    shortest = speed / most + most / jerk if is_long else 2.0 * math.sqrt(speed / jerk)
    assert shortest <= curve.domain[1] < shortest + PERIOD


@pytest.mark.parametrize("size", [-6.0, 6.0])
def test_a_stop_about_one_axis_stays_about_it(size):
    q, omega, _, curve = lead(3, 1.2, size, parallel=True)
    axis = omega / np.linalg.norm(omega)
    turned, rates, _ = curve.sample(curve.duration * np.linspace(0.0, 1.0, 21))
    assert np.abs(rates - (rates @ axis)[:, None] * axis).max() <= 1e-12
    way = log(multiply(conjugate(q), turned[-1]))
    assert way == pytest.approx((way @ axis) * axis, abs=1e-12)


def test_a_stop_uses_all_of_its_share_of_the_limits():
    limits, uses = SOFT, []
    for seed in range(20):
        *_, curve = lead(seed, 0.6 * limits.velocity, 0.6 * limits.acceleration, limits)
        times = np.linspace(0.0, curve.domain[1], 4001)
        alpha = curve.sample(times)[2]
        jerk = np.linalg.norm(np.diff(alpha, axis=0), axis=1) / times[1]
        uses.append(
            [
                np.linalg.norm(alpha, axis=1).max() / limits.acceleration,
                jerk.max() / limits.jerk,
            ]
        )
    assert np.max(uses) <= LEAD_SHARE + 1e-3
    assert np.min(np.max(uses, axis=1)) >= 0.95 * LEAD_SHARE


def test_a_fall_of_more_than_half_a_turn_keeps_its_way():
    limits = Limits(3.0, 0.5, 100.0, 1.0, 1.0)
    _, omega, _, curve = lead(6, 2.9, 0.0, limits)
    assert np.linalg.norm(omega) * curve.domain[1] / 2 > math.pi
    t = np.linspace(0.0, curve.domain[1], 4001)
    path = curve.sample(t)[0]
    turned = np.linalg.norm(log(multiply(conjugate(path[:-1]), path[1:])), axis=1).sum()
    assert turned == pytest.approx(np.linalg.norm(omega) * curve.domain[1] / 2, rel=1e-5)


def test_a_velocity_that_would_overshoot_its_limit_is_refused():
    with pytest.raises(PlanError, match=r"between rest and 2\.5 rad/s with 15 rad/s\^2 none keeps"):
        lead(7, 2.5, 15.0, parallel=True)


def test_rest_needs_no_lead():
    zero = np.zeros(3)
    assert is_still(zero, zero, ARM)
    assert not is_still(np.array([0, 0, 1e-6]), zero, ARM)
    assert not is_still(zero, np.array([0, 0, 1e-3]), ARM)


HERE = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("turn", [1e-6, 0.01, 1.0, 3.1])
@pytest.mark.parametrize("name", sorted(LIMITS))
def test_an_approach_keeps_the_limits_and_one_period_less_would_not(turn, name):
    limits = LIMITS[name]
    there = exp([0.0, 0.0, turn])
    cycles = approach_cycles(approach(HERE, there, limits), 0.0, limits=limits, period=PERIOD)
    full = limits.velocity, limits.acceleration, limits.jerk
    used = usable(turn, *full, is_part=True)
    assert (cycles - 1) * PERIOD < 1.001 * fastest(turn, *used)
    assert fastest(turn, *full) <= cycles * PERIOD


def test_an_approach_is_long_enough_for_the_position_too():
    far = np.array([1.0, 0.0, 0.0])
    cycles = approach_cycles(None, float(np.linalg.norm(far)), limits=ARM, period=PERIOD)
    assert cycles * PERIOD == pytest.approx(1.875 / ARM.linear_velocity, abs=PERIOD)


def test_no_approach_is_needed_to_where_the_device_is():
    assert approach(HERE, -HERE, ARM) is None
    assert approach_cycles(None, 0.0, limits=ARM, period=PERIOD) == 0


def test_a_start_that_is_off_by_rounding_needs_no_lead_in():
    start = State.at_rest(HERE, np.array([0.1, 0.2, 0.3]))
    first = State.at_rest(HERE, start.position + 1e-16)
    lead_in = from_rest(start, first, limits=ARM, period=PERIOD, share=LEAD_SHARE)
    assert (lead_in.cycles, lead_in.positions.is_held) == (0, True)


def test_an_approach_takes_the_short_way_from_rest_to_rest():
    there = -exp([0.0, 0.0, 2.0])
    turn = approach(HERE, there, LIMITS["arm"])
    q, omega, alpha = turn.sample(turn.duration * np.array([0.0, 0.5, 1.0]))
    assert angle(q[2], there) < 1e-14
    most = LIMITS["arm"].velocity
    assert np.linalg.norm(omega, axis=1) == pytest.approx([0, most, 0], rel=1e-3, abs=1e-12)
    assert np.linalg.norm(alpha[[0, 2]], axis=1) == pytest.approx([0, 0], abs=1e-9)


@pytest.mark.parametrize("jerk", [1e-15, 1e-300])
def test_leads_that_would_take_days_are_refused(jerk):
    slow = Limits.partial(velocity=1.0, acceleration=1.0, jerk=jerk)
    nowhere, omega = np.zeros(3), np.array([0.1, 0.0, 0.0])
    here, there = exp(nowhere), exp(omega)
    with pytest.raises(PlanError, match="at most 86400 s is planned"):
        approach(here, there, slow)
    with pytest.raises(PlanError, match="at most 86400 s is planned"):
        lead_out(State(here, omega, nowhere, nowhere), limits=slow, period=PERIOD, share=LEAD_SHARE)
    start, end = State(here, omega, nowhere, nowhere), State.at_rest(there)
    with pytest.raises(PlanError, match="at most 86400 s is planned"):
        connector(start, end, limits=slow, own=slow, period=PERIOD)


@pytest.mark.parametrize("angle", [0.0, 0.3])
def test_a_lead_in_does_not_move_a_position_that_differs_by_rounding(angle):
    place = np.array([0.3, -0.2, 0.7])
    start = State.at_rest((1.0, 0.0, 0.0, 0.0), np.nextafter(place, 1.0))
    first = State.at_rest(tuple(exp([0.0, 0.0, angle])), place)
    lead_in = from_rest(start, first, limits=ARM, period=PERIOD, share=LEAD_SHARE)
    assert lead_in.positions.is_held
    np.testing.assert_array_equal(lead_in.positions.last, place)
    assert (lead_in.cycles > 0) == (angle > 0.0)


def test_where_the_time_is_given_a_stop_on_the_approach_is_short():
    random = np.random.default_rng(4)
    here, *keys = rotations(random, 4, 0.6)
    limits, start = LIMITS["arm"], State.at_rest(np.array(here))
    request = MotionRequest([Keyframe(q) for q in keys], approach=True)
    quick = plan(request, start=start, limits=limits, period=PERIOD)
    between = quick.end_time - quick.start_time
    calm = plan(replace(request, duration=3.0 * between), start=start, limits=limits, period=PERIOD)
    assert calm.certificate.stop_time < 0.6 * quick.certificate.stop_time
    assert calm.start_time < 1.2 * quick.start_time
