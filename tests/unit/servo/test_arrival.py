"""A motion is done once the axes have arrived; axes that do not come are a fault."""

import math

import pytest
from rig import PERIOD_NS, Rig, turn

from orientd.driver import AxisGap
from orientd.errors import Fault
from orientd.servo.device_reports import Arrival
from orientd.stream.records import Command, CycleFlag, ServoState

DEGREE = math.pi / 180
WAIT = 500_000_000 // PERIOD_NS


class Axes:
    def __init__(self, *axes):
        self.gaps = lambda: axes


def at_end(gap, patience=0.5):
    """Return a rig whose motion has just been sent to its end, with axes *gap* degrees behind."""

    def gaps():
        yield AxisGap("yaw", rig.gap * DEGREE, 2 * DEGREE, "0.45 A", patience)
        yield AxisGap("pitch", 0.0, 2 * DEGREE)

    rig = Rig(offers={"gaps": lambda: tuple(gaps())})
    rig.gap = gap
    rig.start(turn())
    rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
    return rig


def is_arriving(rig):
    return bool(rig.cycle.flags & CycleFlag.ARRIVING)


def test_motion_is_arriving_until_every_axis_is_within_its_tolerance():
    rig = at_end(-6.0)
    rig.run(20)
    assert is_arriving(rig)
    rig.gap = 1.9
    rig.run(2)
    assert not is_arriving(rig)
    rig.gap = 6.0
    rig.run(2 * WAIT)
    assert rig.cycle.state is ServoState.HOLDING


def test_axis_that_does_not_arrive_is_a_fault_that_names_it():
    rig = at_end(-6.1)
    taken = rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert taken <= WAIT + 5
    assert rig.servo.setpoints.fault is Fault.DEVICE_FAULT
    text = rig.servo.setpoints.fault_text
    assert text.startswith("yaw has not arrived: it is 6.1 deg behind")
    assert "0.45 A" in text
    assert "pitch" not in text


def test_axis_with_more_patience_is_waited_for_longer():
    rig = at_end(-6.1, patience=1.0)
    taken = rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert 2 * WAIT <= taken <= 2 * WAIT + 5


def test_device_that_does_not_tell_has_arrived_with_the_last_setpoint():
    rig = Rig()
    rig.start(turn())
    rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
    assert not is_arriving(rig)


@pytest.mark.parametrize("command", [Command.DISABLE, Command.TRACK])
def test_wait_ends_with_whatever_comes_next(command):
    rig = at_end(6.0)
    rig.run(3)
    rig.ask(command)
    rig.run(2 * WAIT)
    assert not is_arriving(rig)
    assert rig.servo.setpoints.fault is Fault.NONE


def test_gap_that_is_no_number_is_not_arrived():
    arrival = Arrival(Axes(AxisGap("yaw", math.nan, 1.0)))
    arrival.begin(0)
    assert not arrival.look(1)
    assert arrival.is_awaited


def test_what_was_measured_before_the_last_setpoint_does_not_count():
    arrival = Arrival(Axes(AxisGap("yaw", 0.0, 1.0)))
    arrival.begin(1000)
    assert not arrival.look(1000)
    assert arrival.is_awaited
    assert not arrival.look(1001)
    assert not arrival.is_awaited


def test_driver_that_cannot_tell_is_an_internal_fault():
    rig = Rig(offers={"gaps": lambda: 1 / 0})
    rig.start(turn())
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.servo.setpoints.fault is Fault.INTERNAL


def test_patience_of_a_slow_device_is_spent_at_the_speed_that_it_had():
    """An arm at a tenth of its speed may take ten times as long, also once it is quick again."""
    patience = [5.0]
    device = Axes()
    device.gaps = lambda: [AxisGap("wrist", 0.1, 0.01, patience=patience[0])]
    arrival = Arrival(device)
    arrival.begin(0)
    for second in range(1, 5):
        assert not arrival.look(second * 1_000_000_000)
    patience[0] = 0.5  # four of five parts are spent
    assert not arrival.look(4_050_000_000)
    assert "wrist has not arrived" in arrival.look(4_100_000_000)
