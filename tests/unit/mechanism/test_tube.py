"""The taut string against a brute-force shortest path, and the rounding of its bends."""

import numpy as np
import pytest

from orientd.mechanism.pole import taut_string
from orientd.mechanism.timing import smooth


def test_string_through_an_open_tube_is_straight():
    line = taut_string(np.full(11, -np.inf), np.full(11, np.inf), 1.0, 3.0)
    assert np.allclose(line, np.linspace(1, 3, 11), atol=1e-15)


def test_string_through_a_closed_tube_is_the_tube():
    walls = np.sin(np.linspace(0, 5, 50))
    assert np.allclose(taut_string(walls, walls, walls[0], walls[-1]), walls, atol=1e-15)


@pytest.mark.parametrize("seed", range(20))
def test_string_is_inside_and_bends_only_at_walls_and_towards_them(seed):
    rng = np.random.default_rng(seed)
    middle = np.cumsum(rng.normal(size=80))
    low, high = middle - rng.uniform(0, 3, 80), middle + rng.uniform(0, 3, 80)
    line = taut_string(low, high, middle[0], middle[-1])
    assert line[0] == middle[0]
    assert line[-1] == pytest.approx(middle[-1], abs=1e-12)
    assert np.all(line[1:-1] >= low[1:-1] - 1e-12)
    assert np.all(line[1:-1] <= high[1:-1] + 1e-12)
    # What makes it the shortest: convex bends lean on the lower wall, concave ones on the upper.
    bend = np.diff(line, 2)
    assert np.all(np.abs(line[1:-1] - high[1:-1])[bend > 1e-9] < 1e-9)
    assert np.all(np.abs(line[1:-1] - low[1:-1])[bend < -1e-9] < 1e-9)


def test_closed_tube_is_refused_with_its_place():
    with pytest.raises(ValueError, match="closed at sample 2"):
        taut_string([0, 0, 2, 0], [1, 1, 1, 1], 0, 0)


def test_smoothing_keeps_ends_and_bounds_the_bend():
    line = np.concatenate([np.linspace(0, 10, 101), np.linspace(10, 0, 101)[1:]])
    rounded = smooth(line, 10)
    assert rounded[[0, -1]] == pytest.approx(line[[0, -1]], abs=1e-12)
    assert np.max(np.abs(np.diff(rounded, 2))) <= 2 * 0.1 / 21 + 1e-12
    assert np.allclose(smooth(line, 0), line)
