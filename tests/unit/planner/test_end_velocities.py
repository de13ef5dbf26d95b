"""Velocities at the ends: never a reason to refuse, nor to take longer than single moves do.

A chain of single moves rests at every keyframe in between.  Each move is a motion of the planner's
own, so together they are an upper bound of what a motion takes.  ``ORIENTD_CASES`` sets how many
random requests are planned for each set of limits.
"""

import os
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from orientd.errors import PlanError
from orientd.model.limits import DEFAULT_LIMITS, Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State

PERIOD = 0.002
CASES = int(os.environ.get("ORIENTD_CASES", "5"))
SLOWER = 1.05
DURATIONS = (1.05, 1.3, 2.0)

AXES = DEFAULT_LIMITS.with_rates(
    {"velocity": [2.0, 2.0, 0.2], "acceleration": [8.0, 8.0, 2.0], "jerk": [400.0, 400.0, 100.0]}
)
LIMITS = {
    "default": DEFAULT_LIMITS,
    "arm": Limits(1.5, 8.0, 400.0, 1.0, 10.0),
    "little jerk": Limits(3.0, 30.0, 30.0, 1.0, 10.0),
    "little acceleration": Limits(10.0, 0.5, 5.0, 1.0, 10.0),
    "axes": AXES,
}


def quaternions(vectors):
    rotations = Rotation.from_rotvec(np.array(vectors, dtype=float))
    return [tuple(q) for q in rotations.as_quat(scalar_first=True).tolist()]


def planned(keys, ends, limits, **fields):
    """Return the motion through *keys* with velocities at its ends, from rest at the first."""
    request = MotionRequest(
        [Keyframe(q) for q in keys],
        start_velocity=ends[0],
        end_velocity=ends[1],
        approach=ends[0] is not None,
        **fields,
    )
    return plan(request, start=State.at_rest(keys[0]), limits=limits, period=PERIOD)


def chain(keys, ends, limits):
    """Return what single moves with the same ends take, at rest in between, s."""
    zero, start, total = np.zeros(3), State.at_rest(keys[0]), 0.0

    def go(q, **fields):
        request = MotionRequest([Keyframe(q)], **fields)
        return plan(request, start=start, limits=limits, period=PERIOD)

    if ends[0] is not None:
        total = go(keys[0], end_velocity=ends[0]).end_time
        start = State(np.array(keys[0]), np.array(ends[0]), zero, zero)
    for q in keys[1:-1]:
        total, start = total + go(q).duration, State.at_rest(q)
    return total + go(keys[-1], end_velocity=ends[1]).duration


def check(motion, keys, ends, limits):
    """Hold all records against the limits, and the keyframes and velocities against the request."""
    q = motion.sample(PERIOD * np.arange(motion.record_count)).q
    before = [q[0]] * 3 if motion.before is None else motion.before[0]
    held = np.concatenate([before, q, [q[-1]] * 3])
    turned = Rotation.from_quat(held, scalar_first=True)
    rates = [(turned[:-1].inv() * turned[1:]).as_rotvec() / PERIOD]
    for _ in range(2):
        rates.append(np.diff(rates[-1], axis=0) / PERIOD)
    for rate, name in zip(rates, ("velocity", "acceleration", "jerk"), strict=True):
        assert np.linalg.norm(rate, axis=1).max() <= getattr(limits, name) * 1.00001
        assert np.all(np.abs(rate).max(axis=0) <= np.array(limits.axes(name)) * 1.00001)
    at = motion.sample(motion.keyframe_times)
    there = Rotation.from_quat(at.q, scalar_first=True)
    wanted = Rotation.from_quat(np.array(keys), scalar_first=True)
    assert (there.inv() * wanted).magnitude().max() < 1e-9
    for omega, end in zip(ends, (0, -1), strict=True):
        expected = np.zeros(3) if omega is None else np.array(omega)
        assert np.linalg.norm(at.omega_body[end] - expected) < 1e-9
        # From the orientations alone, on either side.
        for step in (1e-5, -1e-5):
            times = motion.keyframe_times[end] + step * np.arange(3.0)
            if times.min() >= 0.0 and times.max() <= motion.duration:
                near = Rotation.from_quat(motion.sample(times).q, scalar_first=True)
                one, two = (near[0].inv() * near[1:]).as_rotvec()
                found = (4.0 * one - two) / (2.0 * step)
                assert np.linalg.norm(found - expected) < 1e-4


def direction(random):
    vector = random.normal(size=3)
    return vector / np.linalg.norm(vector)


def velocity(random, limits):
    along = direction(random)
    most = min(limits.velocity, *(np.array(limits.axis_velocity) / np.abs(along)))
    return tuple((along * most * random.uniform(0.1, 0.95)).tolist())


def random_case(random, limits):
    """Return keyframes, and velocities at one end or both."""
    count = int(random.integers(2, 21 if random.random() < 0.6 else 5))
    largest, keys = 10.0 ** random.uniform(-2.5, 0.49), [Rotation.identity()]
    for _ in range(count - 1):
        is_like = random.random() < 0.5
        step = (
            largest * random.uniform(0.3, 1.0) if is_like else 10.0 ** random.uniform(-2.52, 0.491)
        )
        keys.append(keys[-1] * Rotation.from_rotvec(direction(random) * max(step, 0.003)))
    moves = [(True, False), (False, True), (True, True)][int(random.integers(3))]
    ends = [velocity(random, limits) if is_moving else None for is_moving in moves]
    return [tuple(q.as_quat(scalar_first=True).tolist()) for q in keys], ends


@pytest.mark.parametrize("name", LIMITS)
def test_no_request_is_refused_or_slower_than_single_moves(name):
    limits, random = LIMITS[name], np.random.default_rng(11)
    for case in range(CASES):
        keys, ends = random_case(random, limits)
        most = chain(keys, ends, limits)
        motion = planned(keys, ends, limits)
        assert motion.duration <= SLOWER * most, case
        check(motion, keys, ends, limits)


@pytest.mark.parametrize("name", LIMITS)
def test_a_duration_is_accepted_from_five_percent_above_the_quickest_on(name):
    limits, random = LIMITS[name], np.random.default_rng(12)
    refused = []
    for case in range(CASES):
        keys, ends = random_case(random, limits)
        motion = planned(keys, ends, limits)
        took = motion.end_time - motion.start_time
        for factor in DURATIONS:
            try:
                slower = planned(keys, ends, limits, duration=factor * took)
            except PlanError as error:
                # Between two velocities there are durations that no motion takes.
                assert len(keys) == 2
                assert None not in ends
                refused.append((case, factor, str(error)))
                continue
            assert slower.end_time - slower.start_time == pytest.approx(factor * took, rel=1e-9)
            check(slower, keys, ends, limits)
    print(f"\n{name}: refused {len(refused)} of {len(DURATIONS) * CASES}", *refused, sep="\n")
    assert len(refused) <= 0.02 * len(DURATIONS) * CASES


ORIGIN = [0.0, 0.0, 0.0]

# Name of the limits, keyframes as rotation vectors, velocities at the ends.
ONCE_REFUSED = {
    "near": ("default", [ORIGIN, [0.01, -0.03, -0.02]], [None, (0, -0.9, -0.5)]),
    "ur": (
        "arm",
        [ORIGIN, [-0.114, 0.03, -0.011], [-0.073, 0.048, 0.015], [0.053, 0.207, 0.91]],
        [(-1.074, 0.349, -0.516), (-0.003, 0.114, -0.539)],
    ),
    "no run-up": ("default", [ORIGIN, [0.05, -0.01, 0.07]], [(-0.9, -1.2, 1.7), None]),
    "no duration": ("default", [ORIGIN, [0.04, -0.02, 0]], [None, (1.8, -1.0, 0.1)]),
    "no lead-out": ("default", [ORIGIN, [-0.11, 0.36, -0.04]], [None, (1.1, -0.9, 1.8)]),
    "three": (
        "default",
        [ORIGIN, [-0.02, 0.02, 0.01], [0.01, 0.03, -0.05]],
        [None, (-0.8, 1.7, -1.3)],
    ),
    "ur, two": ("arm", [ORIGIN, [-0.02, -0.01, -0.01]], [None, (-0.89, -0.4, -0.18)]),
    "five": (
        "default",
        [ORIGIN, [0.38, 0.14, -0.19], [-0.01, 0.18, 0.07], [0.08, 0.29, -0.56], [0.1, 0.28, -0.53]],
        [None, (0.53, -0.24, 1.31)],
    ),
}

# The same, and what single moves take, s.
ONCE_SLOW = {
    "39 s": (
        *("axes", [ORIGIN, [0.36, 0.82, -0.17], [-1.03, 1.5, 0.31]]),
        *([None, (0.3, -0.63, 0.08)], 2.14),
    ),
    "11 s": ("axes", [ORIGIN, [-1.37, -0.39, -0.42]], [None, (0.52, -0.74, 0.08)], 1.23),
    "9 s": (
        *("axes", [ORIGIN, [-1.13, 0.34, 0.99]]),
        *([(0.83, -0.09, 0.02), (-0.2, 0.88, 0.03)], 2.002),
    ),
    "23 s": (
        *("axes", [ORIGIN, [-0.02, 0.38, -0.9]]),
        *([(0.42, 0.08, 0.11), (-0.01, -1.0, -0.01)], 1.85),
    ),
    "three": (
        *("default", [ORIGIN, [-0.39, -0.13, 0.18], [-0.38, -0.15, 0.14]]),
        *([(0.95, 0.81, -0.12), (1.19, -1.48, 0.49)], 1.143),
    ),
    "four": (
        *("default", [ORIGIN, [-1.05, 0.87, -1.83], [-1.34, 1.8, -0.6], [-1.4, 1.73, -0.7]]),
        *([(1.75, 0.58, -0.37), (-0.29, -0.12, 1.54)], 2.647),
    ),
    "sixteen": (
        "arm",
        [
            ORIGIN, [0.0043, 0.0127, -0.0075], [-0.0022, -0.0395, 0], [-0.0147, -0.0978, -0.0144],
            [-0.0107, -0.1804, -0.0005], [0.0174, -0.2014, -0.0338], [0.0239, -0.1452, -0.0527],
            [0.0643, -0.1289, -0.0145], [0.0876, -0.1263, -0.0625], [0.067, -0.1073, -0.1333],
            [0.053, -0.1076, -0.0481], [0.0552, -0.1183, -0.0357], [0.1081, -0.1334, -0.1],
            [0.1424, -0.1442, -0.1393], [0.1377, -0.1174, -0.1182], [0.0763, -0.1192, -0.1428],
        ],
        [(-0.203, -0.881, 0.497), (-0.681, -0.015, -0.562)],
        3.663,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", ONCE_REFUSED)
def test_a_velocity_at_an_end_is_no_reason_to_refuse(name):
    limits, vectors, ends = ONCE_REFUSED[name]
    keys = quaternions(vectors)
    motion = planned(keys, ends, LIMITS[limits])
    assert motion.duration <= SLOWER * chain(keys, ends, LIMITS[limits])
    check(motion, keys, ends, LIMITS[limits])


@pytest.mark.parametrize("name", ONCE_SLOW)
def test_it_takes_no_longer_than_single_moves(name):
    limits, vectors, ends, most = ONCE_SLOW[name]
    keys = quaternions(vectors)
    motion = planned(keys, ends, LIMITS[limits])
    assert motion.duration <= SLOWER * min(most, chain(keys, ends, LIMITS[limits]))
    check(motion, keys, ends, LIMITS[limits])


@pytest.mark.parametrize("duration", [0.71, 0.75, 0.9, 1.0, 1.4])
def test_a_duration_keeps_the_velocity_at_the_end(duration):
    keys, ends = (
        quaternions([ORIGIN, [0.1, 0.3, 0.8], [0.5, 0.3, 0.8]]),
        [None, (0.05, -0.03, 0.08)],
    )
    motion = planned(keys, ends, DEFAULT_LIMITS, duration=duration)
    assert motion.end_time - motion.start_time == pytest.approx(duration, rel=1e-9)
    check(motion, keys, ends, DEFAULT_LIMITS)


@pytest.mark.parametrize("pace", [1.0, 0.1, 0.05])
def test_a_share_of_the_pace_is_planned_with_a_velocity_at_the_end(pace):
    keys, ends = (
        quaternions([ORIGIN, [0.1, 0.3, 0.8], [0.5, 0.3, 0.8]]),
        [None, (0.05, -0.03, 0.08)],
    )
    check(planned(keys, ends, DEFAULT_LIMITS, pace=pace), keys, ends, DEFAULT_LIMITS)


def test_keyframes_along_a_smooth_way_are_passed_in_motion():
    times = np.linspace(0.0, 1.0, 9)
    keys = quaternions([[0.5 * t, 0.4 * t * t, 0.3 * np.sin(2.0 * t)] for t in times])
    motion = planned(keys, [None, (0.3, 0.5, -0.1)], DEFAULT_LIMITS)
    assert motion.certificate.notes == ()
    speeds = np.linalg.norm(motion.sample(motion.keyframe_times[1:]).omega_body, axis=1)
    assert speeds.min() > 0.2


def test_stops_beside_a_moving_end_are_noted():
    limits, vectors, ends, _ = ONCE_SLOW["four"]
    keys = quaternions(vectors)
    motion = planned(keys, ends, LIMITS[limits])
    (note,) = [one for one in motion.certificate.notes if "keyframes[1] and keyframes[2]" in one]
    assert note.startswith("stops at ")
    inner = motion.sample(motion.keyframe_times[1:3]).omega_body
    assert np.abs(inner).max() < 1e-9
    assert all(late > early for early, late in pairwise(motion.keyframe_times))


def test_a_curve_that_swings_out_gives_way_to_a_stop_next_to_its_moving_end():
    keys = quaternions([ORIGIN, [0.0008, 0.0027, 0.002], [-0.5134, 0.0359, -1.905]])
    ends, limits = [(-0.062, -0.355, -0.209), None], Limits(0.5, 2.0, 50.0, 1.0, 10.0)
    motion = planned(keys, ends, limits, method="minimum_effort")
    # The curve alone takes more than 30 s.
    assert motion.duration <= 1.1 * chain(keys, ends, limits)
    check(motion, keys, ends, limits)


@pytest.mark.parametrize("name", LIMITS)
def test_a_motion_takes_over_from_another_one_whatever_comes_next(name):
    limits, random = LIMITS[name], np.random.default_rng(13)
    for _ in range(CASES):
        keys, _ = random_case(random, limits)
        away = Rotation.from_quat(keys[0], scalar_first=True) * Rotation.random(rng=random)
        far = tuple(away.as_quat(scalar_first=True).tolist())
        request = MotionRequest([Keyframe(far)])
        first = plan(request, start=State.at_rest(keys[0]), limits=limits, period=PERIOD)
        start = first.state_at(int(random.integers(3, first.record_count - 3)))
        keys = [tuple(start.q.tolist()), *keys[1:]]
        ends = [None, velocity(random, limits)]
        request = MotionRequest([Keyframe(q) for q in keys], end_velocity=ends[1])
        motion = plan(request, start=start, limits=limits, period=PERIOD)
        check(motion, keys, [tuple(start.omega_body.tolist()), ends[1]], limits)
