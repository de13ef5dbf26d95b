"""Pictures of motions: they are drawn, whatever the motion; what cannot be written is said."""

import numpy as np
import pytest

from orientd import planner
from orientd.errors import OrientdError
from orientd.rotation import exp

plots = pytest.importorskip("orientd.plots")

START = (1.0, 0.0, 0.0, 0.0)


def motion(count=3):
    turns = np.cumsum(np.tile([0.05, 0.02, 0.1], (count, 1)), axis=0)
    keyframes = [planner.Keyframe(tuple(q)) for q in exp(turns)]
    request = planner.MotionRequest(keyframes, approach=True)
    return planner.plan(
        request,
        start=planner.State.at_rest(START),
        limits=planner.DEFAULT_LIMITS,
        period=0.002,
    )


def test_plot_of_a_motion_names_the_function_that_draws_it(tmp_path):
    with pytest.raises(OrientdError, match=r"orientd\.plots\.draw\(motion, path\)"):
        motion().plot(tmp_path / "motion.png")


@pytest.mark.parametrize("has_feedback", [True, False])
def test_what_was_sent_is_drawn(tmp_path, has_feedback):
    times = np.arange(0.0, 1.0, 0.002)
    q = exp(np.outer(times, [0.0, 0.0, 0.5]))
    omega = np.tile([0.0, 0.0, 0.5], (len(times), 1))
    traces = plots.Traces(
        times, q, omega, 0.0 * omega, np.array([0.0, 0.998]), q[[0, -1]], 2.5, 17.0
    )
    error = np.full(len(times), 0.003 if has_feedback else np.nan)
    timing = plots.Timing(times, np.zeros(len(times)), error, 0.002)
    path = tmp_path / "sent.svg"
    plots.draw_sent(path, traces, timing, title="sent")
    assert ("tracking error" in path.read_text()) is has_feedback
