"""The compiled kernel against the NumPy one, and its loading in the background."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from orientd.curves import METHODS, fast
from orientd.curves.basis import cumulative_basis


@pytest.fixture(scope="module")
def loaded():
    pytest.importorskip("numba")
    assert fast.wait_ready(), repr(fast.KERNEL.error)
    return fast.KERNEL


@pytest.fixture
def compiled(loaded, numpy_kernel):
    """Switch the curves of a test to the compiled kernel, and back when asked."""

    class Switch:
        def on(self):
            numpy_kernel.fill, numpy_kernel.fill_product = loaded.fill, loaded.fill_product

        def off(self):
            numpy_kernel.fill = numpy_kernel.fill_product = None

    return Switch()


def assert_close(samples, others):
    scale = max(1.0, np.abs(samples[1]).max())
    for part, other, size in zip(samples, others, (1.0, scale, scale**2), strict=True):
        assert np.abs(part - other).max() <= 1e-12 * size


@pytest.mark.parametrize("step", [1e-3, 1.0, 2.5])
def test_both_kernels_agree(product_example, compiled, step):
    curve = product_example.curve(step=step)
    for count in (1, 2, 63, 64, 65, 1000):
        times = np.linspace(*curve.domain, count)
        reference = curve.evaluate(times)
        compiled.on()
        assert_close(reference, curve.evaluate(times))
        compiled.off()


def test_both_kernels_agree_at_instants_in_any_order(product_example, compiled):
    curve = product_example.curve()
    rng = np.random.default_rng(0)
    times = np.concatenate(
        [
            rng.uniform(*curve.domain, 300),
            np.repeat(curve.knots, 3),
            np.linspace(*curve.domain, 200)[::-1],
            np.linspace(*curve.domain, 3000),
            np.nextafter(curve.knots[1:], -np.inf),
        ]
    )
    reference = curve.evaluate(times)
    compiled.on()
    assert_close(reference, curve.evaluate(times))


def test_the_compiled_kernel_takes_whatever_numpy_takes(product_example, compiled):
    curve = product_example.curve()
    compiled.on()
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
    out = np.empty((10, 40))
    assert np.shares_memory(curve.evaluate(times, out=out)[0], out)


@pytest.mark.parametrize("place", [0, 1, 70, 199])
def test_the_compiled_kernel_refuses_what_numpy_refuses(product_example, compiled, place):
    curve = product_example.curve()
    compiled.on()
    start, end = curve.domain
    for wrong in (start - 1e-9, end + 1e-9, np.nan, np.inf, -np.inf):
        times = np.linspace(start, end, 200)
        times[place] = wrong
        with pytest.raises(ValueError, match="domain"):
            curve.evaluate(times)


def test_the_compiled_kernel_forgives_rounding_at_the_ends(product_example, compiled):
    curve = product_example.curve()
    ends = np.array(curve.domain)
    outside = np.array([np.nextafter(ends[0], -np.inf), np.nextafter(ends[1], np.inf)])
    reference = curve.evaluate(ends)
    compiled.on()
    assert_close(reference, curve.evaluate(outside))


def test_many_turns_within_a_span_lose_no_digits(compiled):
    for spins in (0, 1, 2, 3, 1000, -1001):
        curve = METHODS["slerp"](q0=[1, 0, 0, 0], q1=[0.6, 0, 0.8, 0], spins=spins)
        times = np.linspace(0.0, 1.0, 500)
        reference = curve.evaluate(times)
        compiled.on()
        assert_close(reference, curve.evaluate(times))
        compiled.off()


@pytest.mark.parametrize("order", [2, 3, 4, 6])
def test_both_kernels_make_the_same_basis(loaded, numpy_kernel, order):
    rng = np.random.default_rng(order)
    inner = np.cumsum(rng.choice([0.0, 0.01, 1.0, 30.0], 40, p=[0.1, 0.2, 0.4, 0.3]))
    knots = np.concatenate([np.full(order, -1.0), inner, np.full(order, inner[-1] + 1.0)])
    reference = cumulative_basis(knots, order)
    numpy_kernel.fill_basis = loaded.fill_basis
    basis = cumulative_basis(knots, order)
    for name in ("values", "rates", "curvatures"):
        assert getattr(basis, name) == pytest.approx(getattr(reference, name), rel=1e-13, abs=1e-15)


def test_loading_waits_for_many_samples():
    kernel = fast.FastKernel()
    kernel.count(fast.START_AFTER)
    assert kernel.status is fast.Status.NOT_STARTED
    assert kernel.fill is None


def test_many_samples_start_loading(loaded):
    kernel = fast.FastKernel()
    kernel.count(fast.START_AFTER + 1)
    assert kernel.wait_ready(60.0)
    assert kernel.status is fast.Status.READY
    assert kernel.fill is not None


def test_without_numba_numpy_serves_on(monkeypatch):
    monkeypatch.setattr(fast, "find_spec", lambda name: None)
    kernel = fast.FastKernel()
    assert not kernel.wait_ready(60.0)
    assert kernel.status is fast.Status.MISSING
    assert kernel.fill is None


def test_a_numba_that_does_not_work_is_reported_not_raised(monkeypatch):
    def broken(name):
        raise RuntimeError("no compiler here")

    monkeypatch.setattr(fast, "find_spec", lambda name: object())
    monkeypatch.setattr(fast, "import_module", broken)
    kernel = fast.FastKernel()
    assert not kernel.wait_ready(60.0)
    assert kernel.status is fast.Status.FAILED
    assert str(kernel.error) == "no compiler here"


def test_importing_the_curves_imports_neither_scipy_nor_numba():
    code = "import sys, orientd.curves; sys.exit(bool({'scipy', 'numba'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_kernels_are_forgotten_when_anything_they_were_made_of_changes(tmp_path):
    sources = [tmp_path / "curves" / "compiled_a.py", *(tmp_path / n for n in fast.NUMBERS_FROM)]
    kernel = tmp_path / "curves" / "__pycache__" / "compiled_a.f-1.py311.nbi"
    for path in (*sources, kernel):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
    for changed in sources:
        for path in sources:
            os.utime(path, ns=(1_000, 1_000))
        os.utime(kernel, ns=(2_000, 2_000))
        fast.forget_stale(tmp_path)
        assert kernel.exists()
        os.utime(changed, ns=(3_000, 3_000))
        fast.forget_stale(tmp_path)
        assert not kernel.exists()
        kernel.write_text("")


def test_it_is_known_where_kernels_take_numbers_from():
    package = Path(fast.__file__).parents[1]
    types_alone = {"orientd.rotation", "orientd.curves.basis"}
    found = set()
    for source in package.glob("*/compiled*.py"):
        for node in ast.walk(ast.parse(source.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("orientd."):
                name = node.module.rpartition(".")[2]
                if not name.startswith(("compiled", "fast")) and node.module not in types_alone:
                    found.add(node.module.removeprefix("orientd.").replace(".", "/") + ".py")
    assert found == set(fast.NUMBERS_FROM)
