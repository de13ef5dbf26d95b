"""How the daemon tells of the ends of motions: at a corner, and once the axes have arrived."""

import dataclasses
from types import SimpleNamespace

import pytest
from fake_device import cycle

from orientd.daemon.device import EventKind
from orientd.daemon.device.endings import Endings
from orientd.daemon.device.queued_motion import QueuedMotion
from orientd.stream.records import CycleFlag, ServoState

ARRIVING = dataclasses.replace(cycle(5, motion=3), flags=CycleFlag.ARRIVING)


PERIOD, CORNER = 0.01, (0.2, 0.05)  # s; path time and rad
THIRD, FOURTH = QueuedMotion(number=3), QueuedMotion(number=4)


class Servo:
    """The newest cycle is whatever the test says."""

    def newest(self):
        return self.cycle


@pytest.fixture
def servo():
    return Servo()


@pytest.fixture
def told():
    return []


@pytest.fixture
def endings(servo, told):
    def tell(kind, queued, text):
        told.append((kind, queued.number, text))

    return Endings(servo, tell)


@pytest.fixture
def arriving(endings, servo, told):
    """The third motion has sent its last setpoint, and its axes are yet to arrive."""
    servo.cycle = ARRIVING
    endings.arrive(THIRD, ARRIVING)
    endings.look("")
    assert not told
    return endings


def test_done_once_the_axes_have_arrived(arriving, servo, told):
    servo.cycle = cycle(9, motion=3)
    arriving.look("")
    arriving.look("")
    assert told == [(EventKind.MOTION_DONE, 3, "")]


def test_device_that_is_disabled_before_they_arrive_has_stopped(arriving, servo, told):
    servo.cycle = cycle(9, motion=3, state=ServoState.IDLE)
    arriving.look("")
    assert [one[0] for one in told] == [EventKind.MOTION_STOPPED]


# Corners


def queued(number, first_index, *, corner=None, is_replaced=False, last_record=100):
    facts = SimpleNamespace(corner=corner, period=PERIOD)
    return SimpleNamespace(
        number=number,
        motion=SimpleNamespace(facts=facts),
        first_index=first_index,
        is_replaced=is_replaced,
        last_record=last_record,
    )


def at(motion, index):
    return SimpleNamespace(motion=motion, path_index=index)


FIRST, BLENDED = queued(1, 0), queued(2, 500, corner=CORNER)


def test_what_the_next_is_replaced_before_is_replaced_too(endings, told):
    endings.leave([FIRST], BLENDED, at(2, 510))
    left = queued(2, 500, corner=CORNER, is_replaced=True, last_record=12)
    endings._corners = [(FIRST, left)]
    endings.leave([left], queued(3, 600), at(3, 601))
    assert told == [
        (EventKind.MOTION_REPLACED, 2, ""),
        (EventKind.MOTION_REPLACED, 1, "after it was left for motion 2, before its end"),
    ]
