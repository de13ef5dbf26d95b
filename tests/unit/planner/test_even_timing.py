"""How long a keyframe path takes at its own pace, from its records."""

from dataclasses import replace

import numpy as np
import pytest
from planned import LIMITS, rotations

from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.job import PlanJob
from orientd.planner.path import Path
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.planner.timing import even
from orientd.planner.timing.even import evenly_paced, excess
from orientd.planner.timing.knots import Knots
from orientd.rotation import conjugate, log, multiply

ARM = LIMITS["arm"]
PERIOD = 0.002


def request(count=400, seed=9, **fields):
    q = rotations(np.random.default_rng(seed), count, 0.2)
    return MotionRequest([Keyframe(key) for key in q], pace="even", **fields)


def keyframe_path(asked, duration, end_velocity=None):
    times = np.linspace(0.0, 1.0, len(asked.keys))
    asked = replace(asked, end_velocity=end_velocity)
    position = (0.0, 0.0, 0.0) if asked.positions is None else asked.positions[0]
    job = PlanJob.of(asked, State.at_rest(asked.keys[0], position), ARM, PERIOD)
    return job.path(Knots(times, np.arange(len(times))), duration)


@pytest.mark.parametrize("method", ["c2_cumulative", "kks_hermite_spline"])
def test_what_the_spots_say_is_about_what_all_records_say(method):
    made = keyframe_path(request(method=method), 100.0)
    spread = made.duration / (32 * 399)
    limits = ARM.with_reserve()
    assert excess(made, limits, spread) == pytest.approx(excess(made, limits, PERIOD), rel=0.02)


def test_the_fewest_cycles_just_keep_the_limits():
    made, reserved = keyframe_path(request(), 100.0), ARM.with_reserve()
    found = evenly_paced(made, ARM, PERIOD, intervals=399)
    assert 0.999 < excess(found, reserved, PERIOD) <= 1.0
    beyond = made.slowed(int(0.998 * found.duration / PERIOD) * PERIOD)
    assert excess(beyond, reserved, PERIOD) > 1.0


@pytest.mark.parametrize("wrong", [0.3, 0.9, 1.1, 3.0])
def test_a_peak_that_the_spots_have_missed_is_found_in_the_end(monkeypatch, wrong):
    asked = request()
    start = State.at_rest(asked.keys[0])
    right = plan(asked, start=start, limits=ARM, period=PERIOD)
    known = even.excess

    def blind(path, limits, period):
        return known(path, limits, period) * (wrong if period > PERIOD else 1.0)

    monkeypatch.setattr(even, "excess", blind)
    motion = plan(asked, start=start, limits=ARM, period=PERIOD)
    assert motion.duration == pytest.approx(right.duration, rel=1e-3)
    assert motion.certificate.peak_acceleration.planned_ratio <= 1.0


LIMITED = {
    "none in particular": ARM,
    "the jerk": ARM.with_rates({"jerk": 20.0}),
    "the position": Limits(2.5, 17.0, 300.0, 0.02, 10.0),
    "the push of the position": Limits(2.5, 17.0, 300.0, 1.0, 0.01),
    "the axes": DEFAULT_LIMITS.with_rates({"velocity": [2.0, 0.2, 1.5], "jerk": 300.0}),
}


def shares_of(q, position, limits):
    """Return the largest shares of the limits of each order: of velocities, accelerations, jerk."""
    rates = [log(multiply(conjugate(q[:-1]), q[1:])) / PERIOD]
    rates += [np.diff(rates[0], k, axis=0) / PERIOD**k for k in (1, 2)]
    shares = []
    for name, rate in zip(("velocity", "acceleration", "jerk"), rates, strict=True):
        norm = np.linalg.norm(rate, axis=1).max() / getattr(limits, name)
        shares.append(max(norm, (np.abs(rate).max(axis=0) / limits.axes(name)).max()))
    for k, name in enumerate(("linear_velocity", "linear_acceleration")):
        move = np.diff(position, k + 1, axis=0) / PERIOD ** (k + 1)
        shares[k] = max(shares[k], np.linalg.norm(move, axis=1).max() / getattr(limits, name))
    return shares


def with_positions():
    random = np.random.default_rng(4)
    places = random.uniform(-0.2, 0.2, (6, 3)).tolist()
    keys = rotations(random, 6, 0.3)
    return [Keyframe(key, position=tuple(at)) for key, at in zip(keys, places, strict=True)]


@pytest.mark.parametrize("limits", LIMITED.values(), ids=LIMITED)
def test_a_path_takes_no_longer_than_its_tightest_limit_asks_for(limits):
    keyframes = with_positions()
    start = State.at_rest(keyframes[0].q, keyframes[0].position)
    motion = plan(MotionRequest(keyframes, pace="even"), start=start, limits=limits, period=PERIOD)
    sent = motion.sample(PERIOD * np.arange(motion.record_count))
    assert 0.94 < max(shares_of(sent.q, sent.position, limits)) <= 1.001


@pytest.mark.parametrize("limits", LIMITED.values(), ids=LIMITED)
def test_a_path_should_take_longer_by_the_factor_that_its_records_show(limits):
    made = keyframe_path(MotionRequest(with_positions()), 4.0)
    sent = Path(made.trajectory, made.positions).sample(PERIOD * np.arange(2001))
    shares = shares_of(sent.q, sent.position, limits)
    expected = max(share ** (1.0 / (1 + order)) for order, share in enumerate(shares))
    assert excess(made, limits, PERIOD) == pytest.approx(expected, rel=5e-3)


def test_an_even_pace_keeps_the_limits_next_to_a_velocity_at_the_end():
    asked, ends = request(6), (0.2, -0.3, 0.1)
    start = State.at_rest(asked.keys[0])
    motion = plan(replace(asked, end_velocity=ends), start=start, limits=ARM, period=PERIOD)
    assert motion.certificate.notes == ()
    sent = motion.sample(PERIOD * np.arange(motion.record_count))
    assert 0.3 < max(shares_of(sent.q, sent.position, ARM)) <= 1.001
    assert motion.sample([motion.end_time]).omega_body[0] == pytest.approx(ends, abs=1e-9)
