"""Time to build the default curve, compared with scipy's RotationSpline."""

import math
import time
from functools import partial

import numpy as np
import pytest
from curve_speed import random_walk
from scipy.spatial.transform import RotationSpline

from orientd.curves import METHODS
from orientd.rotation import to_scipy

pytestmark = pytest.mark.bench

ENDS = {
    "natural": {},
    "clamped": {
        "start": "clamped",
        "omega_start": [0.1, 0.0, 0.2],
        "end": "clamped",
        "omega_end": [0.0, 0.3, 0.0],
    },
}


def shortest(runs, rounds):
    """The shortest CPU time of each call, in seconds, taken in turns: the machine is not ours."""
    found = [math.inf] * len(runs)
    for _ in range(rounds):
        for place, run in enumerate(runs):
            begin = time.thread_time()
            run()
            found[place] = min(found[place], time.thread_time() - begin)
    return found


def walk(count, step):
    """Keyframes *step* rad apart and uneven times."""
    return random_walk(count, step), np.cumsum(np.random.default_rng(2).uniform(0.8, 1.2, count))


@pytest.mark.timeout(300)
@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("step", [0.3, 1.0, 2.0, 3.0])
def test_building_is_many_times_as_fast_as_scipys(step, ends):
    keys, times = walk(1000, step)
    rotations = to_scipy(keys)
    build = partial(METHODS["c2_cumulative"], keys=keys, times=times, **ENDS[ends])
    ours, scipys = shortest([build, partial(RotationSpline, times, rotations)], 30)
    print(
        f"\n{step:g} rad, {ends}: {1e6 * ours:.0f} ns a keyframe, "
        f"scipy {1e6 * scipys:.0f}, {scipys / ours:.1f} times as many"
    )
    assert scipys >= 8.0 * ours
