"""Taking over from a motion where another one cannot begin at once: a little later on the way."""

import asyncio
import math
import time
from types import SimpleNamespace

import numpy as np
import pytest
from direct_planners import DirectPlanners, order_of

from orientd import config
from orientd.daemon.motions import takeover
from orientd.daemon.motions.motion_queue import MotionQueue
from orientd.daemon.motions.queued_motion import SplicePoint
from orientd.daemon.motions.takeover import Takeover
from orientd.daemon.planners import PlanInput
from orientd.errors import LateError, LimitError
from orientd.planner import Keyframe, Limits, MotionRequest, State

PERIOD = 0.002
LIMITS = {"velocity": 2.0, "acceleration": 8.0, "jerk": 80.0}
SETTINGS = {"devices": {"arm": {"driver": "loopback", "limits": LIMITS}}}
HERE = (0.5514504154031046, 0.49253528249101486, -0.4722507457480207, -0.47988609897941176)
AIM = (0.49571101017829, -0.089257329299611, -0.5334378595928744, -0.6795202524629367)
OTHER = (0.35431759385143013, 0.1360839929634544, -0.6275530104419681, -0.6797921804725902)
RISING = 159
"""A record at which the first motion gains speed just below its limit, at its largest jerk."""
GENTLE = Limits(math.inf, math.inf, 70.0, math.inf, math.inf)
"""Less jerk than that, with which no motion can begin there."""


def to(q, **fields):
    return order_of(MotionRequest([Keyframe(q)], approach=True, **fields))


@pytest.fixture(scope="module")
def planners():
    return DirectPlanners(config.parse(SETTINGS, source="test").devices.values())


@pytest.fixture(scope="module")
def first(planners):
    order = to(AIM)
    job = PlanInput("arm", order.motion, start=State.at_rest(HERE))
    return asyncio.run(planners.plan(job, order))


def successor(planners, first, order, leave, *, cycle=None, ahead=None):
    """Return what takes over from the first motion, and how often a place was chosen anew."""
    chosen = []

    async def choose():
        chosen.append(time.monotonic())
        return leave

    queue = SimpleNamespace(queued=lambda _: SimpleNamespace(motion=first), ahead=ahead)
    link = SimpleNamespace(newest=lambda: cycle)
    takeover = Takeover(link, "arm", planners, queue, PERIOD)
    return asyncio.run(takeover.plan(order, leave, choose, 0)), len(chosen)


def test_a_motion_that_cannot_begin_where_a_device_gains_speed_begins_a_little_later(
    planners, first
):
    leave = SplicePoint(1, RISING)
    state, order = first.state_at(RISING), to(OTHER, limits=GENTLE)
    with pytest.raises(LimitError, match="in the lead-in") as refused:
        asyncio.run(planners.plan(PlanInput("arm", order.motion, start=state), order))
    assert refused.value.is_in_lead_in
    found, chosen = successor(planners, first, order, leave)
    assert found.leave.record == RISING + round(0.15 / PERIOD)
    assert chosen == 1
    begun, left = found.motion.state_at(0), first.state_at(found.leave.record)
    assert np.abs(begun.q - left.q).max() < 1e-15
    assert begun.omega_body == pytest.approx(left.omega_body, abs=1e-12)


def test_a_motion_that_can_begin_nowhere_on_the_way_begins_at_rest(planners, first, monkeypatch):
    monkeypatch.setattr(takeover, "_LATER", ((0.0,), (0.0,)))
    order = to(OTHER, limits=GENTLE)
    assert successor(planners, first, order, SplicePoint(1, RISING)) == (None, 2)


def test_what_nothing_on_the_way_can_mend_is_refused_at_once(planners, first):
    keys = [Keyframe(OTHER, time=0.0), Keyframe(HERE, time=0.01)]
    order = order_of(MotionRequest(keys, approach=True))
    with pytest.raises(LimitError, match="between keyframes"):
        successor(planners, first, order, SplicePoint(1, 20))


def test_a_motion_that_ended_while_its_successor_was_planned_is_too_late(planners, first):
    emptied = MotionQueue(SimpleNamespace(memory=None), lead=0.0, read_ahead=0)
    cycle = SimpleNamespace(motion=1, path_index=0)
    with pytest.raises(LateError, match="has ended"):
        successor(planners, first, to(AIM), SplicePoint(1, 20), cycle=cycle, ahead=emptied.ahead)
