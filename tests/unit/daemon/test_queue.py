"""Contents of the path ring for a motion queue, with a servo that the test controls."""

from types import SimpleNamespace

import numpy as np
import pytest
from direct_planners import recorded, state_at

from orientd import planner, rotation
from orientd.daemon.device.event import EventKind
from orientd.daemon.device.queue import MotionQueue
from orientd.daemon.device.queued_motion import QueuedMotion, SplicePoint
from orientd.errors import LateError, NotYetError
from orientd.servo.path.time_scaling import records_to_stop
from orientd.stream.memory import SharedMemory
from orientd.stream.records import PATH_FLOATS, TAIL_WORD, Command, ServoState

PERIOD = 0.002


class Link:
    """A servo that takes what it is told, or refuses that."""

    fault_text, now = "", None

    def __init__(self):
        self.memory = SharedMemory.create(8192, 1024)
        self.asked = []
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
        self.asked.append((command, fields))

    def read(self, index):
        return self.memory.path.read_bytes(index)[8:]


@pytest.fixture
def link():
    link = Link()
    yield link
    link.memory.close()


def turn(angle, start=(1.0, 0.0, 0.0, 0.0)):
    q = rotation.multiply(start, rotation.exp(np.array([0.0, 0.0, angle])))
    request = planner.MotionRequest([planner.Keyframe(tuple(q))], pace="even")
    start = planner.State.at_rest(start)
    return recorded(
        planner.plan(request, start=start, limits=planner.DEFAULT_LIMITS, period=PERIOD)
    )


def test_a_motion_goes_on_in_the_ring_until_the_servo_goes_over_to_the_next(link):
    first = turn(3.0)
    motion_queue = MotionQueue(link, print, lead=0.0, read_ahead=300)
    motion_queue.begin(QueuedMotion(first, number=1))
    leave = motion_queue.needed(first.facts) + 190  # beyond what is read ahead
    second = turn(0.5, state_at(first, leave).q)
    motion_queue.append(QueuedMotion(second, number=2), SplicePoint(1, leave))
    link.memory.path.words[TAIL_WORD] = leave - 20

    link.refusal = NotYetError("the speed is changing")
    for _ in range(3):
        with pytest.raises(NotYetError):
            motion_queue.feed()
    ring = link.memory.path
    assert ring.head - ring.words[TAIL_WORD] >= motion_queue.needed(first.facts)
    for record in (leave, ring.head - 1):
        assert link.read(record) == first.read(record, 1)[: 8 * PATH_FLOATS]

    link.refusal = None
    motion_queue.feed()
    command, fields = link.asked[-1]
    assert (command, fields["leave_index"]) == (Command.SPLICE, leave)
    for record in (0, second.last_record):
        at = fields["path_index"] + record
        assert link.read(at) == second.read(record, 1)[: 8 * PATH_FLOATS]


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


def test_behind_its_end_a_motion_has_setpoints_at_rest_for_the_next_one(link):
    first = turn(0.5)
    motion_queue = MotionQueue(link, print, lead=0.0, read_ahead=700)
    motion_queue.begin(QueuedMotion(first, number=1))
    end = state_at(first, first.last_record)
    rest = SplicePoint(1, first.rest_record)
    motion_queue.append(QueuedMotion(turn(0.5, end.q), number=2), rest)
    command, fields = link.asked[-1]
    assert (command, fields["leave_index"]) == (Command.SPLICE, first.last_record + 3)
    last = first.read(first.last_record, 1)[: 8 * PATH_FLOATS]
    for record in range(first.last_record, first.rest_record + 1):
        assert link.read(record) == last


def test_a_stop_between_two_motions_stops_only_the_second_one(link):
    first, told = turn(0.5), []

    def tell(kind, queued, _):
        told.append((kind, queued.number))

    motion_queue = MotionQueue(link, tell, lead=0.0, read_ahead=700)
    motion_queue.begin(QueuedMotion(first, number=1))
    end = state_at(first, first.last_record)
    following = QueuedMotion(turn(0.5, end.q), number=2)
    motion_queue.append(following, SplicePoint(1, first.rest_record))
    place = first.last_record + 1
    link.now = SimpleNamespace(
        motion=1,
        path_index=place,
        path_fraction=0.0,
        state=ServoState.HOLDING,
        flags=0,
        index=place,
    )
    motion_queue.tend()
    assert told == [(EventKind.MOTION_DONE, 1), (EventKind.MOTION_STOPPED, 2)]


def test_a_motion_whose_servo_dies_tells_how_far_it_came_by_the_last_cycle(link):
    motion_queue = MotionQueue(link, lambda *_: None, lead=0.0, read_ahead=700)
    dying = QueuedMotion(turn(0.5), number=1)
    motion_queue.begin(dying)
    link.now = SimpleNamespace(
        motion=1, path_index=40, path_fraction=0.0, state=ServoState.STREAMING, flags=0, index=40
    )
    motion_queue.drop("the servo has died")
    assert dying.reached == pytest.approx(40 * dying.motion.facts.period)


@pytest.mark.parametrize("left", [0, 1, 5])
def test_at_the_end_of_a_motion_another_one_takes_over_from_rest(link, left):
    first = turn(0.5)
    motion_queue = MotionQueue(link, print, lead=0.0, read_ahead=700)
    motion_queue.begin(QueuedMotion(first, number=1))
    cycle = SimpleNamespace(motion=1, path_index=first.last_record - left)
    assert motion_queue.ahead(cycle, 5) == SplicePoint(1, first.rest_record)
    start = state_at(first, first.rest_record)
    assert start.is_at_rest
    assert (start.before[0] == start.q).all()


def test_a_motion_that_was_taken_out_leaves_room_for_another_one_from_rest(link):
    first = turn(3.0)
    motion_queue = MotionQueue(link, print, lead=0.0, read_ahead=300)
    motion_queue.begin(QueuedMotion(first, number=1))
    end = state_at(first, first.last_record)
    for number in (2, 3):
        following = QueuedMotion(turn(0.5, end.q), number=number)
        motion_queue.append(following, SplicePoint(1, first.rest_record))
        if number == 2:
            assert motion_queue.withdraw(following, "stopped by a test")
    while link.memory.path.head <= first.rest_record:
        link.memory.path.words[TAIL_WORD] = link.memory.path.head - 20
        motion_queue.feed()
    command, fields = link.asked[-1]
    assert (command, fields["leave_index"]) == (Command.SPLICE, first.rest_record)


def test_a_motion_that_follows_at_rest_is_not_too_late(link):
    first = turn(0.5)
    motion_queue = MotionQueue(link, print, lead=0.0, read_ahead=700)
    motion_queue.begin(QueuedMotion(first, number=1))
    link.refusal = LateError("splice is not possible while holding")
    end, second = SplicePoint(1, first.last_record), turn(0.5, state_at(first, first.last_record).q)
    motion_queue.append(QueuedMotion(second, number=2), end)
    assert motion_queue.last.number == 2


def test_as_much_of_a_motion_is_read_ahead_as_its_stop_takes(link):
    limits = planner.DEFAULT_LIMITS.with_rates({"velocity": 0.1, "acceleration": 0.1})
    keyframes = [planner.Keyframe((np.cos(1.5), 0.0, 0.0, np.sin(1.5)))]
    motion = recorded(
        planner.plan(
            planner.MotionRequest(keyframes),
            start=planner.State.at_rest((1.0, 0.0, 0.0, 0.0)),
            limits=limits,
            period=PERIOD,
        )
    )
    motion_queue = MotionQueue(link, print, lead=0.0, read_ahead=300)
    motion_queue.begin(QueuedMotion(motion, number=1))
    needed, ring = motion_queue.needed(motion.facts), link.memory.path
    assert 3000 < needed < motion.facts.record_count - 3000
    for tail in range(0, 3000, 500):
        ring.words[TAIL_WORD] = tail
        motion_queue.feed()
        assert ring.head - tail >= needed


@pytest.mark.parametrize("acceleration", [0.5, 2.0, 5.0, 8.0, 11.0, 14.0, 20.0])
def test_a_slow_servo_has_its_stop_in_the_ring_before_it_begins(link, acceleration):
    """At ten cycles a second a stop takes only a few records, and each of them counts."""
    period = 0.1
    limits = planner.DEFAULT_LIMITS.with_rates({"velocity": 1.0, "acceleration": acceleration})
    keyframes = [planner.Keyframe((np.cos(1.5), 0.0, 0.0, np.sin(1.5)))]
    start = planner.State.at_rest((1.0, 0.0, 0.0, 0.0))
    motion = recorded(
        planner.plan(planner.MotionRequest(keyframes), start=start, limits=limits, period=period)
    )
    motion_queue = MotionQueue(link, print, lead=0.0, read_ahead=128)
    motion_queue.begin(QueuedMotion(motion, number=1))
    # The servo starts from the first record.
    stop = records_to_stop(motion.facts.brake_rate, period)
    assert link.memory.path.head - 1 >= min(stop, motion.last_record)
