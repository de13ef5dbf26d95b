"""The default curve, compared with scipy's RotationSpline: sampling, and building longer curves."""

import json
import os
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

import curve_speed
import numpy as np
import pytest
from curve_speed import Sampling, random_walk
from scipy.spatial.transform import RotationSpline

from orientd import processor
from orientd.curves import METHODS
from orientd.curves.interpolating import C2Cumulative
from orientd.rotation import to_scipy

pytestmark = pytest.mark.bench

UNSORTED_SLOWER = {"x86-64-v4": 8.0, "x86-64-v3": 6.0}
"""How many times as long an instant may take where they are in no order.  Without vector
instructions there it would be 11 and 7."""


def show(title, **figures):
    print(f"\n{title}: " + ", ".join(f"{name} {figure:.3g}" for name, figure in figures.items()))


FASTER_THAN_SCIPY = {
    "x86-64-v4": {1: 150, 500: 60, 100_000: 110},
    "x86-64-v3": {500: 40, 100_000: 70},
}
"""How many times as fast sorted instants are at the least, with the kernels of each level.  Without
vector instructions it would be some 35 for 500 of them and 40 for many."""


def in_new_process(*arguments, level=None):
    """Prints of a new process, with the kernels of one level."""
    ran = subprocess.run(
        [sys.executable, *arguments],
        env=os.environ | ({processor.FORCED: level} if level else {}),
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return json.loads(ran.stdout)


def samplings(level, *instants):
    if level not in processor.runnable():
        pytest.skip(f"the processor is not one of {level}")
    code = f"""
import json, sys
from dataclasses import asdict
sys.path.insert(0, {str(Path(curve_speed.__file__).parent)!r})
from curve_speed import measure_sampling
print(json.dumps([asdict(measure_sampling(count)) for count in {instants}]))
"""
    found = [Sampling(**one) for one in in_new_process("-c", code, level=level)]
    for one in found:
        show(level, **asdict(one), ratio=one.ratio)
    return found


@pytest.mark.timeout(300)
@pytest.mark.parametrize("level", FASTER_THAN_SCIPY)
def test_sampling_is_many_times_as_fast_as_scipys(level):
    expected = FASTER_THAN_SCIPY[level]
    found = samplings(level, *expected)
    assert {one.instants: one.ratio for one in found if one.ratio < expected[one.instants]} == {}


@pytest.mark.timeout(300)
@pytest.mark.parametrize("level", UNSORTED_SLOWER)
def test_instants_in_any_order_are_sampled_with_vector_instructions_too(level):
    (found,) = samplings(level, 10_000)
    assert found.unsorted_ns <= UNSORTED_SLOWER[level] * found.sorted_ns


@pytest.mark.timeout(300)
def test_the_first_samples_are_there_soon_and_take_little_memory():
    """Beside NumPy and SciPy; the shortest of several, for the machine does other things too."""
    script = str(Path(__file__).parent / "first_sample.py")
    found = [in_new_process(script) for _ in range(9)]
    cpu_ms, mib = (min(values) for values in zip(*found, strict=True))
    show("import and first samples", cpu_ms=cpu_ms, mib=mib)
    assert cpu_ms <= 60
    assert mib <= 8


def shortest(run, rounds=15):
    """The shortest CPU time of a call, in seconds."""
    found = []
    for _ in range(rounds):
        begin = time.thread_time()
        run()
        found.append(time.thread_time() - begin)
    return min(found)


ENDS = {
    "natural": {},
    "clamped": {
        "start": "clamped",
        "omega_start": [0.1, 0.0, 0.2],
        "end": "clamped",
        "omega_end": [0.0, 0.3, 0.0],
    },
}


@pytest.mark.timeout(300)
@pytest.mark.parametrize("ends", ENDS)
@pytest.mark.parametrize("step", [0.3, 1.0, 2.0, 3.0])
def test_building_is_many_times_as_fast_as_scipys(step, ends):
    keys = random_walk(1000, step)
    times, rotations = np.cumsum(np.random.default_rng(2).uniform(0.8, 1.2, 1000)), to_scipy(keys)
    found = []
    # In turns: other programs may slow down one of them for a while.
    for _ in range(30):
        ours = shortest(lambda: METHODS["c2_cumulative"](keys=keys, times=times, **ENDS[ends]), 1)
        found.append((ours, shortest(lambda: RotationSpline(times, rotations), 1)))
    ours, scipys = (min(values) for values in zip(*found, strict=True))
    show(f"{step:g} rad, {ends}, ns a keyframe", ours=1e6 * ours, scipy=1e6 * scipys)
    assert scipys >= 8.0 * ours


@pytest.mark.timeout(300)
@pytest.mark.parametrize("step_deg", [10.0, 90.0, 178.0])
@pytest.mark.parametrize("spans", [2, 3])
def test_the_least_effort_takes_a_few_times_as_long_as_a_spline_without_it(step_deg, spans):
    keys, times = random_walk(20, np.radians(step_deg)), np.arange(20.0)
    least = shortest(lambda: METHODS["minimum_effort"](keys=keys, times=times, spans=spans))
    default = shortest(lambda: METHODS["c2_cumulative"](keys=keys, times=times))
    peer = shortest(lambda: RotationSpline(times, to_scipy(keys)))
    show(
        f"20 keyframes {step_deg:g} deg apart, {spans} spans, ms",
        minimum_effort=1e3 * least,
        c2_cumulative=1e3 * default,
        scipy=1e3 * peer,
        ratio=least / default,
        scipy_ratio=least / peer,
    )
    assert least <= 10.0 * peer


@pytest.mark.timeout(900)
@pytest.mark.parametrize("step", [0.3, 1.0, 2.0, 3.0])
def test_building_grows_linearly(step):
    few, many = (random_walk(count, step) for count in (1000, 100_000))
    few_s, many_s = (shortest(lambda keys=keys: C2Cumulative(keys=keys), 3) for keys in (few, many))
    show(f"1,000 and 100,000 keyframes, {step:g} rad apart", few_s=few_s, many_s=many_s)
    assert many_s <= 120.0 * few_s


@pytest.mark.timeout(900)
@pytest.mark.parametrize("step_deg", [20.0, 90.0])
def test_the_least_effort_grows_linearly(step_deg):
    family = METHODS["minimum_effort"]
    few, many = (random_walk(count, np.radians(step_deg)) for count in (200, 20_000))
    few_s, many_s = shortest(lambda: family(keys=few), 5), shortest(lambda: family(keys=many), 1)
    show(f"200 and 20,000 keyframes {step_deg:g} deg apart", few_s=few_s, many_s=many_s)
    assert many_s <= 150.0 * few_s
