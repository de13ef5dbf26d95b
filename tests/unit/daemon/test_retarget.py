"""Where a motion takes over from another one, and what is tried if it cannot begin there."""

import asyncio
import math
from types import SimpleNamespace

import numpy as np
import pytest
from direct_planners import DirectPlanners, order_of, state_at

from orientd import config
from orientd.daemon.device import retarget
from orientd.daemon.device.queued_motion import QueuedMotion, SplicePoint
from orientd.daemon.device.retarget import ReplanningHorizon, Retargeting
from orientd.daemon.planners.messages import record_at_rest
from orientd.daemon.workers import DeviceWorkers
from orientd.driver import ZERO
from orientd.errors import LimitError
from orientd.model.limits import Limits
from orientd.model.request import Keyframe, MotionRequest
from orientd.stream.records import Command, ServoState

PERIOD = 0.002
LIMITS = {"velocity": 2.0, "acceleration": 8.0, "jerk": 80.0}
SETTINGS = {"devices": {"arm": {"driver": "loopback", "limits": LIMITS}}}
HERE = (0.5514504154031046, 0.49253528249101486, -0.4722507457480207, -0.47988609897941176)
AIM = (0.49571101017829, -0.089257329299611, -0.5334378595928744, -0.6795202524629367)
OTHER = (0.35431759385143013, 0.1360839929634544, -0.6275530104419681, -0.6797921804725902)
KIND = (8, False)
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
    request = to(AIM).beginning("arm", record_at_rest(HERE, ZERO, ()))
    return asyncio.run(planners.plan(request))


class Queue:
    """A queue with one motion, which the servo is a given number of records before the end of."""

    def __init__(self, first, leave):
        self.first, self.leave = first, leave
        self.last = SimpleNamespace(number=leave.number)
        self.is_active, self.asked = True, 0

    def queued(self, number):
        return QueuedMotion(planned=self.first, number=number)

    def ahead(self, cycle, records):
        self.asked += records > 0
        return self.leave if records else SplicePoint(self.leave.number, 0)


class Servo:
    """A servo that streams, until it is told to stop."""

    def __init__(self):
        self.state = ServoState.STREAMING

    def newest(self):
        return SimpleNamespace(state=self.state, deadline_ns=0, motion=1, path_index=0)

    def ask(self, command):
        assert command is Command.STOP
        self.state = ServoState.HOLDING


def successor(planners, first, order, leave, *, queue=None):
    """Return where a motion takes over from the first one, the motion, and how often was chosen."""
    servo, queue = Servo(), queue or Queue(first, leave)
    retargeting = Retargeting(
        servo, queue, planners, name="arm", period=PERIOD, workers=DeviceWorkers("arm")
    )
    found = retargeting._take_over(QueuedMotion(), order, KIND, (), leave)
    _, record, motion = asyncio.run(found)
    return record, motion, queue.asked, servo.state


def test_a_motion_that_cannot_begin_where_a_device_gains_speed_begins_a_little_later(
    planners, first
):
    leave = SplicePoint(1, RISING)
    records, order = first.start_at(RISING), to(OTHER, limits=GENTLE)
    with pytest.raises(LimitError, match="in the lead-in") as refused:
        asyncio.run(planners.plan(order.beginning("arm", records)))
    assert refused.value.is_in_lead_in
    later, motion, chosen, _ = successor(planners, first, order, leave)
    assert later.record == RISING + round(0.15 / PERIOD)
    assert chosen == 1
    begun, left = state_at(motion, 0), state_at(first, later.record)
    assert np.abs(begun.q - left.q).max() < 1e-15
    assert begun.omega_body == pytest.approx(left.omega_body, abs=1e-12)


def test_a_motion_that_can_begin_nowhere_on_the_way_begins_at_rest(planners, first, monkeypatch):
    monkeypatch.setattr(retarget, "_LATER", ((0.0,), (0.0,)))
    order = to(OTHER, limits=GENTLE)
    found = successor(planners, first, order, SplicePoint(1, RISING))
    assert found == (None, None, 2, ServoState.HOLDING)


# The replanning horizon


def learnt(*seconds, kind=KIND):
    horizon = ReplanningHorizon()
    for taken in seconds:
        horizon.add(kind, taken)
    return horizon


def test_it_is_longer_than_what_planning_has_taken():
    assert learnt(*[0.02] * 8).ahead(KIND) > 0.02


def test_it_follows_what_planning_takes_within_a_few_motions():
    quick = learnt(*[0.01] * 8).ahead(KIND)
    slow = learnt(*[0.01] * 8, *[0.03] * 3).ahead(KIND)
    assert slow > 0.03 > quick


def test_a_plan_that_was_held_up_does_not_delay_those_after_it():
    usual = learnt(*[0.01] * 8).ahead(KIND)
    assert learnt(0.5, *[0.01] * 4).ahead(KIND) == usual
    assert learnt(*[0.01] * 6, 0.4, 0.01).ahead(KIND) == usual


def test_plans_of_another_kind_do_not_count():
    horizon = learnt(*[0.2] * 8)
    assert horizon.ahead((8, True)) == ReplanningHorizon().ahead(KIND)


def test_a_plan_that_was_too_late_is_followed_by_one_that_has_as_long_as_it_took():
    assert 0.03 < learnt(0.01).ahead(KIND, [0.03]) < 0.04
    assert learnt(0.01).ahead(KIND, [0.001]) == learnt(0.01).ahead(KIND)


def test_each_further_attempt_that_was_too_late_doubles_it():
    horizon = learnt(0.01)
    assert horizon.ahead(KIND, [0.01] * 4) == pytest.approx(8.0 * horizon.ahead(KIND))


def test_a_motion_that_takes_seconds_to_plan_is_in_time_at_last():
    horizon = learnt(3.0)
    assert horizon.ahead(KIND) < 1.0
    assert max(horizon.ahead(KIND, [0.25] * late) for late in range(6)) > 3.0
