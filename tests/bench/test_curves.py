"""The default curve beside scipy's RotationSpline: sampled, and built ever longer."""

import pytest

from orientd.bench.curves import measure_curves

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
