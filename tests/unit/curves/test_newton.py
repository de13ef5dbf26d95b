"""Newton's method, the homotopy and the multistart, on problems whose answers are known."""

from __future__ import annotations

import numpy as np
import pytest

from orientd.curves.newton import homotopy, multistart, newton
from orientd.rotation import Floats, angle, conjugate, exp, log, multiply


def dense(errors, jacobian):  # type: ignore[no-untyped-def]
    """Equations in a space of numbers, solved with a full matrix."""
    return lambda x: (errors(x), lambda: np.linalg.solve(jacobian(x), -errors(x)))


def _circle_and_line(x: Floats) -> Floats:
    return np.array([x[0] ** 2 + x[1] ** 2 - 4.0, x[0] - x[1]])


def _circle_and_line_jacobian(x: Floats) -> Floats:
    return np.array([[2.0 * x[0], 2.0 * x[1]], [1.0, -1.0]])


def test_a_root_is_found_to_rounding() -> None:
    found = newton(dense(_circle_and_line, _circle_and_line_jacobian), np.array([3.0, 0.5]))
    assert found is not None
    np.testing.assert_allclose(found, np.sqrt([2.0, 2.0]), rtol=0.0, atol=1e-14)


def test_damping_brings_in_a_guess_from_which_whole_steps_diverge() -> None:
    equations = dense(np.arctan, lambda x: np.diag(1.0 / (1.0 + x * x)))
    found = newton(equations, np.array([20.0]), longest=np.inf)
    assert found is not None
    assert abs(found[0]) < 1e-14


def test_a_singular_jacobian_and_a_missing_root_give_nothing() -> None:
    assert newton(dense(lambda x: x * x - 1.0, lambda x: np.diag(2.0 * x)), np.zeros(1)) is None
    rootless = dense(lambda x: x * x + 1.0, lambda x: np.diag(2.0 * x))
    assert newton(rootless, np.array([0.7])) is None


def test_a_state_may_be_an_orientation() -> None:
    target = exp(np.array([0.3, -2.0, 1.1]))

    def equations(q: Floats):  # type: ignore[no-untyped-def]
        error = log(multiply(conjugate(target), q))
        return error, lambda: -error

    found = newton(equations, np.array([1.0, 0.0, 0.0, 0.0]), move=lambda q, v: multiply(q, exp(v)))
    assert found is not None
    assert angle(found, target) < 1e-14


def _near_sine(scale: float, guess: Floats) -> Floats | None:
    """Solve x + sin 3x = 9 scale, whose roots are three in places."""
    equations = dense(
        lambda x: x + 0.3 * np.sin(3.0 * x) - 9.0 * scale,
        lambda x: np.diag(1.0 + 0.9 * np.cos(3.0 * x)),
    )
    found = newton(equations, guess)
    return None if found is None or abs(found[0] - guess[0]) > 0.3 else found


def test_a_homotopy_arrives_where_one_step_does_not() -> None:
    rate = np.array([9.0 / 1.9])
    assert _near_sine(1.0, rate) is None
    found, reached = homotopy(_near_sine, np.zeros(1), rate)
    assert reached == 1.0
    assert abs(found[0] + 0.3 * np.sin(3.0 * found[0]) - 9.0) < 1e-14


def test_a_homotopy_that_ends_says_where() -> None:
    def solve(scale: float, guess: Floats) -> Floats | None:
        return guess if scale <= 0.3 else None

    _, reached = homotopy(solve, np.zeros(1), np.ones(1))
    assert 0.298 < reached <= 0.3


def test_a_multistart_finds_the_lowest_of_several_minima() -> None:
    def values(x: Floats) -> Floats:
        bowl: Floats = np.sum((x - 2.0) ** 2, axis=1) / 40.0 - np.sum(np.cos(3.0 * x), axis=1)
        return bowl

    def derivatives(x: Floats) -> tuple[Floats, Floats]:
        curvature = 1.0 / 20.0 + 9.0 * np.cos(3.0 * x)
        return (x - 2.0) / 20.0 + 3.0 * np.sin(3.0 * x), curvature[..., None] * np.eye(2)

    starts = np.random.default_rng(1).uniform(-6.0, 6.0, (200, 2))
    best, value = multistart(values, derivatives, starts, move=np.add)
    grid = np.stack(np.meshgrid(*[np.linspace(-6.0, 6.0, 401)] * 2), axis=-1).reshape(-1, 2)
    assert value <= values(grid).min()
    np.testing.assert_allclose(derivatives(best[None])[0], 0.0, rtol=0.0, atol=1e-12)


def test_a_multistart_keeps_out_of_where_values_are_infinite() -> None:
    def values(x: Floats) -> Floats:
        inside: Floats = np.where(
            x[:, 0] > 0.0, x[:, 0] + 1.0 / np.maximum(x[:, 0], 1e-300), np.inf
        )
        return inside

    def derivatives(x: Floats) -> tuple[Floats, Floats]:
        return 1.0 - 1.0 / x**2, (2.0 / x**3)[..., None]

    best, value = multistart(values, derivatives, np.array([[-3.0], [9.0], [0.01]]), move=np.add)
    assert abs(best[0] - 1.0) < 1e-7
    assert value == pytest.approx(2.0, abs=1e-14)
