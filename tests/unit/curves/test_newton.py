"""The homotopy, on equations whose roots are known."""

from __future__ import annotations

import numpy as np

from orientd.curves.newton import homotopy, newton
from orientd.rotation import Floats


def dense(errors, jacobian):  # type: ignore[no-untyped-def]
    """Equations in a space of numbers, solved with a full matrix."""
    return lambda x: (errors(x), lambda: np.linalg.solve(jacobian(x), -errors(x)))


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
