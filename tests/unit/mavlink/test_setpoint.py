"""The path of a MAVLink gimbal's setpoint: even along a stream, and never past its end."""

import math

import numpy as np
import pytest

pytest.importorskip("pymavlink")

from orientd_mavlink.setpoint import (
    PITCH_LOCK,
    ROLL_LOCK,
    STEP,
    UNSET,
    Setpoint,
    Wish,
    angles_of,
    mirrored,
)

LEVEL = ROLL_LOCK | PITCH_LOCK
ACCELERATION = 2.5


@pytest.fixture
def setpoint():
    return Setpoint(0.0, speed=2.5, acceleration=ACCELERATION)


def moved(setpoint, seconds):
    """Return the yaws of a setpoint while it moves, degrees."""
    yaws = []
    for _ in range(round(seconds / STEP)):
        setpoint.advance(STEP)
        yaws.append(math.degrees(angles_of(mirrored(setpoint.orientation()))[2]))
    return yaws


def stream(setpoint, rate, gap, seconds):
    """Return the yaws along a stream of angles whose rate is *rate*, degrees/s, and at its end."""
    yaws = []
    for k in range(1, round(seconds / gap) + 1):
        setpoint.take(Wish(LEVEL, (0.0, 0.0, math.radians(rate * k * gap))), gap)
        yaws += moved(setpoint, gap)
    return np.array(yaws), np.array(moved(setpoint, 4.0))


@pytest.mark.parametrize(("rate", "gap"), [(5, 0.1), (20, 0.1), (30, 0.04), (60, 0.02)])
def test_a_stream_is_followed_evenly_and_ends_at_its_last_angle(setpoint, rate, gap):
    yaws, rest = stream(setpoint, rate, gap, 3.0)
    steady = np.diff(yaws[len(yaws) // 2 :]) / STEP
    assert 0.6 * rate < steady.min() < steady.max() < 1.4 * rate
    # It is behind by no more than its brake and two messages.
    brake = math.degrees(math.radians(rate) ** 2 / (1.6 * ACCELERATION))
    assert 3.0 * rate - yaws[-1] < 1.5 * brake + 2.0 * rate * gap
    assert rest.max() < 3.0 * rate + 0.05
    assert rest[-1] == pytest.approx(3.0 * rate, abs=1e-9)


def test_a_goal_at_any_speed_is_not_passed(setpoint):
    setpoint.take(Wish(LEVEL, (0.0, 0.0, math.radians(90.0))))
    yaws = moved(setpoint, 6.0)
    assert max(yaws) < 90.01
    assert not setpoint.is_moving
    accelerations = np.diff(np.radians(yaws), 2) / STEP**2
    # The last step to the goal may brake harder than the others.
    assert np.abs(accelerations).max() < 2.0 * ACCELERATION


def test_a_turn_at_a_rate_brakes_when_its_rate_ends(setpoint):
    setpoint.take(Wish(LEVEL, UNSET, (math.nan, math.nan, math.radians(40.0))))
    yaws = moved(setpoint, 2.0)
    assert np.diff(yaws)[-10:] / STEP == pytest.approx(40.0)
    assert setpoint.rest()
    assert not setpoint.rest()
    rest = moved(setpoint, 2.0)
    assert max(rest) - yaws[-1] < 8.0
    assert not setpoint.is_moving


def test_a_goal_takes_the_shorter_way_round(setpoint):
    setpoint.take(Wish(LEVEL, (0.0, 0.0, math.radians(170.0))))
    moved(setpoint, 5.0)
    setpoint.take(Wish(LEVEL, (0.0, 0.0, math.radians(-170.0))))
    yaws = moved(setpoint, 5.0)
    assert all(abs(yaw) > 169.9 for yaw in yaws)
    assert yaws[-1] == pytest.approx(-170.0)
