"""Positions of targets are followed inside the linear limits; without them, they come to rest."""

from dataclasses import replace
from math import cos, sin

import numpy as np
import pytest
from rig import PERIOD, TERMS, Rig
from setpoint_checker import reached

from orientd.stream.records import NOT_GIVEN, Answer, Command, ServoState

NOWHERE = (1.0, 0.0, 0.0, 0.0)
ALONG = np.array([0.6, 0.0, 0.8])


def tracking(**limits):
    rig = Rig()
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    assert rig.ask(Command.TRACK, servo_limits=replace(TERMS, **limits))[0] is Answer.DONE
    return rig


def aim(rig, position, *, lives_ns=500_000_000):
    now = rig.clock.now_ns()
    rig.memory.targets.publish(now, now + lives_ns, *NOWHERE, *NOT_GIVEN, *map(float, position))


def placed(rig):
    return np.array([s.position for s in rig.driver.setpoints])


def keeps_limits(rig, limits=TERMS):
    """Stop, and look at everything from rest to rest."""
    rig.ask(Command.STOP)
    rig.run_until(lambda servo: not servo.is_moving)
    setpoints = rig.driver.setpoints
    found = reached([s.q for s in setpoints], [s.position for s in setpoints], PERIOD)
    return all(size <= 1.001 * getattr(limits, name) for name, size in found.items())


def test_a_position_is_reached_in_about_the_least_time_without_overshoot():
    rig = tracking()
    for _ in range(30):
        aim(rig, 0.3 * ALONG)
        rig.run(20)
    along = placed(rig) @ ALONG
    assert along.max() < 0.3 + 1e-3
    assert along[-1] == pytest.approx(0.3, abs=1e-4)
    # With 1 m/s and 10 m/s^2 the least is 0.4 s.
    assert np.argmax(along > 0.297) * PERIOD < 0.8
    assert keeps_limits(rig)


@pytest.mark.parametrize("every", [3, 16])
def test_a_moving_position_is_followed_without_lag(every):
    rig = tracking()
    for k in range(1500):
        if k % every == 0:
            aim(rig, 0.4 * k * PERIOD * ALONG)
        rig.run()
        if k > 500:
            # Setpoints are due at the end of their cycles.
            assert rig.driver.setpoints[-1].position @ ALONG == pytest.approx(
                0.4 * k * PERIOD, abs=1.5e-3
            )
    assert keeps_limits(rig)


def test_a_position_that_is_no_longer_given_comes_to_rest():
    rig = tracking()
    for k in range(300):
        aim(rig, 0.5 * k * PERIOD * ALONG)
        rig.run()
    for _ in range(20):
        aim(rig, NOT_GIVEN)
        rig.run(10)
    assert rig.driver.setpoints[-1].velocity == (0.0, 0.0, 0.0)
    assert rig.cycle.state is ServoState.TRACKING
    assert keeps_limits(rig)


def test_a_position_and_an_orientation_swing_together():
    rig = tracking()
    for k in range(1500):
        t = k * PERIOD
        if k % 8 == 0:
            now = rig.clock.now_ns()
            q = (cos(0.2 * sin(3 * t)), sin(0.2 * sin(3 * t)), 0.0, 0.0)
            p = 0.1 * sin(3 * t) * ALONG
            rig.memory.targets.publish(now, now + 10**9, *q, *NOT_GIVEN, *map(float, p))
        rig.run()
        if k > 500:
            last = rig.driver.setpoints[-1]
            assert last.position @ ALONG == pytest.approx(0.1 * sin(3 * t), abs=3e-3)
            assert 2 * last.q[1] == pytest.approx(2 * sin(0.2 * sin(3 * t)), abs=3e-3)
    assert keeps_limits(rig)


@pytest.mark.parametrize("share", [1.05, 1.2])
def test_a_swinging_position_is_locked_on_with_limits_just_above_its_motion(share):
    size, pace = 0.1, np.pi
    most = size * pace
    rig = tracking(linear_velocity=share * most, linear_acceleration=share * most * pace)
    for k in range(2500):
        if k % 16 == 0:
            aim(rig, size * sin(pace * k * PERIOD) * ALONG)
        rig.run()
        if k > 1000:
            apart = rig.driver.setpoints[-1].position @ ALONG - size * sin(pace * k * PERIOD)
            assert abs(apart) < 0.05 * size
