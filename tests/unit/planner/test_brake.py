import numpy as np
import pytest
from planned import LIMITS, PERIOD, differences, random_motions

from orientd.planner import Keyframe, Limits, MotionRequest, State, plan
from orientd.planner.certify.brake import FASTEST_BRAKE_RATE, brake_rate
from orientd.planner.recorded import STATE_FLOATS, states_at
from orientd.rotation import conjugate, exp, log, multiply
from orientd.servo.path.time_scaling import TimeScaling

SOFT = LIMITS["soft"]


def angular_rate(omega, alpha, jerk, limits):
    return brake_rate(omega, alpha, jerk, limits.acceleration, limits.jerk)


def points(random, count, limits):
    """Return path points inside the limits, some of them right at one."""
    omega, alpha = random.normal(size=(2, count, 3))
    omega *= (limits.velocity * random.uniform(0, 1, count) / np.linalg.norm(omega, axis=1))[
        :, None
    ]
    size = limits.acceleration * np.minimum(random.uniform(0, 1.1, count), 0.999)
    alpha *= (size / np.linalg.norm(alpha, axis=1))[:, None]
    return omega, alpha, limits.jerk * np.minimum(random.uniform(0, 1.1, count), 0.999)


def excess(omega, alpha, jerk, limits, x):
    """Return the largest share of a limit over all rates and their changes, by brute force."""
    sigma = np.concatenate([np.linspace(0, 1, 2001), 1 - np.geomspace(1e-9, 1e-2, 400)])[:, None]
    g = x * np.minimum(2, np.sqrt(8 * np.minimum(sigma, 1 - sigma)))
    worst = 0.0
    for sign in (-1, 1):
        alpha_t = alpha * sigma**2 + sign * omega * g
        worst = max(worst, np.linalg.norm(alpha_t, axis=1).max() / limits.acceleration)
    a, w = np.linalg.norm(alpha), np.linalg.norm(omega)
    jerk_t = jerk * sigma**2 + 3 * a * sigma * g + 4 * w * x * x
    return max(worst, jerk_t.max() / limits.jerk)


@pytest.mark.parametrize("name", sorted(LIMITS))
def test_no_change_of_speed_breaks_a_limit_at_the_rate_returned(name):
    limits = LIMITS[name]
    for omega, alpha, jerk in zip(*points(np.random.default_rng(1), 60, limits), strict=True):
        x, _ = angular_rate(omega[None], alpha[None], np.array([jerk]), limits)
        assert excess(omega, alpha, jerk, limits, x) <= 1.0


def test_the_rate_is_nearly_the_largest_that_is_safe():
    for omega, alpha, jerk in zip(*points(np.random.default_rng(2), 60, SOFT), strict=True):
        x, _ = angular_rate(omega[None], alpha[None], np.array([jerk]), SOFT)
        if x < FASTEST_BRAKE_RATE:
            assert excess(omega, alpha, jerk, SOFT, 1.03 * x) > 1.0


def test_the_rate_of_many_points_is_the_least_of_them_with_its_place():
    omega, alpha, jerk = points(np.random.default_rng(3), 3000, SOFT)
    alone = [
        angular_rate(omega[k : k + 1], alpha[k : k + 1], jerk[k : k + 1], SOFT)[0]
        for k in range(3000)
    ]
    rate, place = angular_rate(omega, alpha, jerk, SOFT)
    assert rate == min(alone)
    assert alone[place] == rate


def test_without_reserve_there_is_no_brake():
    along = np.array([[0.5, 0.0, 0.0]])
    alpha = np.array([[SOFT.acceleration, 0.0, 0.0]])
    rate, _ = angular_rate(along, alpha, np.zeros(1), SOFT)
    assert rate < 0.02
    rate, _ = angular_rate(along, 1.01 * alpha, np.zeros(1), SOFT)
    assert rate == 0.0


def test_a_reserve_buys_its_square_root():
    rates = []
    for reserve in (0.01, 0.04):
        alpha = np.array([[(1 - reserve) * SOFT.acceleration, 0.0, 0.0]])
        rates.append(angular_rate(np.array([[1.0, 0, 0]]), alpha, np.zeros(1), SOFT)[0])
    assert rates[1] / rates[0] == pytest.approx(2.0, rel=0.05)


def test_a_motion_at_rest_brakes_at_the_fastest_rate():
    zero = np.zeros((4, 3))
    assert angular_rate(zero, zero, np.zeros(4), SOFT)[0] == FASTEST_BRAKE_RATE
    assert angular_rate(zero[:0], zero[:0], np.zeros(0), SOFT)[0] == FASTEST_BRAKE_RATE


def test_infinite_limits_do_not_slow_the_brake():
    omega, alpha, jerk = points(np.random.default_rng(4), 10, SOFT)
    assert angular_rate(omega, alpha, jerk, Limits.partial())[0] == FASTEST_BRAKE_RATE


def test_the_linear_rate_looks_at_the_acceleration_of_the_position():
    v, a = np.array([[0.5, 0.0, 0.0]]), np.array([[0.0, 4.0, 0.0]])
    rate, _ = brake_rate(v, a, np.zeros(1), SOFT.linear_acceleration, np.inf)
    wide = Limits(SOFT.velocity, SOFT.linear_acceleration, 1e9, 1.0, 1.0)
    assert rate == angular_rate(v, a, np.zeros(1), wide)[0]
    assert 0.0 < rate < FASTEST_BRAKE_RATE


def drive(motion, random):
    """Return the path times of the setpoints while the speed is changed at random."""
    clock = TimeScaling(motion.period)
    x = motion.certificate.brake_rate
    clock.begin(x, 1.0)
    path_time, path_times = 0.0, [0.0]
    while path_time < motion.duration:
        if random.random() < 2.0 * x * motion.period:
            clock.target = float(random.choice([0.0, 1.0, random.random()]))
        if clock.is_at_rest:
            clock.target = 1.0
        path_time = min(path_time + clock.advance() * motion.period, motion.duration)
        path_times.append(path_time)
    return np.array(path_times)


@pytest.mark.parametrize(
    ("name", "method", "count"),
    [
        ("arm", "c2_cumulative", 6),
        ("arm", "kks_hermite_spline", 6),
        ("soft", "c2_cumulative", 6),
        ("soft", "kks_hermite_spline", 3),
        ("slow", "c2_cumulative", 4),
    ],
)
def test_stops_at_random_points_keep_the_limits_of_the_guard(name, method, count):
    random = np.random.default_rng(len(name + method))
    for motion in random_motions(len(method), count, LIMITS[name], method=method):
        limits = motion.limits
        samples = motion.sample(drive(motion, random))
        velocity, acceleration, jerk = differences(samples.q, PERIOD)
        assert velocity.max() <= limits.velocity * 1.001
        assert acceleration.max() <= limits.acceleration * 1.001
        assert jerk.max() <= limits.jerk * 1.001
        p = np.concatenate([samples.position[:1], samples.position, samples.position[-1:]])
        push = np.linalg.norm(np.diff(p, n=2, axis=0), axis=1) / PERIOD**2
        assert push.max() <= limits.linear_acceleration * 1.001


def along_records(motion, path_times):
    """Return positions as the servo sends them: between two records it follows a cubic."""
    rows = np.ascontiguousarray(motion.rows(0, motion.record_count)[:, :STATE_FLOATS])
    return states_at(rows, path_times / motion.period, motion.period)[:, 10:13]


@pytest.mark.parametrize("seed", [1, 5])
def test_stops_keep_the_limit_of_a_position_between_two_records(seed):
    random, limits = np.random.default_rng(seed), Limits(2.0, 8.0, 200.0, 0.5, 2.0)
    start, largest = State.at_rest((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), 0.0
    for _ in range(30):
        turns, places = random.normal(size=(2, random.choice((1, 2, 4)), 3))
        keyframes = [
            Keyframe(tuple(q), position=tuple(place))
            for q, place in zip(exp(0.3 * turns).tolist(), (0.3 * places).tolist(), strict=True)
        ]
        request = MotionRequest(keyframes, approach=True)
        motion = plan(request, start=start, limits=limits, period=0.02)
        for _ in range(10):
            p = along_records(motion, drive(motion, random))
            p = np.concatenate([p[:1], p, p[-1:]])
            push = np.linalg.norm(np.diff(p, n=2, axis=0), axis=1) / motion.period**2
            largest = max(largest, push.max())
    assert 0.99 * limits.linear_acceleration < largest <= 1.001 * limits.linear_acceleration


@pytest.mark.parametrize("jerk", [8500.0, 300.0])
@pytest.mark.parametrize("method", ["kks_hermite_spline", "squad", "c2_cumulative"])
def test_the_brake_of_a_motion_counts_the_acceleration_of_every_record(method, jerk):
    limits, rng = LIMITS["arm"].with_rates({"jerk": jerk}), np.random.default_rng(6)
    keyframes = [Keyframe(tuple(q)) for q in exp(0.3 * rng.normal(size=(5, 3))).tolist()]
    request = MotionRequest(keyframes, method=method, approach=True, pace="even")
    start = State.at_rest((1.0, 0.0, 0.0, 0.0))
    motion = plan(request, start=start, limits=limits, period=PERIOD)
    rows = motion.records(0, motion.record_count)
    omega = log(multiply(conjugate(rows[:-1, :4]), rows[1:, :4])) / PERIOD
    alpha = np.diff(omega, axis=0) / PERIOD
    changes = np.linalg.norm(np.diff(alpha, axis=0), axis=1) / PERIOD
    # Of the accelerations of the three records, as far as they leave a share of the limit.
    known = np.minimum(np.linalg.norm(rows[1:, 7:10], axis=1), 0.95 * limits.acceleration)
    known = np.lib.stride_tricks.sliding_window_view(known, 3).max(axis=1)
    speed, size = (np.linalg.norm(part, axis=1) for part in (omega[2:], alpha[1:]))
    along = np.sum(omega[2:] * alpha[1:], axis=1) / np.maximum(speed, 1e-12)
    beside = np.sqrt(np.maximum(np.maximum(size, known) ** 2 - along**2, 0.0))
    still = np.zeros(len(speed))
    velocities, accelerations = (
        np.stack(parts, axis=1) for parts in ((speed, still, still), (along, beside, still))
    )
    rate, _ = angular_rate(velocities, accelerations, changes, limits)
    assert 0.99 * rate < motion.certificate.brake_rate <= rate * (1.0 + 1e-9)
