"""What is said of a motion that is blended with the next one."""

from types import SimpleNamespace

import pytest

from orientd.daemon.devices import EventKind
from orientd.daemon.motions.corners import Corners

PERIOD, CORNER = 0.01, (0.2, 0.05)  # s; path time and rad


def queued(number, first_index, *, corner=None, is_replaced=False, last_record=100):
    facts = SimpleNamespace(corner=corner, period=PERIOD)
    return SimpleNamespace(
        number=number,
        motion=SimpleNamespace(facts=facts),
        feeder=SimpleNamespace(first_index=first_index),
        is_replaced=is_replaced,
        last_record=last_record,
    )


@pytest.fixture
def told():
    return []


@pytest.fixture
def corners(told):
    return Corners(lambda *event: told.append(event))


def at(motion, index):
    return SimpleNamespace(motion=motion, path_index=index)


FIRST, BLENDED = queued(1, 0), queued(2, 500, corner=CORNER)


def test_a_blended_motion_is_passed_where_the_next_is_nearest_to_its_end(corners, told):
    corners.look([FIRST], BLENDED, at(2, 519))
    assert told == []
    corners.look([], BLENDED, at(2, 520))
    assert told == [(EventKind.MOTION_PASSED, 1, "2.86 deg from its end")]
    corners.end("")
    assert len(told) == 1


def test_what_is_stopped_on_the_way_round_its_corner_says_so(corners, told):
    corners.look([FIRST], BLENDED, at(2, 510))
    corners.end("")
    text = "stopped after it was left for motion 2, before its end"
    assert told == [(EventKind.MOTION_STOPPED, 1, text)]


def test_what_the_next_is_replaced_before_is_replaced_too(corners, told):
    corners.look([FIRST], BLENDED, at(2, 510))
    left = queued(2, 500, corner=CORNER, is_replaced=True, last_record=12)
    corners._waiting = [(FIRST, left)]
    corners.look([left], queued(3, 600), at(3, 601))
    assert told == [
        (EventKind.MOTION_REPLACED, 2, ""),
        (EventKind.MOTION_REPLACED, 1, "after it was left for motion 2, before its end"),
    ]


def test_what_goes_over_at_its_end_is_done_and_what_is_replaced_is_not(corners, told):
    replaced = queued(1, 0, is_replaced=True)
    corners.look([replaced, queued(2, 500)], queued(3, 900), at(3, 900))
    assert told == [(EventKind.MOTION_REPLACED, 1, ""), (EventKind.MOTION_DONE, 2, "")]
