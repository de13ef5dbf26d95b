"""Reports of a motion to its clients, as bytes."""

import numpy as np
import pytest

from orientd.daemon.planners import reporting
from orientd.errors import RequestError
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner import planning
from orientd.planner.state import State
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import samples


@pytest.fixture(scope="module")
def motion():
    keyframes = [
        Keyframe((1.0, 0.0, 0.0, 0.0), position=(0.0, 0.0, 0.0)),
        Keyframe((0.8, 0.6, 0.0, 0.0), position=(0.1, -0.2, 0.3)),
    ]
    start = State.at_rest(keyframes[0].q)
    return planning.plan(MotionRequest(keyframes), start=start, limits=DEFAULT_LIMITS, period=0.002)


@pytest.mark.parametrize("rate_hz", [500.0, 33.3])
def test_samples_are_read_back_as_they_are(motion, rate_hz):
    plan = pb.Plan.FromString(reporting.plan_samples(motion, rate_hz))
    read, meant = samples(plan), reporting.samples_of(motion, rate_hz)
    for name in ("times", "q", "omega_body", "alpha_body", "position", "velocity"):
        np.testing.assert_array_equal(getattr(read, name), getattr(meant, name))


def test_a_plan_and_its_samples_are_put_one_behind_the_other(motion):
    plan = reporting.plan_of(motion)
    both = pb.Plan.FromString(plan.SerializeToString() + reporting.plan_samples(motion, 50.0))
    assert both.motion_id == motion.id
    assert both.HasField("samples")
    both.ClearField("samples")
    assert both == plan


def test_more_samples_than_a_message_holds_are_refused(motion):
    with pytest.raises(RequestError, match="more than 300000 samples"):
        reporting.plan_samples(motion, 1e9)
