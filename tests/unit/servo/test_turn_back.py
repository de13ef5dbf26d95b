"""The slowest way to a place where the path turns back."""

import numpy as np
import pytest

from orientd.servo.path.segment import hermite
from orientd.servo.path.turn_back import TurnBackPoint

AXIS = (0.6, 0.0, 0.8)


def along(value):
    return tuple(value * x for x in AXIS)


def a_turn(speed, push):
    """Return the turn of a motion with constant acceleration along an axis, from its records."""
    turn, omega = TurnBackPoint(AXIS, 0), speed
    while not turn.is_found:
        turn.look(hermite(along(omega + 0.5 * push), along(omega), along(omega + push)))
        omega += push
    return turn


def a_way(speed, velocity, step):
    """Return how far a velocity and those after it lead while they are positive."""
    change, way = velocity - speed + step, 0.0
    while velocity > 0.0:
        way, velocity, change = way + velocity, velocity + change, change + step
        if change > 0.0 and velocity > 0.0:
            return np.inf
    return way


@pytest.mark.parametrize("push", [-0.0101, -0.03, -0.2, -1.7])
def test_the_turn_is_where_the_velocity_along_the_axis_is_zero(push):
    turn = a_turn(1.0, push)
    assert turn.place == pytest.approx(-1.0 / push, abs=1e-6)
    assert turn.way == pytest.approx(-0.5 / push, rel=1e-6)


def test_what_has_been_come_along_is_not_left():
    turn = a_turn(1.0, -0.1)
    piece = hermite(along(0.95), along(1.0), along(0.9))
    turn.come(piece.value(0.5))
    assert turn.way == pytest.approx(5.0 - 0.4875)


@pytest.mark.parametrize("step", [0.0, 1e-4, 3e-4, 1e-3])
@pytest.mark.parametrize("push", [-0.04, -0.07])
def test_the_slowest_way_leads_to_the_turn_and_a_slower_one_does_not(push, step):
    turn = a_turn(1.0, push)
    velocity = turn.slowest(1.0, step, 0.3)
    # All but what lies between the last setpoint and the turn.
    gap = abs(push)
    assert a_way(1.0, velocity, step) == pytest.approx(turn.way, abs=gap)
    assert a_way(1.0, velocity - 0.1 * gap, step) < turn.way - gap


def test_where_a_stop_is_possible_before_the_turn_nothing_leads_there():
    assert a_turn(1.0, -0.01).slowest(1.0, 0.01, 0.3) == 0.0


def test_a_turn_that_is_near_is_passed_as_it_comes():
    assert a_turn(1.0, -4.0).slowest(1.0, 0.001, 0.3) is None
    assert a_turn(1.0, -4.0).slowest(1.0, 0.001, 0.2) is not None
    assert a_turn(1.0, -4.0).slowest(-1.0, 0.001, 0.3) is None
