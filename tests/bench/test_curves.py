"""The default curve beside scipy's RotationSpline: sampled, and built ever longer."""

import time

import numpy as np
import pytest
from scipy.spatial.transform import RotationSpline

from orientd.bench.curves import measure_curves, random_walk
from orientd.curves import METHODS, fast
from orientd.rotation import to_scipy

pytestmark = pytest.mark.bench


def show(title, **figures):
    print(f"\n{title}: " + ", ".join(f"{name} {figure:.3g}" for name, figure in figures.items()))


@pytest.mark.timeout(300)
@pytest.mark.parametrize(("instants", "compiled", "plain"), [(500, 30, 3), (100_000, 80, 3)])
def test_sampling_is_many_times_as_fast_as_scipys(instants, compiled, plain):
    pytest.importorskip("numba")
    (found,) = measure_curves(instants=(instants,), steps=()).samplings
    show(
        f"{instants} sorted instants, ns each",
        compiled=found.compiled_ns,
        numpy=found.numpy_ns,
        scipy=found.scipy_ns,
        compiled_ratio=found.compiled_ratio,
        numpy_ratio=found.numpy_ratio,
    )
    assert found.compiled_ratio >= compiled
    assert found.numpy_ratio >= plain


@pytest.mark.timeout(900)
@pytest.mark.parametrize("step", [0.3, 1.0, 2.0, 3.0])
def test_building_grows_linearly(step):
    (found,) = measure_curves(instants=(), steps=(step,)).buildings
    show(
        f"1,000 and 100,000 keyframes, {step:g} rad apart",
        few_s=found.few_s,
        many_s=found.many_s,
        growth=found.growth,
    )
    assert found.growth <= 120


def shortest(run, rounds=15):
    """The shortest CPU time of a call, in seconds."""
    found = []
    for _ in range(rounds):
        begin = time.thread_time()
        run()
        found.append(time.thread_time() - begin)
    return min(found)


@pytest.fixture(params=["numpy", "compiled"])
def kernels(request, monkeypatch):
    """The kernels in use all the time, whatever has been loaded meanwhile."""
    if request.param == "compiled":
        pytest.importorskip("numba")
        assert fast.wait_ready()
    else:
        without = fast.FastKernel()
        without.status = fast.Status.MISSING
        monkeypatch.setattr(fast, "KERNEL", without)
    return request.param


@pytest.mark.timeout(300)
@pytest.mark.parametrize(("step_deg", "most"), [(10.0, 5.0), (90.0, 6.0), (178.0, 6.0)])
@pytest.mark.parametrize("spans", [2, 3])
def test_the_least_effort_takes_a_few_times_as_long_as_a_spline_without_it(
    kernels, step_deg, most, spans
):
    keys, times = random_walk(20, np.radians(step_deg)), np.arange(20.0)
    least = shortest(lambda: METHODS["minimum_effort"](keys=keys, times=times, spans=spans))
    default = shortest(lambda: METHODS["c2_cumulative"](keys=keys, times=times))
    peer = shortest(lambda: RotationSpline(times, to_scipy(keys)))
    show(
        f"20 keyframes {step_deg:g} deg apart, {spans} spans, {kernels}, ms",
        minimum_effort=1e3 * least,
        c2_cumulative=1e3 * default,
        scipy=1e3 * peer,
        ratio=least / default,
        scipy_ratio=least / peer,
    )
    if kernels == "numpy":
        assert least <= most * default
    else:
        assert least <= 10.0 * peer


@pytest.mark.timeout(900)
@pytest.mark.parametrize("step_deg", [20.0, 90.0])
def test_the_least_effort_grows_linearly(kernels, step_deg):
    family = METHODS["minimum_effort"]
    few, many = (random_walk(count, np.radians(step_deg)) for count in (200, 20_000))
    few_s, many_s = shortest(lambda: family(keys=few), 5), shortest(lambda: family(keys=many), 1)
    show(f"200 and 20,000 keyframes {step_deg:g} deg apart, {kernels}", few_s=few_s, many_s=many_s)
    assert many_s <= 150.0 * few_s
