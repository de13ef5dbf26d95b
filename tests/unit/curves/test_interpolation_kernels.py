"""The kernels of interpolation against plain NumPy, SciPy and mpmath."""

import mpmath
import numpy as np
import pytest
import scipy.linalg
from reference.keyframe_equations import effort, keyframe_equations

from orientd import kernels
from orientd.curves import METHODS
from orientd.curves.construct.banded import solve_banded
from orientd.curves.construct.basis import cumulative_basis
from orientd.curves.construct.interpolation import KeyframeEquations
from orientd.rotation import align, between, exp_half, log_half

COUNT = 100
"""Keyframes: more than a strand of the kernel has rows."""


def equations_and_increments(start="natural", end="natural", step=0.5, seed=0):
    """Equations of a spline over uneven intervals, and increments that do not solve them."""
    rng = np.random.default_rng(seed)
    begun = rng.uniform([0.6, 0.05], [0.9, 0.3], (COUNT, 2))
    begun[0] = (1, 0) if start == "state" else (0, 0)
    begun[-1] = (1, 0) if end == "state" else (1, 1)
    known = {"natural": 0, "clamped": 1, "state": 2}
    equations = KeyframeEquations(
        steps=step * rng.normal(size=(COUNT - 1, 3)),
        begun=begun,
        heads=step * rng.normal(size=(known[start], 3)),
        tails=step * rng.normal(size=(known[end], 3)),
        start_ratio=0.4,
        end_ratio=0.7,
    )
    return equations, step * rng.normal(size=(COUNT - 1, 3))


def reference(equations, unknown, scale):
    """The whole Jacobian and the errors, from the factors of each row one by one."""
    rows = len(unknown)
    heads, tails = scale * equations.heads, scale * equations.tails[::-1]
    first, last = max(1, len(heads)), max(1, len(tails))
    increments = np.concatenate(
        [
            heads if len(heads) else equations.start_ratio * unknown[:1],
            unknown,
            tails if len(tails) else equations.end_ratio * unknown[-1:],
        ]
    )
    jacobian, errors = np.zeros((rows, 3, len(increments), 3)), np.empty((rows, 3))
    for i in range(rows):
        middle = i + first
        (a, b), (c, d) = equations.begun[i : i + 2]
        index, share = [middle, middle - 1, middle, middle + 1], [-b, 1.0 - a, c, d]
        if i == 0 and first == 2:
            index, share = [0, 1, *index], [1.0, 1.0, *share]
        if i == rows - 1 and last == 2:
            index, share = [*index, middle + 1, middle + 2], [*share, 1.0, 1.0]
        target = exp_half(scale * equations.steps[i : i + 1])
        derivatives, error = keyframe_equations(
            increments, np.array([index]), np.array([share]), target
        )
        errors[i] = error[0]
        for f, j in enumerate(index):
            jacobian[i, :, j] += derivatives[0, :, 3 * f : 3 * f + 3]
    if not len(heads):
        jacobian[:, :, 1] += equations.start_ratio * jacobian[:, :, 0]
    if not len(tails):
        jacobian[:, :, -2] += equations.end_ratio * jacobian[:, :, -1]
    free = jacobian[:, :, first : len(increments) - last]
    return free, errors


ENDS = ["natural", "clamped", "state"]


@pytest.mark.parametrize("start", ENDS)
@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize(("step", "scale"), [(1e-6, 1.0), (0.4, 1.0), (0.8, 0.3)])
def test_a_correction_is_a_newton_step_of_the_rows_it_is_for(start, end, step, scale):
    equations, unknown = equations_and_increments(start, end, step)
    jacobian, errors = reference(equations, unknown, scale)
    everything = np.arange(COUNT - 1)
    for rows in (everything, everything[5:9], np.array([0, 1, 2, 7, 8, 20, COUNT - 2])):
        part = jacobian[rows][:, :, rows]
        part *= np.abs(rows[:, None] - rows)[:, None, :, None] <= 1
        expected = np.linalg.solve(part.reshape(3 * len(rows), -1), -errors[rows].ravel()).reshape(
            -1, 3
        )
        found = equations.correction(unknown, scale, rows)
        assert np.abs(found - expected).max() <= 1e-12 * np.abs(expected).max()
        gaps = equations.errors(unknown, scale, rows) - errors[rows]
        # The last one is seen before the increments that are known at the end.
        assert np.abs(gaps[rows < COUNT - 2 if end == "state" else rows >= 0]).max() <= 3e-15


def test_a_correction_can_cancel_errors_of_ones_own():
    equations, unknown = equations_and_increments()
    rows = np.arange(3, 30)
    errors = equations.errors(unknown, 0.7, rows)
    expected = equations.correction(unknown, 0.7, rows)
    assert np.array_equal(equations.correction(unknown, 0.7, rows, errors), expected)


def test_a_correction_of_what_is_not_a_number_is_not_one():
    equations, unknown = equations_and_increments()
    unknown[7, 1] = np.nan
    assert not np.isfinite(equations.correction(unknown, 1.0, np.arange(COUNT - 1))).all()


def test_increments_that_are_not_numbers_are_not_found():
    equations, _ = equations_and_increments()
    equations.steps[3, 0] = np.nan
    assert equations.find(np.empty_like(equations.steps), 0) == 0


@pytest.mark.parametrize("lower", [0, 1, 4])
@pytest.mark.parametrize("upper", [0, 2, 5])
@pytest.mark.parametrize("size", [1, 3, 50])
def test_banded_systems_are_solved_as_by_lapack(lower, upper, size):
    rng = np.random.default_rng(size)
    lower, upper = min(lower, size - 1), min(upper, size - 1)
    band, right = rng.normal(size=(lower + upper + 1, size)), rng.normal(size=(size, 2))
    band[upper] += 3.0 * (-1.0) ** np.arange(size)
    expected = scipy.linalg.solve_banded((lower, upper), band, right)
    found = solve_banded(lower, upper, band, right)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
    assert np.array_equal(solve_banded(lower, upper, band, right[:, 0]), found[:, 0])


@pytest.mark.parametrize("value", [0.0, np.nan, np.inf])
def test_a_singular_banded_system_is_refused(value):
    band = np.ones((3, 6))
    band[1] = 4.0
    band[:, 3] = value
    with pytest.raises(np.linalg.LinAlgError):
        solve_banded(1, 1, band, np.ones(6))


@pytest.mark.parametrize("inertia", [None, [3.0, 2.0, 1.0], np.diag([3.0, 2.0, 1.5]) + 0.3])
@pytest.mark.parametrize(("order", "spans"), [(4, 2), (4, 3), (5, 2), (6, 3)])
@pytest.mark.parametrize("step", [1e-3, 1.0, 2.9])
def test_effort_and_derivatives_are_those_of_numpy(
    random_keys, monkeypatch, inertia, order, spans, step
):
    seen = []
    linearise = kernels.linearise_effort

    def noted(*arguments):
        effort_there = linearise(*arguments)
        seen.append((effort_there, *(np.copy(argument) for argument in arguments)))
        return effort_there

    monkeypatch.setattr("orientd.curves.optimal.effort_equations.linearise_effort", noted)
    given = {"keys": random_keys(6, step), "inertia": inertia, "order": order, "spans": spans}
    METHODS["minimum_effort"](**given)
    assert seen
    for found, w, window, weights, roots, matrix, index, share, steps, *written in seen:
        window = window.reshape(-1, weights.shape[1])
        expected = effort(w, window, weights, roots, matrix if len(matrix) else None)
        bound, missed = keyframe_equations(w, index.reshape(share.shape), share, steps)
        for one, other in zip((found, *written[:3]), (*expected, bound), strict=True):
            assert np.abs(one - other).max() <= 1e-13 * np.abs(other).max()
        assert np.abs(written[3] - missed).max() <= 1e-14


@pytest.mark.parametrize("start", ENDS)
@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("count", [2, 3, 4, 40])
def test_the_table_is_that_of_the_cumulative_basis(random_keys, start, end, count):
    rng = np.random.default_rng(count)
    given = {
        f"{quantity}_{side}": 0.3 * rng.normal(size=3)
        for side, condition in (("start", start), ("end", end))
        for quantity in {"natural": (), "clamped": ("omega",)}.get(condition, ("omega", "alpha"))
    }
    times = np.cumsum(rng.choice([0.3, 1.0, 2.0], count))
    curve = METHODS["c2_cumulative"](
        keys=random_keys(count, 0.7), times=times, start=start, end=end, **given
    )
    breaks = curve.knots
    knots = np.concatenate([np.repeat(breaks[0], 3), breaks, np.repeat(breaks[-1], 3)])
    basis, table = cumulative_basis(knots, 4), curve.table
    lengths = np.linalg.norm(curve.increments, axis=1)
    change = np.diff(basis.curvatures, axis=2)[..., 0] / np.diff(breaks)[:, None]
    for f in range(3):
        length, rows = lengths[f : f + len(breaks) - 1], table[4 + 7 * f : 11 + 7 * f]
        for row, part in zip(
            rows,
            (
                basis.values[:, f, 0],
                basis.rates[:, f, 0],
                basis.curvatures[:, f, 0] / 2.0,
                change[:, f] / 6.0,
            ),
            strict=False,
        ):
            assert row == pytest.approx(length * part, rel=1e-12, abs=1e-15 * np.abs(row).max())
        part = curve.increments[f : f + len(length)]
        assert np.abs((rows[4:] * length).T - part).max() <= 1e-15


def test_steps_have_all_digits_at_both_sides_of_every_seam():
    mpmath.mp.dps = 40
    angles = [
        base + sign * offset
        for base in (0.0, np.pi / 4, np.pi / 2, 3 * np.pi / 4, np.pi)
        for offset in (0.0, 1e-300, 1e-160, 1e-17, 1e-16, 1e-9, 1e-3, 0.3)
        for sign in (-1.0, 1.0)
    ]
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    keys = np.array([[np.cos(x), *np.sin(x) * axis] for x in angles if 0.0 <= x <= np.pi])
    for q in keys:
        steps = np.empty((1, 3))
        kernels.put_steps(np.stack([[1.0, 0.0, 0.0, 0.0], q]), steps)
        turn = [mpmath.mpf(float(x)) for x in between([1.0, 0.0, 0.0, 0.0], q)]
        length = mpmath.sqrt(sum(x * x for x in turn[1:]))
        if not length:
            continue
        factor = mpmath.atan2(length, turn[0]) / length
        for found, part in zip(steps[0], turn[1:], strict=True):
            # Squares of what is below 1e-154 vanish, as everywhere.
            if length > 1e-150:
                assert abs(mpmath.mpf(float(found)) - factor * part) <= 9e-16 * abs(factor * part)


def test_steps_are_logarithms_of_turns():
    keys = align(np.random.default_rng(1).normal(size=(101, 4)))
    keys /= np.linalg.norm(keys, axis=1)[:, None]
    steps = np.empty((100, 3))
    kernels.put_steps(keys, steps)
    assert np.abs(steps - log_half(between(keys[:-1], keys[1:]))).max() <= 1e-15


def test_shapes_that_do_not_belong_together_are_refused():
    keys, steps = np.zeros((5, 4)), np.zeros((5, 3))
    with pytest.raises(ValueError, match="shapes"):
        kernels.put_steps(keys, steps)
    equations, unknown = equations_and_increments()
    for rows in ([0, COUNT - 1], [-1, 0], [2, 2], [3, 2]):
        with pytest.raises(ValueError, match="shapes"):
            equations.correction(unknown, 1.0, np.array(rows))
    with pytest.raises(ValueError, match="shapes"):
        kernels.solve_banded(np.ones((3, 4)), 1, 1, np.ones((3, 1)))


def test_equations_of_effort_take_no_increments_that_are_not_there():
    with pytest.raises(ValueError, match="shapes"):
        kernels.linearise_effort(
            np.zeros((3, 3)), np.array([0, 1, 3]), np.zeros((3, 3, 2)), np.ones(2),
            np.empty((0, 3)), np.array([0, 1]), np.ones((1, 2)), np.ones((1, 4)),
            np.empty((1, 9)), np.empty((1, 9, 9)), np.empty((1, 3, 6)), np.empty((1, 3)),
        )  # fmt: skip
