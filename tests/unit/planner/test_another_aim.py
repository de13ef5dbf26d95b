"""An aim on the way, while a motion rises to a limit, and the same again while it arrives."""

import numpy as np
import pytest

from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.connect.connector import connector
from orientd.planner.job import TAKE_OVER_SHARE
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import exp

NORMS = Limits(2.5, 17.0, 300.0, 1.0, 10.0)
SLOW = Limits(2.0, 10.0, 100.0, 1.0, 10.0)
ALL_AXES = SLOW.with_rates(
    {"velocity": [1.2, 1.0, 1.5], "acceleration": [8.0, 5.0, 7.0], "jerk": [80.0, 60.0, 70.0]}
)
LIMITS = [
    (NORMS, 1.03),
    (NORMS.with_rates({"velocity": [2.0, 0.7, 1.5]}), 1.03),
    (SLOW, 1.03),
    (ALL_AXES, 1.08),
]
TURNS = [((0.0, 0.0, 1.0), (0.5, 0.0, 0.3)), ((0.3, 0.6, -0.8), (-0.3, -0.6, 0.8))]
PERIOD = 0.002


def turned(turn, start, limits, period=PERIOD):
    goal = Keyframe(tuple(exp(np.array(turn)).tolist()))
    return plan(MotionRequest([goal]), start=start, limits=limits, period=period)


@pytest.mark.parametrize(("limits", "most"), LIMITS)
@pytest.mark.parametrize(("turn", "aim"), TURNS)
def test_who_waits_for_a_cycle_gains_nothing(limits, most, turn, aim):
    first = turned(turn, State.at_rest(np.array([1.0, 0.0, 0.0, 0.0])), limits)
    rising = range(5, first.record_count // 2)
    took = np.array([turned(aim, first.state_at(k), limits).duration for k in rising])
    assert np.all(took[:-1] <= most * (took[1:] + PERIOD))


@pytest.mark.parametrize("limits", [NORMS, SLOW, DEFAULT_LIMITS])
@pytest.mark.parametrize("turn", [(0.0, 0.0, 0.4), (0.3, 0.8, 0.4)])
def test_who_is_given_the_same_aim_again_arrives_hardly_later(limits, turn):
    motion = turned(turn, State.at_rest(np.array([1.0, 0.0, 0.0, 0.0])), limits)
    for record in range(5, motion.record_count - 4, 3):
        left = (motion.record_count - 1 - record) * PERIOD
        again = turned(turn, motion.state_at(record), limits)
        assert again.duration <= left + 0.15 * max(left, 0.1), record


def rising_state(share):
    """Return a state from which the velocity rises to a *share* of its limit, and no further."""
    axis = np.array([0.6, 0.0, 0.8])
    size = 8.2155
    omega = share * SLOW.velocity - size**2 / (2.0 * SLOW.jerk)
    q = np.array([1.0, 0.0, 0.0, 0.0])
    return State(q, omega * axis, size * axis, np.zeros(3))


@pytest.mark.parametrize("share", [0.9, 0.97, 0.9989])
def test_an_acceleration_just_below_the_limit_of_the_velocity_falls_in_time(share):
    motion = turned((0.6, 0.3, 1.5), rising_state(share), SLOW)
    times = np.linspace(0.0, motion.duration, 2000)
    found = motion.sample(times)
    assert np.linalg.norm(found.omega_body, axis=1).max() <= SLOW.velocity
    assert np.linalg.norm(found.alpha_body, axis=1).max() <= SLOW.acceleration
    jerk = np.diff(found.alpha_body, axis=0) / np.diff(times)[:, None]
    assert np.linalg.norm(jerk, axis=1).max() <= SLOW.jerk


def test_an_acceleration_that_may_go_on_does():
    state, goal = rising_state(0.9), State.at_rest(exp(np.array([0.6, 0.3, 1.5])))
    within = SLOW.with_reserve(TAKE_OVER_SHARE)
    segment = connector(state, goal, limits=within, own=within, period=PERIOD)
    # Where the acceleration falls first, it takes 1.296 s.
    assert segment.duration < 1.28
