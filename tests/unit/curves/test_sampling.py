"""Sampling of cumulative products: for any arrays, the same bits always."""

import importlib.util
import subprocess
import sys

import numpy as np
import pytest

from orientd import kernels, processor
from orientd.curves import METHODS


def assert_close(samples, others):
    """A trajectory is fitted to orientations, whose derivatives lose digits."""
    scale = max(1.0, np.abs(samples[1]).max())
    sizes = 1e-12, 2e-10 * scale, 1e-7 * scale**2
    for part, other, size in zip(samples, others, sizes, strict=True):
        assert np.abs(part - other).max() <= size


def any_order(curve):
    rng = np.random.default_rng(0)
    return np.concatenate(
        [
            rng.uniform(*curve.domain, 300),
            np.repeat(curve.knots, 3),
            np.linspace(*curve.domain, 200)[::-1],
            np.linspace(*curve.domain, 3000),
            np.nextafter(curve.knots[1:], -np.inf),
        ]
    )


def test_instants_may_be_any_array(product_example):
    curve = product_example.curve()
    start, end = curve.domain
    times = np.linspace(start, end, 40)
    reference = curve.evaluate(times)
    frozen = times.copy()
    frozen.setflags(write=False)
    for same in (frozen, np.repeat(times, 2)[::2], times.tolist(), times.astype(np.longdouble)):
        assert_close(reference, curve.evaluate(same))
    assert curve.evaluate([])[0].shape == (0, 4)
    assert curve.evaluate(start)[1].shape == (3,)
    assert curve.evaluate(times.reshape(8, 5))[2].shape == (8, 5, 3)
    assert_close(
        [part.reshape(8, 5, -1).transpose(1, 0, 2) for part in reference],
        curve.evaluate(times.reshape(8, 5).T),
    )
    out = np.empty((10, 40))
    assert np.shares_memory(curve.evaluate(times, out=out)[0], out)


@pytest.fixture(scope="module", params=processor.runnable())
def build(request):
    """The kernels that were built for one of the levels of this machine."""
    (path,) = (processor.KERNELS / request.param).glob("native.*")
    spec = importlib.util.spec_from_file_location("native", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert request.param == module.LEVEL
    return module


def bits(build, curve, times):
    """Samples as a build writes them, as integers: 0.0 is not -0.0 there."""
    out, table = np.full((10, len(times)), np.nan), curve.trajectory
    build.sample_trajectory(times, table.breaks, table.pieces, np.inf, out)
    return out.view(np.int64)


def test_a_sample_is_the_same_whatever_else_is_asked_for(product_example, build):
    """Bit for bit: in any order, in any company, alone, and however often."""
    curve = product_example.curve()
    times = any_order(curve)
    reference = bits(build, curve, times)
    assert np.array_equal(bits(build, curve, times), reference)
    rng = np.random.default_rng(1)
    for order in (np.argsort(times), np.argsort(-times), rng.permutation(len(times))):
        assert np.array_equal(bits(build, curve, times[order]), reference[:, order])
    for _ in range(300):
        some = rng.choice(len(times), rng.integers(1, 40))
        some = some if rng.random() < 0.5 else np.sort(some)
        assert np.array_equal(bits(build, curve, times[some]), reference[:, some])
    for first in range(0, len(times), 7):
        some = np.arange(first, min(first + rng.integers(1, 20), len(times)))
        assert np.array_equal(bits(build, curve, times[some]), reference[:, some])


def test_every_build_is_in_use_where_it_is_asked_for():
    code = "import orientd.kernels; print(orientd.kernels.LEVEL)"
    for level in processor.runnable():
        found = subprocess.run(
            [sys.executable, "-c", code],
            env={processor.FORCED: level, "PYTHONPATH": ":".join(sys.path)},
            capture_output=True,
            text=True,
            check=True,
        )
        assert found.stdout.strip() == level


def test_importing_the_curves_imports_neither_scipy_nor_any_family():
    code = """
import sys
from orientd.curves import METHODS
assert len(METHODS) > 20
homes = ("scipy", "orientd.curves.products", "orientd.curves.sphere", "orientd.curves.m")
sys.exit(any(name.startswith(homes) for name in sys.modules))
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def product_arguments():
    curve = METHODS["kks_quintic_hermite"](
        q0=[1, 0, 0, 0], q1=[0.6, 0, 0.8, 0], omega0=[0.0, 0.0, 1.0], omega1=[0.0, 0.0, 1.0]
    )
    return [curve.knots, *curve.parts, np.full((4, 3), np.nan), 1, np.empty(9), np.empty((8, 34))]


def basis_arguments():
    knots = np.arange(8.0)
    sizes = (4, 3, 4), (4, 3, 3), (4, 3, 2)
    return [np.array([3, 3, 3, 3]), knots, 4, *(np.empty(size) for size in sizes)]


CALLS = {
    "product_trajectory": product_arguments,
    "fill_basis": basis_arguments,
}


ANY_LENGTH = {("fill_basis", 1, 0), ("product_trajectory", 3, 0), ("product_trajectory", 4, 2)}
"""Knots, increments and degrees: an argument of a kernel, and its axis."""


@pytest.mark.parametrize("name", CALLS)
def test_arrays_of_other_shapes_are_refused(name):
    kernel, arguments = getattr(kernels, name), CALLS[name]()
    kernel(*arguments)
    for place, argument in enumerate(arguments):
        if not isinstance(argument, np.ndarray) or argument.dtype == np.int64:
            continue
        for axis in range(argument.ndim):
            if (name, place, axis) in ANY_LENGTH:
                continue
            longer = np.concatenate([argument, argument], axis=axis)
            with pytest.raises(ValueError, match="do not belong together"):
                kernel(*arguments[:place], longer, *arguments[place + 1 :])
        for wrong in (argument[None], argument.astype(np.float32)):
            with pytest.raises(TypeError, match="expected"):
                kernel(*arguments[:place], wrong, *arguments[place + 1 :])


@pytest.mark.parametrize("span", [-1, 2, 4])
def test_a_basis_on_a_span_that_is_not_there_is_refused(span):
    arguments = basis_arguments()
    arguments[0][2] = span
    with pytest.raises(ValueError, match="do not belong together"):
        kernels.fill_basis(*arguments)
