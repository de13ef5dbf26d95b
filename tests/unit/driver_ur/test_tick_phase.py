"""Deadlines against the controller's own cycle, in virtual time."""

import random

import pytest

from orientd.servo.process import LARGEST_SHIFT
from orientd_ur.controller import tick_ns
from orientd_ur.timing import AIM, TickPhase

TICK = 2_000_000
PERIOD = 2_000_000


def phases(*, begin, drift=0.0, jitter_ns=0, seconds=4.0, every=20):
    """Run deadlines against a controller whose clock drifts; return each one's phase in ticks."""
    generator, lock = random.Random(3), TickPhase(TICK, PERIOD)
    deadline, package, found = 10**12 + begin, 0, []
    while len(found) < seconds * 1e9 / PERIOD:
        # The controller's packages so far, of which every 20th has a timestamp for us.
        while (ticked := 10**12 + round(package * TICK * (1.0 + drift))) < deadline:
            if package % every == 0:
                late = generator.expovariate(1.0 / jitter_ns) if jitter_ns else 0.0
                lock.hear(100.0 + package * 0.002, min(deadline, ticked + round(late)))
            package += 1
        found.append((deadline - ticked) / TICK % 1.0)
        most = PERIOD // LARGEST_SHIFT
        deadline += PERIOD + max(-most, min(most, lock.shift_ns(deadline)))
    return found


@pytest.mark.parametrize("begin", [0, 100_000, 499_000, 501_000, 1_000_000, 1_499_000, 1_999_000])
def test_deadlines_settle_a_quarter_of_a_cycle_behind_the_data(begin):
    found = phases(begin=begin)
    assert found[-1] == pytest.approx(AIM, abs=0.001)
    # The shorter way round: never through the moment that is to be avoided, unless it began there.
    assert max(abs(phase - AIM) for phase in found[1:]) <= max(abs(found[0] - AIM), 0.5) + 1e-3


@pytest.mark.parametrize("drift", [-1e-4, -2e-5, 2e-5, 1e-4])
def test_drift_of_the_controllers_clock_is_followed_through_jitter(drift):
    found = phases(begin=1_200_000, drift=drift, jitter_ns=100_000, seconds=60.0)
    assert all(abs(phase - AIM) < 0.1 for phase in found[1000:])


def test_deadlines_stay_where_there_is_no_phase_to_keep():
    lock = TickPhase(TICK, 2_500_000)
    lock.hear(100.0, 10**12)
    assert lock.shift_ns(10**12 + 10**6) == 0
    assert TickPhase(TICK, PERIOD).shift_ns(10**12) == 0


def test_cycle_is_that_of_the_robots_generation():
    assert tick_ns((3, 15)) == 8_000_000
    assert tick_ns((5, 12)) == tick_ns((10, 10)) == 2_000_000
