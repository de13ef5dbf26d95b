import numpy as np
import pytest

from orientd.servo.path.time_scaling import PathClock

H = 0.002


def rates(clock, cycles):
    return np.array([clock.advance() for _ in range(cycles)])


@pytest.mark.parametrize("brake_rate", [0.3, 1.0, 3.0, 10.0, 20.0])
def test_acceleration_and_jerk_of_the_rate_stay_bounded_whatever_is_asked(brake_rate):
    random = np.random.default_rng(3)
    clock = PathClock(H)
    clock.begin(brake_rate, 0.7)
    rate = [0.7, 0.7]
    for _ in range(20_000):
        if random.random() < 0.01:
            clock.target = float(random.choice([0.0, 1.0, random.random()]))
        rate.append(clock.advance())
    assert min(rate) >= 0.0
    assert max(rate) <= 1.0
    acceleration = np.diff(rate) / H
    assert np.abs(acceleration).max() <= 2 * brake_rate * (1 + 1e-9)
    assert np.abs(np.diff(acceleration) / H).max() <= 4 * brake_rate**2 * (1 + 1e-6)


@pytest.mark.parametrize("brake_rate", [0.3, 1.0, 10.0])
def test_a_stop_from_full_speed_takes_one_over_the_brake_rate(brake_rate):
    clock = PathClock(H)
    clock.begin(brake_rate, 1.0)
    clock.target = 0.0
    cycles = 0
    while not clock.is_at_rest:
        clock.advance()
        cycles += 1
    assert cycles * H == pytest.approx(1 / brake_rate, abs=2 * H)


def test_a_stop_uses_no_more_path_than_it_says():
    for brake_rate in (0.3, 2.0, 20.0):
        clock = PathClock(H)
        clock.begin(brake_rate, 0.5)
        clock.target = 1.0
        for _ in range(int(0.2 / brake_rate / H)):
            clock.advance()
        clock.target = 0.0
        assert rates(clock, int(3 / brake_rate / H)).sum() <= clock.braking_cycles
        assert clock.is_at_rest


def test_a_rate_that_is_reached_is_kept_exactly():
    clock = PathClock(H)
    clock.begin(4.0, 0.0)
    clock.target = 1.0
    rates(clock, 400)
    assert clock.rate == 1.0
    assert clock.acceleration == 0.0
