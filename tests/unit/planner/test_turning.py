"""Turning at a constant rate: taken up within the limits, held, left; never the other way."""

import math

import numpy as np
import pytest
from motions import read

from orientd import motion_file
from orientd.errors import LimitError, PlanError, RequestError
from orientd.model.limits import Limits
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.rotation import conjugate, exp, log, multiply, rotate

LIMITS = Limits(1.5, 8.0, 1500.0, 1.0, 10.0)
START = State.at_rest(exp([0.3, -0.5, 0.9]))
PERIOD = 0.01


def turned(rate, duration, limits=LIMITS, **others):
    request = motion_file.parse({"rate": rate, "duration": duration, **others})
    return plan(read(request), start=START, limits=limits, period=PERIOD)


@pytest.mark.parametrize("rate", [[0, 0, 0.05], [0, 0, -1.4], [0.3, -0.4, 0.5]])
@pytest.mark.parametrize("frame", ["body", "world"])
def test_a_rate_is_held_for_the_duration_and_never_turned_against(rate, frame):
    motion = turned(rate, 4.0, velocity_frame=frame)
    samples = motion.sample(PERIOD * np.arange(motion.record_count))
    omega = samples.omega_body if frame == "body" else rotate(samples.q, samples.omega_body)
    unit = np.array(rate) / np.linalg.norm(rate)
    along = omega @ unit
    assert np.min(along) > -1e-9
    assert np.max(np.linalg.norm(omega - along[:, None] * unit, axis=1)) < 1e-9
    held = slice(math.ceil(motion.start_time / PERIOD), int(motion.end_time / PERIOD) + 1)
    assert motion.end_time - motion.start_time == pytest.approx(4.0, abs=PERIOD)
    assert omega[held] == pytest.approx(np.broadcast_to(rate, omega[held].shape), abs=1e-9)
    assert samples.q[0] == pytest.approx(START.q, abs=1e-12)
    assert (np.linalg.norm(omega[0]), np.linalg.norm(omega[-1])) == pytest.approx((0, 0), abs=1e-9)
    # Not longer than taking up the rate needs at half the acceleration, twice.
    assert motion.duration < 4.0 + 2 * (1.875 * np.linalg.norm(rate) / 4.0) + 0.3


def test_many_turns_are_counted():
    motion = turned([0, 0, 1.0], 60.0)
    q = motion.sample(np.arange(motion.start_time, motion.end_time, 0.1)).q
    steps = log(multiply(conjugate(q[:-1]), q[1:]))
    assert np.sum(steps[:, 2]) == pytest.approx(60.0, abs=0.2)


def test_a_turn_goes_on_at_the_rate_that_is_there():
    first = turned([0, 0, -1.2], 20.0)
    start = first.path.state(PERIOD * 700)
    request = motion_file.parse({"rate": [0, 0, -1.2], "duration": 20.0})
    motion = plan(request, start=start, limits=LIMITS, period=PERIOD)
    assert motion.start_time == 0.0
    omega = motion.sample(PERIOD * np.arange(round(motion.end_time / PERIOD))).omega_body
    assert omega == pytest.approx(np.broadcast_to([0, 0, -1.2], omega.shape), abs=1e-9)


@pytest.mark.parametrize("rate", [1.6, -1.6, 1e9])
def test_a_rate_above_the_limit_is_refused_before_it_is_planned(rate):
    with pytest.raises(LimitError, match=r"^angular velocity reaches .*; rate asks for it$"):
        turned([0, 0, rate], 60.0)


def test_a_turn_of_days_is_refused_before_it_is_planned():
    with pytest.raises(PlanError, match="at most 86400 s is planned"):
        turned([0, 0, 1.0], 1e12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rate": [0, 0, 0]}, "rate: expected a velocity to turn with"),
        ({"duration": None}, "duration: expected the seconds"),
        ({"duration": "minimum"}, "duration: expected the seconds"),
        ({"rate": [0, 0]}, "rate: expected"),
        ({"end_velocity": [0, 0, 1]}, "end_velocity: a turn at a rate ends at rest"),
        ({"keyframes": [{"quaternion": {"w": 1, "x": 0, "y": 0, "z": 0}}] * 2}, "give no keyframe"),
    ],
)
def test_what_makes_no_turn_is_named(change, message):
    with pytest.raises(RequestError, match=message):
        turned(**{"rate": [0, 0, 0.5], "duration": 2.0, **change})


def test_a_motion_without_keyframes_and_rate_is_none():
    with pytest.raises(RequestError, match="keyframes"):
        motion_file.parse({"duration": 2.0})


def test_whole_turns_to_a_direction_go_about_the_axis_of_the_least_roll():
    request = motion_file.parse({"keyframes": [{"direction": [0, 1, 0], "turns": 1}]})
    motion = plan(request, start=START, limits=LIMITS, period=PERIOD)
    samples = motion.sample(PERIOD * np.arange(motion.record_count))
    points = rotate(START.q, [1.0, 0.0, 0.0])
    least = np.cross(points, [0.0, 1.0, 0.0])
    omega = rotate(samples.q, samples.omega_body)
    assert np.abs(np.cross(omega, least / np.linalg.norm(least))).max() < 1e-9
    turned = PERIOD * float(np.linalg.norm(omega, axis=1).sum())
    assert turned == pytest.approx(2.0 * np.pi + np.arccos(points[1]), abs=1e-3)
    assert rotate(samples.q[-1], [1.0, 0.0, 0.0]) == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
