"""How the daemon tells of the end of a motion whose axes come after its last setpoint."""

import dataclasses

import pytest
from fake_device import cycle

from orientd.daemon.devices.device_report import EventKind
from orientd.daemon.motions.arrivals import Arrivals
from orientd.stream import CycleFlag, ServoState

ARRIVING = dataclasses.replace(cycle(5, motion=3), flags=CycleFlag.ARRIVING)


class Link:
    """The newest cycle is whatever the test says."""

    def newest(self):
        return self.cycle


@pytest.fixture
def arrivals():
    told = []
    link = Link()
    it = Arrivals(link, lambda *event: told.append(event))
    it.link, it.told = link, told
    link.cycle = ARRIVING
    it.arrive(3, ARRIVING)
    it.look("")
    assert not told
    return it


def test_done_once_the_axes_have_arrived(arrivals):
    arrivals.link.cycle = cycle(9, motion=3)
    arrivals.look("")
    arrivals.look("")
    assert arrivals.told == [(EventKind.MOTION_DONE, 3, "")]


def test_fault_ends_it_with_its_reason(arrivals):
    arrivals.link.cycle = cycle(9, motion=3, state=ServoState.FAULT)
    arrivals.look("")
    assert not arrivals.told
    arrivals.look("yaw has not arrived")
    assert arrivals.told == [(EventKind.MOTION_STOPPED, 3, "yaw has not arrived")]


def test_motion_that_begins_before_they_arrive_leaves_it_passed(arrivals):
    arrivals.end("another motion began", EventKind.MOTION_PASSED)
    text = "another motion began before its axes had arrived"
    assert arrivals.told == [(EventKind.MOTION_PASSED, 3, text)]


def test_device_that_is_disabled_before_they_arrive_has_stopped(arrivals):
    arrivals.link.cycle = cycle(9, motion=3, state=ServoState.IDLE)
    arrivals.look("")
    assert [one[0] for one in arrivals.told] == [EventKind.MOTION_STOPPED]


def test_queued_motion_does_not_wait_for_the_axes(arrivals):
    arrivals.arrive(4, ARRIVING, is_followed=True)
    assert arrivals.told[-1] == (EventKind.MOTION_DONE, 4, "")
