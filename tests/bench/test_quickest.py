"""Durations of motions without times, compared with Ruckig, TOPP-RA, an even pace and stops."""

import logging
import os
import runpy
import time
from pathlib import Path

import numpy as np
import pytest
from connector_search import searched
from reference.ruckig_turn import fastest
from scipy.spatial.transform import Rotation

from orientd.planner import DEFAULT_LIMITS, Keyframe, Limits, MotionRequest, State, plan
from orientd.planner.timing.axis_turn import usable
from orientd.rotation import exp

pytestmark = [pytest.mark.bench, pytest.mark.timeout(900)]

PERIOD = 0.002
CONNECTORS = int(os.environ.get("ORIENTD_BENCH_CONNECTORS", "24"))
"""That are searched for, to rest and to a velocity; a second or two each."""

ARM = Limits(2.5, 17.0, 8500.0, 1.0, 10.0)


def keyframes(q):
    return [Keyframe(tuple(one)) for one in np.asarray(q).tolist()]


def made(q, limits=ARM, period=PERIOD, **fields):
    """Return the motion from rest at the first of some orientations through the others."""
    start = State.at_rest(tuple(np.asarray(q)[0].tolist()))
    return plan(MotionRequest(keyframes(q), **fields), start=start, limits=limits, period=period)


def through(random, count, size):
    """Return random orientations, each turned against the one before about a random axis."""
    turns = random.normal(size=(count, 3))
    turns *= (size * random.uniform(0.3, 1.0, count) / np.linalg.norm(turns, axis=1))[:, None]
    turned = [Rotation.random(random_state=int(random.integers(2**31)))]
    for turn in turns[1:]:
        turned.append(turned[-1] * Rotation.from_rotvec(turn))
    return Rotation.concatenate(turned).as_quat(scalar_first=True)


def shown(name, values):
    low, middle, high = np.percentile(values, [0, 50, 100])
    print(f"\n{name}: {len(values)}, least {low:.4f}, median {middle:.4f}, largest {high:.4f}")
    return middle, high


def axis_limits(random):
    velocity = 10.0 ** random.uniform(-0.5, 1.0)
    acceleration = velocity * random.uniform(2.0, 20.0)
    return Limits(velocity, acceleration, acceleration * random.uniform(10.0, 500.0), 1.0, 10.0)


@pytest.mark.parametrize("is_single", [True, False], ids=["one keyframe", "two"])
def test_about_one_axis_it_is_as_quick_as_ruckig(is_single):
    random = np.random.default_rng(1)
    ratios, beyond = [], []
    for _ in range(500):
        limits, turn = axis_limits(random), 10.0 ** random.uniform(-2.0, 0.49)
        period = float(random.choice([0.001, 0.002, 0.004, 0.008]))
        axis = random.normal(size=3)
        q = np.stack([exp(np.zeros(3)), exp(turn * axis / np.linalg.norm(axis))])
        full = limits.velocity, limits.acceleration, limits.jerk
        took = [fastest(turn, *used) for used in (full, usable(turn, *full))]
        start = State.at_rest(tuple(q[0].tolist()))
        request = MotionRequest(keyframes(q[is_single:]))
        duration = plan(request, start=start, limits=limits, period=period).duration
        ratios.append(duration / took[0])
        if duration > took[1] + max(1e-3 * took[1], period):
            beyond.append((ratios[-1], limits, turn, period))
    shown("duration over Ruckig's with all of the limits", ratios)
    assert not beyond  # of Ruckig's with the reserve for stops, by 0.1 % or one cycle


@pytest.mark.parametrize("rate", [125.0, 500.0, 2000.0])
def test_along_a_path_it_is_as_quick_as_toppra(rate):
    toppra = pytest.importorskip("toppra")
    logging.getLogger("toppra").setLevel(logging.ERROR)
    random = np.random.default_rng(2)
    most = {"velocity": [1.5, 1.2, 1.8], "acceleration": [4.0, 6.0, 5.0]}
    limits = DEFAULT_LIMITS.with_rates({**most, "jerk": float("inf")})
    ratios, failed = [], 0
    for _ in range(34):
        q = through(random, int(random.integers(3, 9)), 1.0)
        duration = made(q, limits, 1.0 / rate).duration
        segment = made(q, limits, 1.0 / rate, pace="even").path.trajectory

        class Curve(toppra.interpolator.AbstractGeometricPath):
            path_interval, dof, waypoints = segment.domain, 3, None

            def __call__(self, places, order=0, segment=segment):
                _, omega, alpha = segment.sample(np.atleast_1d(np.asarray(places, dtype=float)))
                rows = omega if order == 1 else alpha if order == 2 else 0.0 * omega
                return rows if np.ndim(places) else rows[0]

        ends = [
            kind(np.stack([-np.array(most[name]), np.array(most[name])], axis=1))
            for kind, name in (
                (toppra.constraint.JointVelocityConstraint, "velocity"),
                (toppra.constraint.JointAccelerationConstraint, "acceleration"),
            )
        ]
        points = np.linspace(*segment.domain, 3001)
        solver = toppra.algorithm.TOPPRA(ends, Curve(), gridpoints=points, solver_wrapper="seidel")
        _, speed, _ = solver.compute_parameterization(0.0, 0.0)
        if speed is None:
            # It does not leave rest where the path itself does.
            failed += 1
            continue
        ratios.append(duration / float(np.sum(2.0 * np.diff(points) / (speed[1:] + speed[:-1]))))
    print(f"\nTOPP-RA failed {failed} times")
    middle, largest = shown(f"duration over TOPP-RA's at {rate:g} Hz", ratios)
    assert middle <= 1.005
    assert largest <= 1.02


def test_with_jerk_limit_it_is_near_the_optimum_on_a_fine_grid():
    # By linear programs (HiGHS) on grids of the squared rate; see the file's own words.
    place = Path(__file__).parents[1] / "data/quickest/regenerate.py"
    optima = runpy.run_path(str(place))
    random = np.random.default_rng(6)
    ratios = []
    for case in range(20):
        q = through(random, int(random.integers(3, 6)), 1.0)
        rates = optima["LIMITS"][case % 2]
        motion = made(q, DEFAULT_LIMITS.with_rates(rates))
        segment = motion.path.trajectory
        nodes = 60 * (len(q) - 1) + 1
        coarse, fine = (
            optima["least_duration"](segment, rates, count) for count in (nodes, 2 * nodes - 1)
        )
        ratios.append(motion.duration / (fine + (fine - coarse) / 3.0))
    _, largest = shown("duration over the least on a fine grid", ratios)
    assert largest <= 1.02


def test_it_is_quicker_than_at_an_even_pace():
    random = np.random.default_rng(3)
    ratios = []
    for _ in range(300):
        q = through(random, int(random.integers(2, 12)), 10.0 ** random.uniform(-1.0, 0.4))
        ratios.append(made(q).duration / made(q, pace="even").duration)
    middle, largest = shown("duration over that at an even pace", ratios)
    assert middle <= 0.62
    assert largest <= 1.0


def test_keyframes_beside_one_another_cost_no_more_than_stops():
    random = np.random.default_rng(4)
    rising, over = [], []
    distances = [0.0, *10.0 ** np.arange(-12.0, 0.0)]
    for _ in range(154):
        q = through(random, int(random.integers(2, 7)), 1.0)
        place = int(random.choice([0, len(q) // 2, len(q) - 1]))
        axis = random.normal(size=3)
        axis /= np.linalg.norm(axis)
        least = 0.0
        durations = []
        for distance in distances:
            here = Rotation.from_quat(q[place], scalar_first=True)
            beside = (here * Rotation.from_rotvec(distance * axis)).as_quat(scalar_first=True)
            keys = np.insert(q, place + 1, beside, axis=0)
            durations.append(made(keys).duration)
            stops = sum(
                made(pair).duration
                for pair in (keys[k : k + 2] for k in range(len(keys) - 1))
                if abs(abs(pair[0] @ pair[1]) - 1.0) > 1e-15
            )
            over.append(durations[-1] / stops)
        for duration in durations:
            rising.append(least / duration)
            least = max(least, duration)
    _, most = shown("largest duration of nearer ones over that of a distance", rising)
    _, beyond = shown("duration over the sum of stops", over)
    assert most <= 1.1
    assert beyond <= 1.00001


@pytest.mark.parametrize("is_to_rest", [True, False], ids=["to rest", "to a velocity"])
def test_from_motion_to_a_keyframe_it_is_as_quick_as_a_search_of_connectors(is_to_rest):
    random = np.random.default_rng(8)
    kept = (
        Limits(2.5, 17.0, 300.0, 1.0, 10.0),
        Limits(2.5, 17.0, 300.0, 1.0, 10.0, axis_velocity=(2.0, 0.7, 1.5)),
    )
    ratios = []
    for number in range(CONNECTORS // 2):
        limits = kept[number % 2]
        # Every other one from rest to rest, where the velocity rises with all of the jerk.
        first = made(through(random, 4 if number % 4 < 2 else 2, 1.0), limits)
        record = int(random.integers(first.record_count // 10, 9 * first.record_count // 10))
        state = first.state_at(record)
        turn, omega = random.normal(size=(2, 3))
        turn *= random.uniform(0.1, 2.0) / np.linalg.norm(turn)
        omega *= 0.0 if is_to_rest else random.uniform(0.04, 0.6) / np.linalg.norm(omega)
        goal = Rotation.from_quat(state.q, scalar_first=True) * Rotation.from_rotvec(turn)
        goal = goal.as_quat(scalar_first=True)
        request = MotionRequest(keyframes(goal[None]), end_velocity=tuple(omega.tolist()))
        # Behind a keyframe that is passed it comes to rest.
        took = plan(request, start=state, limits=limits, period=PERIOD).end_time
        search = np.random.default_rng(number)
        ratios.append(took / searched(state, goal, omega, limits, search))
    _, largest = shown("duration over the best of 10,000 connectors", ratios)
    assert largest <= 1.05


def test_planning_takes_milliseconds():
    random = np.random.default_rng(5)

    def milliseconds(count, cases):
        taken = []
        for _ in range(cases):
            q = through(random, count, 0.4)
            start = State.at_rest((1.0, 0.0, 0.0, 0.0) if count == 1 else tuple(q[0].tolist()))
            request = MotionRequest(keyframes(q))
            for _ in range(2):
                begin = time.thread_time()
                plan(request, start=start, limits=ARM, period=PERIOD)
                last = time.thread_time() - begin
            taken.append(1e3 * last)
        return shown(f"ms of the thread to plan {count} keyframes", taken)[0]

    assert milliseconds(1, 50) <= 0.5
    assert milliseconds(20, 50) <= 5.0
    assert milliseconds(1000, 3) <= 250.0
