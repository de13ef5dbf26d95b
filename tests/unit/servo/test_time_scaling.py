import numpy as np
import pytest

from orientd.servo.path.time_scaling import TimeScaling

H = 0.002


def rates(clock, cycles):
    return np.array([clock.advance() for _ in range(cycles)])


@pytest.mark.parametrize("brake_rate", [0.3, 1.0, 3.0, 10.0, 20.0])
def test_acceleration_and_jerk_of_the_rate_stay_bounded_whatever_is_asked(brake_rate):
    random = np.random.default_rng(3)
    clock = TimeScaling(H)
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
    clock = TimeScaling(H)
    clock.begin(brake_rate, 1.0)
    clock.target = 0.0
    cycles = 0
    while not clock.is_at_rest:
        clock.advance()
        cycles += 1
    assert cycles * H == pytest.approx(1 / brake_rate, abs=2 * H)


@pytest.mark.parametrize("brake_rate", [0.3, 2.0, 20.0])
def test_it_tells_its_brake_rate_and_the_records_of_a_stop(brake_rate):
    clock = TimeScaling(H)
    assert (clock.rate, clock.braking_cycles) == (0.0, 0)
    clock.begin(brake_rate, 1.0)
    assert clock.brake_rate == brake_rate
    assert clock.braking_cycles == np.ceil(1.0 / (brake_rate * H)) + 2


@pytest.mark.parametrize(("begin", "target"), [(0.0, 1.0), (1.0, 0.0), (0.2, 0.3), (0.9, 0.85)])
@pytest.mark.parametrize("brake_rate", [0.5, 4.0, 9.7])
def test_a_change_from_a_steady_rate_is_quick_and_goes_one_way(brake_rate, begin, target):
    clock = TimeScaling(H)
    clock.begin(brake_rate, begin)
    clock.target = target
    found = [begin]
    while not clock.is_steady:
        found.append(clock.advance())
    # Up and down at the largest jerk: the square root of the change over the brake rate.
    quickest = np.sqrt(abs(target - begin)) / brake_rate / H
    assert quickest - 1 <= len(found) - 1 <= quickest + 3
    assert found[-1] == target
    assert (np.diff(found) * np.sign(target - begin) >= 0.0).all()
    half = found[len(found) // 2]
    assert half == pytest.approx(0.5 * (begin + target), abs=3.0 * abs(target - begin) / quickest)


# The last is hardly less than the acceleration may change by in a cycle.
@pytest.mark.parametrize("change", [1e-15, -1e-13, 1e-11, -1e-9, 1e-6, 0.995 * 64.0 * H**2])
def test_a_change_however_small_is_made(change):
    clock = TimeScaling(H)
    clock.begin(4.0, 0.5)
    clock.target = 0.5 + change
    found = rates(clock, 4)
    assert (np.diff([0.5, *found]) * np.sign(change) >= 0.0).all()
    assert found[-1] == clock.target
    assert clock.is_steady


def test_planned_rates_are_taken_before_its_own():
    clock = TimeScaling(H)
    clock.begin(4.0, 1.0)
    clock.plan = [0.2, 0.0, 0.99]
    assert clock.advance() == 0.99
    assert clock.acceleration == pytest.approx(-0.01 / H)
    assert (clock.advance(), clock.acceleration) == (0.0, 0.0)
    assert (clock.advance(), clock.plan, clock.moves) == (0.2, [], 4)
