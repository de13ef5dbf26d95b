import numpy as np
import pytest
from planned import LIMITS, PERIOD, differences, random_motions
from reference.differences import brake_rate

from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.certify.brake import FASTEST_BRAKE_RATE
from orientd.planner.planning import plan
from orientd.planner.recorded import STATE_FLOATS, states_at
from orientd.planner.state import State
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
        x = angular_rate(omega, alpha, jerk, limits)
        assert excess(omega, alpha, jerk, limits, x) <= 1.0


def test_the_rate_is_nearly_the_largest_that_is_safe():
    for omega, alpha, jerk in zip(*points(np.random.default_rng(2), 60, SOFT), strict=True):
        x = angular_rate(omega, alpha, jerk, SOFT)
        if x < FASTEST_BRAKE_RATE:
            assert excess(omega, alpha, jerk, SOFT, 1.03 * x) > 1.0


def test_without_reserve_there_is_no_brake():
    along, alpha = np.array([0.5, 0.0, 0.0]), np.array([SOFT.acceleration, 0.0, 0.0])
    assert angular_rate(along, alpha, 0.0, SOFT) < 0.02
    assert angular_rate(along, 1.01 * alpha, 0.0, SOFT) == 0.0


def test_a_reserve_buys_its_square_root():
    along, rates = np.array([1.0, 0.0, 0.0]), []
    for reserve in (0.01, 0.04):
        alpha = np.array([(1 - reserve) * SOFT.acceleration, 0.0, 0.0])
        rates.append(angular_rate(along, alpha, 0.0, SOFT))
    assert rates[1] / rates[0] == pytest.approx(2.0, rel=0.05)


def test_a_motion_at_rest_brakes_at_the_fastest_rate():
    assert angular_rate(np.zeros(3), np.zeros(3), 0.0, SOFT) == FASTEST_BRAKE_RATE


def test_infinite_limits_do_not_slow_the_brake():
    omega, alpha, jerk = points(np.random.default_rng(4), 1, SOFT)
    assert angular_rate(omega[0], alpha[0], jerk[0], Limits.partial()) == FASTEST_BRAKE_RATE


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
        for _ in range(60):
            p = along_records(motion, drive(motion, random))
            p = np.concatenate([p[:1], p, p[-1:]])
            push = np.linalg.norm(np.diff(p, n=2, axis=0), axis=1) / motion.period**2
            largest = max(largest, push.max())
    assert 0.99 * limits.linear_acceleration < largest <= 1.001 * limits.linear_acceleration


@pytest.mark.parametrize("method", ["kks_hermite_spline", "squad", "c2_cumulative"])
def test_what_is_left_to_brake_with_counts_the_acceleration_at_every_rate(method):
    """The slower a path is passed, the less its differences average steps of the acceleration."""
    limits, random = LIMITS["arm"], np.random.default_rng(6)
    keyframes = [Keyframe(tuple(q)) for q in exp(0.3 * random.normal(size=(5, 3))).tolist()]
    request = MotionRequest(keyframes, method=method, approach=True, pace="even")
    start = State.at_rest((1.0, 0.0, 0.0, 0.0))
    motion = plan(request, start=start, limits=limits, period=PERIOD)
    rows = np.ascontiguousarray(motion.rows(0, motion.record_count)[:, :STATE_FLOATS])
    rates = 1.0 - random.uniform(size=100_000) ** 2
    places = random.uniform(2.0, len(rows) - 1.0, size=len(rates))
    last, middle, first = (states_at(rows, places - k * rates, PERIOD) for k in range(3))
    turns = [
        log(multiply(conjugate(one[:, :4]), other[:, :4])) / PERIOD
        for one, other in ((first, middle), (middle, last))
    ]
    # The change of the rate adds the velocity times it; see the module on braking.
    change = np.minimum(2.0, np.sqrt(8.0 * np.minimum(rates, 1.0 - rates)))
    slower = (motion.certificate.brake_rate * change)[:, None] * middle[:, 4:7]
    seen = (turns[1] - turns[0]) / PERIOD
    sizes = [np.linalg.norm(seen + sign * slower, axis=1).max() for sign in (-1.0, 1.0)]
    assert 0.97 * limits.acceleration < max(sizes) <= 1.001 * limits.acceleration
