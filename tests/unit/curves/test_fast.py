"""The compiled kernel against the NumPy one, and its loading in the background."""

import ast
import os
from pathlib import Path

import numpy as np
import pytest

from orientd.curves import METHODS, fast
from orientd.curves.effort_equations import EffortEquations
from orientd.rotation import angle, between, exp, multiply


@pytest.fixture(scope="module")
def loaded():
    pytest.importorskip("numba")
    assert fast.wait_ready(), repr(fast.KERNEL.error)
    return fast.KERNEL


def assert_close(samples, others):
    scale = max(1.0, np.abs(samples[1]).max())
    for part, other, size in zip(samples, others, (1.0, scale, scale**2), strict=True):
        assert np.abs(part - other).max() <= 1e-12 * size


@pytest.mark.parametrize("ends", [("natural", "state"), ("clamped", "natural"), ("state",) * 2])
@pytest.mark.parametrize("count", [2, 3, 25])
def test_both_kernels_find_the_same_increments(loaded, numpy_kernel, random_keys, ends, count):
    rng = np.random.default_rng(count)
    given = {
        f"{quantity}_{side}": 0.3 * rng.normal(size=3)
        for side, condition in zip(("start", "end"), ends, strict=True)
        for quantity in {"natural": (), "clamped": ("omega",)}.get(condition, ("omega", "alpha"))
    }
    given |= {"keys": random_keys(count, 0.7), "times": np.cumsum(rng.uniform(0.5, 2.0, count))}
    found = []

    def find(*arguments):
        found.append(loaded.find(*arguments))
        return found[-1]

    reference = METHODS["c2_cumulative"](**given, start=ends[0], end=ends[1])
    numpy_kernel.find = find
    curve = METHODS["c2_cumulative"](**given, start=ends[0], end=ends[1])
    assert np.abs(curve.increments - reference.increments).max() <= 1e-14
    # A single unknown is a logarithm and needs no search.
    assert found == ([] if count == 2 and "natural" not in ends else [True])


@pytest.mark.parametrize("ends", ["natural", "clamped"])
@pytest.mark.parametrize("times", ["uniform", "uneven"])
@pytest.mark.parametrize("large", [[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10], [2, 3], [0, 3, 4, 10]])
def test_the_way_to_large_steps_is_the_same_with_compiled_corrections(
    loaded, numpy_kernel, random_keys, large, times, ends
):
    steps = np.full(11, 0.2)
    steps[large] = 3.0
    keys = random_keys(2, steps[0])
    for seed, step in enumerate(steps[1:]):
        turn = between(*random_keys(2, step, seed))
        keys = np.vstack([keys, multiply(keys[-1], turn)])
    instants = np.cumsum(np.random.default_rng(1).uniform(0.4, 1.0, 12))
    given = {"keys": keys, "times": instants if times == "uneven" else times}
    if ends == "clamped":
        given |= {"start": ends, "omega_start": [0.5, 1, 0], "end": ends, "omega_end": [0, 0, -1]}
    reference = METHODS["c2_cumulative"](**given)
    sizes = []

    def correct(*arguments):
        sizes.append(loaded.correct(*arguments))
        return sizes[-1]

    numpy_kernel.find, numpy_kernel.correct = loaded.find, correct
    curve = METHODS["c2_cumulative"](**given)
    assert np.abs(curve.increments - reference.increments).max() <= 1e-13
    assert len(sizes) > 4
    assert max(sizes) < np.inf


def test_a_correction_that_cannot_be_compiled_is_left_to_numpy(loaded, numpy_kernel, random_keys):
    given = {"keys": random_keys(12, 3.0), "times": "uniform"}
    reference = METHODS["c2_cumulative"](**given)
    numpy_kernel.correct = lambda *_: np.inf
    curve = METHODS["c2_cumulative"](**given)
    assert np.array_equal(curve.increments, reference.increments)


@pytest.mark.parametrize("inertia", [None, [3.0, 2.0, 1.0], np.diag([3.0, 2.0, 1.5]) + 0.3])
@pytest.mark.parametrize(("order", "spans"), [(4, 2), (4, 3), (5, 2), (6, 3)])
@pytest.mark.parametrize("step", [1e-3, 1.0, 2.9])
def test_both_kernels_find_the_same_effort_and_derivatives(
    loaded, numpy_kernel, random_keys, monkeypatch, inertia, order, spans, step
):
    seen = []
    plain = EffortEquations.linearised

    def linearised(equations, increments):
        seen.append((equations, increments))
        return plain(equations, increments)

    monkeypatch.setattr(EffortEquations, "linearised", linearised)
    given = {"keys": random_keys(6, step), "inertia": inertia, "order": order, "spans": spans}
    METHODS["minimum_effort"](**given)
    for equations, increments in seen:
        numpy_kernel.linearise = None
        reference = plain(equations, increments)
        numpy_kernel.linearise = loaded.linearise
        found = plain(equations, increments)
        for name in ("effort", "gradient", "squares", "bound"):
            expected = np.asarray(getattr(reference, name))
            gap = np.abs(np.asarray(getattr(found, name)) - expected).max()
            assert gap <= 1e-13 * np.abs(expected).max()
        assert np.abs(found.missed - reference.missed).max() <= 1e-14


def test_increments_that_are_not_numbers_are_not_found(loaded):
    equations = [
        np.array([[0, 1], [1, 2]]),
        np.full((2, 2), 0.5),
        np.array([[0.1, 0.0, 0.0], [np.nan, 0.0, 0.0]]),
        np.zeros((1, 3)),
        np.empty((0, 3)),
    ]
    assert not loaded.find(*equations, 0.0, 0.0, np.empty((2, 3)))


def test_without_numba_numpy_serves_on(monkeypatch):
    monkeypatch.setattr(fast, "find_spec", lambda name: None)
    kernel = fast.FastKernel()
    assert not kernel.wait_ready(60.0)
    assert kernel.status is fast.Status.MISSING
    assert kernel.find is None


def test_a_numba_that_does_not_work_is_reported_not_raised(monkeypatch):
    def broken(name):
        raise RuntimeError("no compiler here")

    monkeypatch.setattr(fast, "find_spec", lambda name: object())
    monkeypatch.setattr(fast, "import_module", broken)
    kernel = fast.FastKernel()
    assert not kernel.wait_ready(60.0)
    assert kernel.status is fast.Status.FAILED
    assert str(kernel.error) == "no compiler here"


ENDS = {
    "natural": lambda side, rng: {side: "natural"},
    "clamped": lambda side, rng: {side: "clamped", f"omega_{side}": rng.normal(size=3)},
    "state": lambda side, rng: {
        side: "state",
        f"omega_{side}": rng.normal(size=3),
        f"alpha_{side}": rng.normal(size=3),
    },
}


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("start", ENDS)
@pytest.mark.parametrize("count", [2, 3, 4, 30])
@pytest.mark.parametrize("align", [True, False])
def test_both_find_the_same_spline(loaded, numpy_kernel, start, end, count, align):
    rng = np.random.default_rng(count)
    keys = [np.array([1.0, 0.0, 0.0, 0.0])]
    for turn in exp(rng.normal(size=(count - 1, 3)) * 0.4):
        keys.append(multiply(keys[-1], turn))
    given = {
        "keys": np.array(keys) * (rng.choice([-1.0, 1.0], count)[:, None] if align else 1.0),
        "times": np.cumsum(rng.uniform(0.2, 2.0, count)),
        "align": align,
        **ENDS[start]("start", rng),
        **ENDS[end]("end", rng),
    }
    reference = METHODS["c2_cumulative"](**given)
    numpy_kernel.interpolate = loaded.interpolate
    found = METHODS["c2_cumulative"](**given)
    assert found.knots.tolist() == reference.knots.tolist()
    assert np.abs(found.increments - reference.increments).max() <= 1e-13
    times = np.linspace(*found.domain, 100)
    assert_close(reference.evaluate(times), found.evaluate(times))


def test_what_the_compiled_search_does_not_find_at_once_is_found(loaded, numpy_kernel):
    rng = np.random.default_rng(0)
    keys = [np.array([1.0, 0.0, 0.0, 0.0])]
    for axis in rng.normal(size=(20, 3)):
        keys.append(multiply(keys[-1], exp(3.1 * axis / np.linalg.norm(axis))))
    numpy_kernel.interpolate = loaded.interpolate
    curve = METHODS["c2_cumulative"](keys=keys, times=np.arange(21.0))
    assert angle(curve.evaluate(np.arange(21.0))[0], keys).max() < 1e-11


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
