"""The rounding of bends."""

import numpy as np
import pytest

from orientd.mechanism.timing import smooth


def test_smoothing_keeps_ends_and_bounds_the_bend():
    line = np.concatenate([np.linspace(0, 10, 101), np.linspace(10, 0, 101)[1:]])
    rounded = smooth(line, 10)
    assert rounded[[0, -1]] == pytest.approx(line[[0, -1]], abs=1e-12)
    assert np.max(np.abs(np.diff(rounded, 2))) <= 2 * 0.1 / 21 + 1e-12
    assert np.allclose(smooth(line, 0), line)
