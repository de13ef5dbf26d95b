"""Planning in motion, compared with scipy's RotationSpline, built and sampled at the same rate."""

import time

import numpy as np
import pytest
from reference.aims import retarget
from scipy.spatial.transform import Rotation, RotationSpline

from orientd.curves import METHODS
from orientd.planner import DEFAULT_LIMITS, Keyframe, MotionRequest, State, plan

pytestmark = pytest.mark.bench

PERIOD = 0.002
SPACING = 0.35


def seconds(work, rounds=15):
    work()
    taken = []
    for _ in range(rounds):
        begin = time.thread_time()
        work()
        taken.append(time.thread_time() - begin)
    return float(np.median(taken))


@pytest.mark.timeout(300)
def test_motions_are_planned_and_certified_in_less_than_scipy_builds_and_samples_a_spline():
    random = np.random.default_rng(1)
    rotation = Rotation.identity()
    rotations = [
        rotation := rotation * Rotation.from_rotvec(v) for v in random.normal(size=(20, 3)) * 0.15
    ]
    keys = Rotation.concatenate(rotations)
    times = SPACING * np.arange(20)
    instants = np.arange(0.0, times[-1], PERIOD)
    quaternions = [tuple(q) for q in keys.as_quat(scalar_first=True).tolist()]
    here = State.at_rest([1.0, 0.0, 0.0, 0.0])
    start = retarget(
        [0.5, 0.5, 0.5, 0.5], start=here, limits=DEFAULT_LIMITS, period=PERIOD
    ).state_at(100)
    at_rest = State.at_rest(quaternions[0])
    untimed = [Keyframe(q) for q in quaternions]
    timed = [Keyframe(q, t) for q, t in zip(quaternions, times.tolist(), strict=True)]

    def planned(keyframes, state, *, approach=False):
        request = MotionRequest(keyframes, approach=approach)
        return lambda: plan(request, start=state, limits=DEFAULT_LIMITS, period=PERIOD)

    def peer():
        spline = RotationSpline(times, keys)
        return [spline(instants, order) for order in range(3)]

    scipy = seconds(peer)
    at_ends = {"start": "clamped", "omega_start": [0, 0, 0], "end": "clamped"}
    at_ends |= {"omega_end": [0, 0, 0]}
    works = {
        "curve": lambda: METHODS["c2_cumulative"](keys=quaternions, times=times, **at_ends),
        "retarget": lambda: retarget(
            quaternions[3], start=start, limits=DEFAULT_LIMITS, period=PERIOD
        ),
        "retarget_from_rest": lambda: retarget(
            quaternions[3], start=here, limits=DEFAULT_LIMITS, period=PERIOD
        ),
        "timed": planned(timed, at_rest),
        "untimed": planned(untimed, at_rest),
        "retarget_timed": planned(timed, start, approach=True),
        "retarget_untimed": planned(untimed, start, approach=True),
    }
    taken = {name: seconds(work) for name, work in works.items()}
    ratios = {name: each / scipy for name, each in taken.items()}
    figures = ", ".join(f"{name} {1e3 * taken[name]:.3g} ({ratios[name]:.3g})" for name in works)
    print(f"\nscipy {1e3 * scipy:.3g}; ms of the thread (times as long): {figures}")
    assert max(ratios.values()) < 1.5
