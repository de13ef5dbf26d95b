"""What samples foretell: smooth motions exactly, noisy ones calmly, and never more work."""

import random
from itertools import pairwise
from math import cos, pi, sin, sqrt

import pytest
from tracking_world import NS, World, angle, servo_limits

from orientd import kernels
from orientd.driver import ZERO
from orientd.floats import difference, exp, multiply, norm, plus
from orientd.servo.tracking.forecast import WINDOW, Forecast, TimedValue

PERIOD, PERIOD_NS = 0.002, 2_000_000
AXIS = (0.36, -0.48, 0.8)


def about(radians):
    return exp(plus(ZERO, AXIS, radians))


def forecasts(motion, hz, seconds, *, is_turn, rate=None, late=0.0, noise=0.0, seed=1):
    """Yield the time and the forecast of every cycle, from samples as they arrive."""
    rng, forecast = random.Random(seed), Forecast(PERIOD, is_turn=is_turn)
    samples, sent = [], 0
    for cycle in range(1, round(seconds / PERIOD)):
        now_ns = cycle * PERIOD_NS
        while sent / hz + late <= now_ns / NS:
            t = round(sent / hz * NS) / NS
            value, shift = motion(t), tuple(rng.gauss(0.0, noise) for _ in range(3))
            value = multiply(value, exp(shift)) if is_turn else plus(value, shift, 1.0)
            samples.append(TimedValue(round(t * NS), value, rate and rate(t)))
            sent += 1
        if samples:
            yield now_ns / NS, forecast.at(samples, sent, now_ns)


@pytest.mark.parametrize("hz", [30, 100, 500])
def test_a_polynomial_of_the_fifth_degree_is_foretold(hz):
    def motion(t):
        return (0.3 * t, 0.1 * t**2 - 0.2 * t, 0.2 * t - 0.1 * t**3 + 0.03 * t**5)

    for t, found in forecasts(motion, hz, 3.0, is_turn=False, late=0.005):
        if t > 1.5:
            assert norm(plus(found.value, motion(t), -1.0)) < 1e-5
            assert found.rate[2] == pytest.approx(0.2 - 0.3 * t**2 + 0.15 * t**4, abs=2e-4)
            assert found.change[2] == pytest.approx(-0.6 * t + 0.6 * t**3, abs=1e-2)


@pytest.mark.parametrize("hertz", [0.5, 1.0, 2.0])
def test_a_swing_is_foretold_from_thirty_samples_a_second(hertz):
    spin = 2.0 * pi * hertz
    worst = fastest = hardest = 0.0
    for t, found in forecasts(
        lambda t: about(0.1 * sin(spin * t)), 30, 6.0, is_turn=True, late=0.002
    ):
        if t > 3.0:
            worst = max(worst, angle(found.value, about(0.1 * sin(spin * t))))
            rate = plus(ZERO, AXIS, 0.1 * spin * cos(spin * t))
            fastest = max(fastest, norm(plus(found.rate, rate, -1.0)))
            change = plus(ZERO, AXIS, -0.1 * spin**2 * sin(spin * t))
            hardest = max(hardest, norm(plus(found.change, change, -1.0)))
    assert worst < 0.01 * 0.1
    assert fastest < 0.02 * 0.1 * spin
    assert hardest < 0.2 * 0.1 * spin**2


def test_velocities_that_are_given_foretell_a_turn_from_its_second_sample_on():
    for t, found in forecasts(
        lambda t: about(0.7 * t),
        20,
        0.5,
        is_turn=True,
        rate=lambda _: plus(ZERO, AXIS, 0.7),
    ):
        assert angle(found.value, about(0.7 * t)) < 1e-8
        assert norm(found.rate) == pytest.approx(0.7, abs=1e-8)


@pytest.mark.parametrize("hz", [30, 60, 200, 500])
def test_noise_of_a_steady_turn_is_averaged(hz):
    square, count, hardest = 0.0, 0, 0.0
    for t, found in forecasts(lambda t: about(0.5 * t), hz, 4.0, is_turn=True, noise=1e-3):
        if t > 2.0:
            square, count = square + angle(found.value, about(0.5 * t)) ** 2, count + 1
            hardest = max(hardest, norm(found.change))
    assert sqrt(square / count) < 2e-3
    assert hardest < 5.0


@pytest.mark.parametrize("noise", [0.0, 1e-3])
def test_a_new_sample_lets_the_reference_neither_jump_nor_change_its_pace(noise):
    found = [
        one
        for t, one in forecasts(
            lambda t: about(0.3 * sin(4.0 * t)), 30, 4.0, is_turn=True, noise=noise
        )
        if t > 1.0
    ]
    for before, after in pairwise(found):
        step = plus(ZERO, difference(before.value, after.value), 1.0 / PERIOD)
        mean = plus(plus(ZERO, before.rate, 0.5), after.rate, 0.5)
        assert norm(plus(step, mean, -1.0)) < 2e-4 + 10.0 * noise
        assert norm(plus(after.rate, before.rate, -1.0)) < PERIOD * (8.0 + 4e4 * noise)


def test_if_samples_become_older_than_ever_the_velocity_stays():
    samples, forecast = [], Forecast(PERIOD, is_turn=False)
    for k in range(60):
        t = k / 30
        samples.append(TimedValue(round(t * NS), (0.1 * sin(6.0 * t), 0.0, 0.0)))
        forecast.at(samples, k, samples[-1].time_ns + PERIOD_NS)
    found = [forecast.at(samples, 59, samples[-1].time_ns + n * PERIOD_NS) for n in range(2, 150)]
    assert all(one.change == ZERO for one in found[60:])
    assert all(one.rate == pytest.approx(found[-1].rate, abs=1e-6) for one in found[140:])
    assert abs(found[-1].value[0]) < 0.1 + 0.6 * 0.3


def test_a_sample_that_no_motion_explains_begins_another_one_at_rest():
    begun = []
    for t, found in forecasts(
        lambda t: (0.0 if t < 1.0 else 0.2, 0.0, 0.0), 50, 2.0, is_turn=False
    ):
        begun.append((t, found.value[0], found.rate))
    assert all(value in (0.0, 0.2) and rate == ZERO for _, value, rate in begun)


def test_a_late_sample_of_another_kind_does_not_count():
    forecast, samples, rate = Forecast(PERIOD, is_turn=True), [], plus(ZERO, AXIS, 0.5)
    for k in range(20):
        samples.append(TimedValue(round(k / 30 * NS), about(0.5 * k / 30), rate))
        forecast.at(samples, k, samples[-1].time_ns + PERIOD_NS)
    samples.insert(-2, TimedValue(samples[-2].time_ns - NS // 60, about(0.0), None))
    samples.append(TimedValue(samples[-1].time_ns + NS // 30, about(0.5 * 20 / 30), rate))
    found = forecast.at(samples, 20, samples[-1].time_ns + PERIOD_NS)
    assert found.rate == pytest.approx(rate, abs=1e-6)


def test_the_work_of_a_cycle_is_bounded(monkeypatch):
    counted, whole = [], kernels.fit_samples

    def fit_samples(samples, *others):
        counted.append(len(samples))
        whole(samples, *others)

    monkeypatch.setattr(kernels, "fit_samples", fit_samples)
    forecast, samples = Forecast(PERIOD, is_turn=False), []
    for k in range(1, 400):
        samples.append(TimedValue(k * PERIOD_NS, (1e-4 * k, 0.0, 0.0)))
        forecast.at(samples, k, k * PERIOD_NS)
    assert 100 < len(counted) < 200
    assert max(counted) == WINDOW


@pytest.mark.parametrize(("hertz", "size"), [(0.5, 0.5), (1.0, 0.3), (2.0, 0.1)])
@pytest.mark.parametrize("share", [1.05, 1.2, 1.5, 2.0])
@pytest.mark.parametrize("others", [1.0, 3.0])
def test_limits_just_above_a_swing_suffice_to_lock_on(hertz, size, share, others):
    # The stream begins in mid swing, 30 targets a second, each 2 ms late.
    spin = 2.0 * pi * hertz
    speed, hardest, jerk = (share * size * spin**k for k in (1, 2, 3))
    world = World(servo_limits(others * speed, others * hardest, jerk))
    begin_ns, sent, worst = world.now_ns, 0.37 / hertz, 0.0
    while world.now_ns < begin_ns + 8 * NS:
        while sent + 0.002 <= (world.now_ns - begin_ns) / NS:
            stamp_ns = begin_ns + round(sent * NS)
            assert world.take(about(size * sin(spin * sent)), None, stamp_ns, live=0.3) == ""
            sent += 1.0 / 30.0
        q, t = world.step().q, (world.now_ns - begin_ns) / NS
        if t > 5.0:
            worst = max(worst, angle(q, about(size * sin(spin * t))))
    assert worst < 0.05 * size
