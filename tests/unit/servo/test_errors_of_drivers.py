"""Which error of a driver brakes on the path and which cuts off, as the contract says."""

import re

import pytest
from rig import Rig, distance_to_path, turn

from orientd import errors
from orientd.driver import contract
from orientd.stream import ServoState

ROWS = re.findall(r"^(``(\w+)``|anything else) +``(\w+)`` +(.*)$", contract.__doc__, re.MULTILINE)
RAISED = [(getattr(errors, name, ZeroDivisionError), fault, does) for _, name, fault, does in ROWS]


def test_the_contract_says_it_of_every_error_of_a_driver():
    known = {kind for kind in vars(errors).values() if isinstance(kind, type)}
    of_drivers = {kind for kind in known if issubclass(kind, errors.DeviceError)}
    declared = {kind for kind, *_ in RAISED}
    assert declared == {*of_drivers, ZeroDivisionError} - {errors.DeviceError}


@pytest.mark.parametrize("method", ["read", "write"])
@pytest.mark.parametrize(
    ("error", "fault", "does"), [*RAISED, (errors.DeviceError, *RAISED[-1][1:])]
)
def test_the_servo_does_what_the_contract_says(monkeypatch, method, error, fault, does):
    rig = Rig()
    path = turn()
    rig.start(path)
    rig.run(400)
    written, whole = len(rig.driver.setpoints), getattr(rig.driver, method)

    def fail(*arguments):
        monkeypatch.setattr(rig.driver, method, whole)
        raise error("tried")

    monkeypatch.setattr(rig.driver, method, fail)
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    rig.run(5)
    assert rig.servo.setpoints.fault.name.lower() == fault
    assert distance_to_path(rig.sent(), path) < 1e-11
    assert (len(rig.driver.setpoints) - written > 20) is does.startswith("brakes on the path")
    assert (len(rig.driver.setpoints) == written) is does.startswith("cuts off")
    assert rig.servo.has_ended is ("the process ends" in does)


@pytest.mark.parametrize("method", ["health", "notices"])
def test_a_report_that_raises_is_a_fault_and_not_the_end(method):
    def fail():
        raise KeyError(method)

    rig = Rig(offers={"health": tuple, "notices": tuple} | {method: fail})
    rig.start(turn())
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.servo.setpoints.fault is errors.Fault.INTERNAL
    assert rig.servo.setpoints.fault_text == f"KeyError: '{method}'"
    rig.run(1000)
    assert not rig.servo.has_ended


def test_a_device_that_cannot_rest_in_a_fault_is_in_the_fault_all_the_same():
    def fail():
        raise KeyError("tried")

    rig = Rig(offers={"rest_in_fault": fail})
    rig.start(turn())
    rig.servo.take_fault(errors.DeviceFaultError("jammed"))
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    rig.servo.setpoints.stop()
    rig.run(10)
    assert rig.servo.setpoints.fault is errors.Fault.DEVICE_FAULT
    assert rig.servo.setpoints.fault_text.startswith("jammed; rest_in_fault failed: 'tried'")
    assert not rig.servo.has_ended
