"""What a motion queue keeps in the path ring, with a servo that answers as the test says."""

import numpy as np
import pytest

from orientd import planner, rotation
from orientd.daemon.motions.motion_queue import MotionQueue, SplicePoint
from orientd.errors import NotYetError
from orientd.servo import TAIL_WORD
from orientd.stream import Command, SharedMemory

PERIOD = 0.002


class Link:
    """A servo that takes what it is told, or says that it is too early."""

    def __init__(self):
        self.memory = SharedMemory.create(8192, 1024)
        self.asked = []
        self.is_too_early = False

    def beat(self):
        pass

    def ask(self, command, **fields):
        if self.is_too_early:
            raise NotYetError("the speed is changing")
        self.asked.append((command, fields))

    def read(self, index):
        return np.frombuffer(self.memory.path.read_bytes(index)[8:]).copy()


@pytest.fixture
def link():
    link = Link()
    yield link
    link.memory.close()


def turn(angle, start=(1.0, 0.0, 0.0, 0.0)):
    q = rotation.multiply(start, rotation.from_rotation_vector(np.array([0.0, 0.0, angle])))
    request = planner.MotionRequest([planner.Keyframe(tuple(q))], pace="even")
    start = planner.State.at_rest(start)
    return planner.plan(
        request, start=start, limits=planner.DEFAULT_LIMITS, period=PERIOD
    ).recorded()


def test_a_motion_goes_on_in_the_ring_until_the_servo_goes_over_to_the_next(link):
    first = turn(3.0)
    motion_queue = MotionQueue(link, lead=0.0, read_ahead=700)
    motion_queue.begin(first, 1, speed=1.0, start_ns=0)
    leave = motion_queue.needed(first.facts) + 40
    link.memory.path.words[TAIL_WORD] = leave - 20
    second = turn(0.5, first.state_at(leave).q)
    motion_queue.append(second, 2, SplicePoint(1, leave))

    link.is_too_early = True
    for _ in range(3):
        with pytest.raises(NotYetError):
            motion_queue.feed()
    ring = link.memory.path
    assert ring.head - ring.words[TAIL_WORD] >= motion_queue.needed(first.facts)
    for record in (leave, ring.head - 1):
        np.testing.assert_array_equal(link.read(record), first.records(record, 1)[0])

    link.is_too_early = False
    motion_queue.feed()
    command, fields = link.asked[-1]
    assert (command, fields["leave_index"]) == (Command.SPLICE, leave)
    for record in (0, second.last_record):
        at = fields["path_index"] + record
        np.testing.assert_array_equal(link.read(at), second.records(record, 1)[0])
