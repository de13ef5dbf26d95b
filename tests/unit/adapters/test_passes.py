"""When the pass of a known target is planned once more."""

import time

import numpy as np
import pytest

from orientd.adapters.passes import Passes
from orientd.adapters.sky import Target
from orientd.errors import DeadlineError, PlanError

POINT = np.array([1.0, 0.0, 0.0])


class Refusing:
    """A device whose daemon plans nothing."""

    name = "antenna"

    def __init__(self, error):
        self.asked, self.robot, self._error = 0, self, error

    def rest(self):
        pass

    def plan(self, request, *, device):
        self.asked += 1
        raise self._error


def asked_twice(error, rise):
    """Return how often a pass is planned for which a client asks twice, *rise* s before it."""
    begin = time.time() + rise

    def at(times):
        height = 0.01 * (np.asarray(times) - begin)
        height[times > begin + 100.0] = -0.1
        return np.stack([np.cos(height), np.zeros(len(height)), np.sin(height)], axis=-1)

    served = Refusing(error)
    passes = Passes(served, [Target("one", at)], north=0.0, notify=lambda _: None)
    for _ in range(2):
        passes.takes(POINT)
        planning = passes._planning
        if planning is not None:
            planning.join()
    return served.asked


@pytest.mark.parametrize(
    ("error", "rise", "count"),
    [
        (DeadlineError("planning took longer than 10 s"), 50.0, 2),
        (DeadlineError("planning took longer than 10 s"), -0.5, 1),
        (PlanError("the axes cannot follow"), 50.0, 1),
    ],
)
def test_a_plan_that_took_too_long_is_tried_again_before_the_rise_only(error, rise, count):
    assert asked_twice(error, rise) == count
