"""The laws that connectors keep."""

import numpy as np
import pytest

from orientd import kernels
from orientd.curves.hermite import KksQuinticHermite
from orientd.curves.trajectory import PIECE, Trajectory
from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.certify.measuring import limit_table
from orientd.planner.connect.connector import connector, state_row
from orientd.planner.job import TAKE_OVER_SHARE
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import angle, exp, multiply, normalize

PERIOD = 0.002
FAR = 100.0  # rad, that a connector may turn
MORE = 1.01
NOT_AT_ALL = -1.0  # rad; the way by rest is kept
LONGEST = 86_400.0  # s
MOST_PIECES = 1024
UNLIMITED = Limits.partial()
LIMITS = [DEFAULT_LIMITS, DEFAULT_LIMITS.with_rates({"velocity": [2.0, 0.7, 1.5], "jerk": 300.0})]


def random_state(rng, speed):
    return State(
        normalize(rng.normal(size=4)), speed * rng.normal(size=3), 4.0 * speed * rng.normal(size=3),
        np.zeros(3),
    )  # fmt: skip


def joined(start, end, limits, period, least=0.0, *, most_turn=FAR):
    """Return the connector that the kernel finds."""
    found = np.empty(MOST_PIECES + 1), np.empty((MOST_PIECES, PIECE))
    tables = 2 * (limit_table(limits.with_reserve()),)
    states = state_row(start), state_row(end)
    count = kernels.connect(*states, *tables, period, least, LONGEST, most_turn, MORE, *found)
    breaks, pieces = found
    return Trajectory(breaks[: count + 1], pieces[:count], breaks[: count + 1]) if count else None


@pytest.mark.parametrize("speed", [0.0, 0.3, 1.0])
def test_a_connector_is_one_smooth_curve_from_state_to_state(speed):
    rng = np.random.default_rng(4)
    for _ in range(12):
        start, end = random_state(rng, speed), random_state(rng, speed)
        found = connected(start, end, LIMITS[0])
        q, omega, alpha = found.ends()
        for k, state in enumerate((start, end)):
            assert angle(q[k], state.q) <= 1e-13
            assert omega[k] == pytest.approx(state.omega_body, abs=1e-12)
            assert alpha[k] == pytest.approx(state.alpha_body, abs=1e-9)
        inner = found.breaks[1:-1]
        before, after = (found.sample(np.nextafter(inner, side)) for side in (-1.0, 9.0))
        for part, other, bound in zip(before, after, (1e-12, 1e-9, 1e-6), strict=True):
            assert np.abs(part - other).max(initial=0.0) <= bound


def connected(start, end, limits):
    """Return the connector that a motion uses."""
    within = limits.with_reserve(TAKE_OVER_SHARE)
    return connector(start, end, limits=within, own=within, period=PERIOD)


def test_the_same_states_give_the_same_bits():
    rng = np.random.default_rng(8)
    start, end = random_state(rng, 0.3), random_state(rng, 0.3)
    one, other = (joined(start, end, LIMITS[1], PERIOD) for _ in range(2))
    assert one.breaks.tobytes() == other.breaks.tobytes()
    assert one.pieces.tobytes() == other.pieces.tobytes()


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
    out = np.empty(MOST_PIECES + 1), np.empty((MOST_PIECES, PIECE))
    with pytest.raises(ValueError, match="do not belong together"):
        kernels.connect(*rows, PERIOD, 0.0, LONGEST, FAR, MORE, *out)


def shortened(start, end, limits, period, least=0.0):
    """Return the times of the way by rest, and what it is shortened to, if it is."""
    way, shorter = (
        joined(start, end, limits, period, least, most_turn=most) for most in (NOT_AT_ALL, FAR)
    )
    assert way is not None
    return way.breaks, shorter if shorter.duration < way.duration else None


def shares(curve, limits, step=2.5e-4):
    """Return the largest shares of the limits of velocity, acceleration and jerk."""
    spots = np.arange(0.0, curve.domain[1], step)
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
    ratios, by_rest = [], []
    for _ in range(30):
        start, end = random_state(rng, 0.3), random_state(rng, 0.3 * has_end_velocity)
        times, curve = shortened(start, end, limits, PERIOD)
        if curve is None:
            continue
        by_rest.append(curve.domain[1] / times[-1])
        ratios.append(curve.domain[1] / single_join(start, end, limits.with_reserve()))
        assert round(curve.domain[1] / PERIOD) * PERIOD == pytest.approx(curve.domain[1], abs=1e-12)
        reserved = limits.with_reserve()
        around = [
            max(shares_of(state, reserved)[order] for state in (start, end)) for order in (0, 1)
        ]
        velocity, acceleration, jerk = shares(curve, reserved)
        assert velocity <= max(1.0, around[0]) + 1e-3
        assert acceleration <= max(1.0, around[1]) + 0.02
        assert jerk <= 1.02
        q, omega, alpha = (part[-1] for part in curve.ends())
        assert angle(q, end.q) <= 1e-11
        assert omega == pytest.approx(end.omega_body, abs=1e-12)
        assert alpha == pytest.approx(end.alpha_body, abs=1e-9)
    assert len(ratios) >= 28
    assert max(by_rest) < 1.0
    assert np.median(ratios) <= 0.93


def single_join(start, end, limits):
    """Return the duration of the shortest quintic that keeps the limits, infinite if none does."""
    had = np.max([shares_of(one, limits) for one in (start, end)], axis=0)
    most = np.maximum(1.0, [*had, 0.0])
    ends = {
        f"{name}{index}": value
        for index, state in enumerate((start, end))
        for name, value in (
            ("q", state.q), ("omega", state.omega_body), ("alpha", state.alpha_body)
        )
    }  # fmt: skip
    durations = np.arange(0.1, 10.0, 0.01)
    quickest = angle(start.q, end.q) / (most[0] * limits.velocity)
    for duration in durations[durations > quickest]:
        curve = KksQuinticHermite(t0=0.0, t1=duration, **ends).trajectory
        # What a few of the spots show to be beyond a limit needs no others.
        if all((shares(curve, limits, step) <= most).all() for step in (5e-3, 2.5e-4)):
            return duration
    return np.inf


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
    assert curve.domain[1] <= 0.65


def test_a_device_that_rises_beside_a_limit_is_not_led_by_way_of_rest():
    limits = Limits(2.5, 17.0, 300.0, 1.0, 10.0, axis_velocity=(2.0, 0.7, 1.5))
    start = state(np.zeros(3), (1.956, -0.02, -0.048), (4.57, -11.72, -0.29))
    goal, velocity = Keyframe(tuple(exp(np.array((0.14, -1.28, 0.83))).tolist())), (-0.1, 0.2, 0.34)
    request = MotionRequest([goal], end_velocity=velocity)
    motion = plan(request, start=start, limits=limits, period=PERIOD)
    assert motion.end_time <= 1.4  # by way of rest it is 2.03


def test_a_device_that_must_turn_on_round_does_not_rest_before():
    limits = Limits(10.0, 0.5, 5.0, 1.0, 10.0)
    start = state(np.zeros(3), (0.768, -0.886, 2.004))
    goal = Keyframe(tuple(exp(np.array((-0.11, 0.0, 0.058))).tolist()))
    motion = plan(MotionRequest([goal]), start=start, limits=limits, period=PERIOD)
    assert motion.duration <= 5.3  # by way of rest it is 7.33


NORMS = Limits(2.5, 17.0, 300.0, 1.0, 10.0)
ON_THE_VERGE = [
    # 1.91 s with a connector of quintic pieces
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
        curve = joined(start, end, limits, PERIOD)
        reserved = limits.with_reserve()
        rates = reserved.velocity, reserved.acceleration, reserved.jerk
        rise, hold, cruise = kernels.double_s(float(np.linalg.norm(turn)), *rates)
        least = 4.0 * rise + 2.0 * hold + cruise
        assert least <= curve.domain[1] + 1e-12
        assert curve.domain[1] <= least + PERIOD


def test_a_shortened_connector_takes_the_time_that_it_must():
    rng = np.random.default_rng(12)
    start, end = random_state(rng, 0.3), random_state(rng, 0.0)
    times, curve = shortened(start, end, DEFAULT_LIMITS, PERIOD)
    least = 0.5 * (curve.domain[1] + times[-1])
    _, longer = shortened(start, end, DEFAULT_LIMITS, PERIOD, least)
    assert least <= longer.domain[1] <= 1.01 * least + PERIOD
    least = 1.1 * times[-1]
    way, curve = shortened(start, end, DEFAULT_LIMITS, PERIOD, least)
    assert curve is None
    assert least <= way[-1] <= least + PERIOD


@pytest.mark.parametrize("limits", LIMITS)
def test_a_way_by_rest_leads_from_any_state_to_any_other(limits):
    rng = np.random.default_rng(13)
    for _ in range(20):
        start, end = random_state(rng, 0.3), random_state(rng, 0.3)
        curve = joined(start, end, limits, PERIOD, most_turn=NOT_AT_ALL)
        q, omega, alpha = curve.ends()
        for k, state in enumerate((start, end)):
            assert angle(q[k], state.q) <= 1e-11
            assert omega[k] == pytest.approx(state.omega_body, abs=1e-12)
            assert alpha[k] == pytest.approx(state.alpha_body, abs=1e-9)
        reserved_limits = limits.with_reserve()
        around = max(shares_of(state, reserved_limits)[1] for state in (start, end))
        _, acceleration, jerk = shares(curve, reserved_limits)
        assert acceleration <= max(1.0, around) + 1e-3
        assert jerk <= 1.0 + 1e-3
        cycles = curve.domain[1] / PERIOD
        assert cycles == pytest.approx(round(cycles), abs=1e-9)
