"""A servo in a fault stops and disables, and does nothing that would move the device."""

import pytest
from rig import Rig

from orientd.errors import Fault
from orientd.stream.records import Answer, Command, ServoState


@pytest.fixture
def rig():
    it = Rig(offers={"rest_in_fault": lambda: it.rests.append(it.clock.now_ns())})
    it.rests = []
    it.ends = []
    it.driver.disable = lambda: it.ends.append(it.clock.now_ns())
    it.ask(Command.ENABLE)
    it.servo.setpoints.brake(Fault.DEVICE_FAULT, "tried")
    assert len(it.rests) == 1
    return it


@pytest.mark.parametrize("command", [Command.STOP, Command.HALT])
def test_stop_has_the_driver_look_again_that_nothing_moves(rig, command):
    assert rig.ask(command) == (Answer.DONE, "")
    assert len(rig.rests) == 2
    assert rig.servo.state is ServoState.FAULT


def test_disable_ends_the_writing_and_leaves_the_fault(rig):
    assert rig.ask(Command.DISABLE) == (Answer.DONE, "")
    assert len(rig.ends) == 1
    written = len(rig.driver.setpoints)
    rig.run(10)
    assert len(rig.driver.setpoints) == written
    assert rig.servo.state is ServoState.FAULT
    assert rig.servo.setpoints.fault is Fault.DEVICE_FAULT


@pytest.mark.parametrize("command", [Command.FREE, Command.ENABLE, Command.START, Command.TRACK])
def test_what_would_move_the_device_is_refused(rig, command):
    assert rig.ask(command)[0] is Answer.WRONG_STATE
