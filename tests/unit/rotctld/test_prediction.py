"""Predictions from the positions that gpredict really sent, and from those of steady programs.

``tests/data/gpredict`` has the positions of two passes as gpredict 2.3 sent them, with its cycle of
1000 ms and a threshold of 0.1 degrees, and the true directions at those times by sgp4.
"""

from pathlib import Path

import numpy as np
import pytest

from orientd_rotctld.pointer import vector
from orientd_rotctld.prediction import Prediction
from orientd_serving.pointing import Direction

DATA = Path(__file__).parents[2] / "data" / "gpredict"


def misses(times, sent, true, rounding):
    """Return the angle by which each position after the tenth was predicted wrongly, degrees."""
    prediction, found = Prediction(rounding=np.radians(rounding)), []
    for row, time in enumerate(times):
        if row > 10:
            found.append(np.linalg.norm(prediction.at(time) - vector(Direction(*true[row]))))
        prediction = prediction.added(time, vector(Direction(*sent[row])))
    return np.degrees(found)


@pytest.mark.parametrize(("name", "most"), [("zenith", 0.6), ("north", 0.3)])
def test_positions_that_come_early_and_late_are_smoothed(name, most):
    rows = np.loadtxt(DATA / f"{name}.csv", delimiter=",", skiprows=1)
    found = misses(rows[:, 0], rows[:, 1:3], rows[:, 3:5], 0.005)
    assert np.quantile(found, 0.95) < most


def test_a_steady_target_is_predicted_to_the_rounding():
    times = np.arange(40.0)
    places = np.column_stack([100.0 + 1.5 * times, 20.0 + 30.0 * np.sin(0.03 * times)])
    assert np.max(misses(times, np.round(places, 2), places, 0.005)) < 0.02


def test_a_quick_target_on_a_circle_is_predicted():
    times = 0.5 * np.arange(40.0)
    places = np.column_stack([20.0 * np.cos(0.4 * times), 40.0 + 20.0 * np.sin(0.4 * times)])
    assert np.max(misses(times, places, places, 0.005)) < 0.15
