"""Moments of a motion queue that only a servo under control of the test shows."""

from types import SimpleNamespace

import numpy as np
import pytest
from direct_planners import recorded, state_at

from orientd import rotation
from orientd.daemon.device.event import EventKind
from orientd.daemon.device.queue import MotionQueue
from orientd.daemon.device.queued_motion import QueuedMotion, SplicePoint
from orientd.errors import DaemonError, LateError, NotYetError
from orientd.model.limits import DEFAULT_LIMITS
from orientd.model.request import Keyframe, MotionRequest
from orientd.planner.planning import plan
from orientd.planner.state import State
from orientd.stream.memory import SharedMemory
from orientd.stream.records import ServoState, records_to_stop

PERIOD = 0.002


class Link:
    """A servo that takes what it is told, or refuses that."""

    fault_text, now = "", None

    def __init__(self):
        self.memory = SharedMemory.create(8192, 1024)
        self.refusal = None

    def beat(self):
        pass

    def newest(self):
        return self.now

    last = newest

    def running(self):
        return self.memory

    def ask(self, command, **fields):
        if self.refusal is not None:
            raise self.refusal


@pytest.fixture
def link():
    link = Link()
    yield link
    link.memory.close()


def turn(angle, start=(1.0, 0.0, 0.0, 0.0)):
    q = rotation.multiply(start, rotation.exp(np.array([0.0, 0.0, angle])))
    request = MotionRequest([Keyframe(tuple(q))], pace="even")
    start = State.at_rest(start)
    return recorded(plan(request, start=start, limits=DEFAULT_LIMITS, period=PERIOD))


@pytest.mark.parametrize("refusal", [LateError("it has passed"), NotYetError("it changes")])
def test_a_motion_that_cannot_be_blended_any_more_is_not_taken(link, refusal):
    first = turn(0.5)
    motion_queue = MotionQueue(link, print, lead=0.0, read_ahead=700)
    motion_queue.begin(QueuedMotion(first, number=1))
    link.refusal, second = refusal, turn(0.5, state_at(first, 20).q)
    with pytest.raises(type(refusal)):
        motion_queue.append(QueuedMotion(second, number=2), SplicePoint(1, 20))
    assert motion_queue.last.number == 1
    assert motion_queue.last.last_record == first.last_record


def test_a_motion_that_the_servo_has_left_for_one_whose_answer_was_late_has_ended(link):
    told = []
    motion_queue = MotionQueue(link, lambda *what: told.append(what), lead=0.0, read_ahead=700)
    first = turn(0.5)
    motion_queue.begin(QueuedMotion(first, number=1))
    link.refusal = DaemonError("the servo did not answer splice within 0.5 s")
    second = QueuedMotion(turn(0.5, state_at(first, 20).q), number=2)
    with pytest.raises(DaemonError):
        motion_queue.replace(second, SplicePoint(1, 20))
    link.refusal = None
    place = SimpleNamespace(path_index=40, path_fraction=0.0, flags=0, index=40)
    for motion, state in ((1, ServoState.STREAMING), (2, ServoState.STREAMING)):
        link.now = SimpleNamespace(motion=motion, state=state, **vars(place))
        motion_queue.tend()
        assert motion_queue.is_active
    link.now = SimpleNamespace(motion=2, state=ServoState.HOLDING, **vars(place))
    motion_queue.tend()
    assert not motion_queue.is_active
    ((kind, queued, text),) = told
    assert (kind, queued.number) == (EventKind.MOTION_STOPPED, 1)
    assert "its answer came too late" in text


@pytest.mark.parametrize("acceleration", [0.5, 2.0, 5.0, 8.0, 11.0, 14.0, 20.0])
def test_a_slow_servo_has_its_stop_in_the_ring_before_it_begins(link, acceleration):
    """At ten cycles a second a stop takes only a few records, and each of them counts."""
    period = 0.1
    limits = DEFAULT_LIMITS.with_rates({"velocity": 1.0, "acceleration": acceleration})
    keyframes = [Keyframe((np.cos(1.5), 0.0, 0.0, np.sin(1.5)))]
    start = State.at_rest((1.0, 0.0, 0.0, 0.0))
    motion = recorded(plan(MotionRequest(keyframes), start=start, limits=limits, period=period))
    motion_queue = MotionQueue(link, print, lead=0.0, read_ahead=128)
    motion_queue.begin(QueuedMotion(motion, number=1))
    # The servo starts from the first record.
    stop = records_to_stop(motion.facts.brake_rate, period)
    assert link.memory.path.head - 1 >= min(stop, motion.last_record)
