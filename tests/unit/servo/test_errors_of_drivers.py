"""Which error of a driver brakes on the path and which cuts off, as the contract says."""

import math
import re

import numpy as np
import pytest
from rig import TERMS, Rig, distance_to_path, peaks, turn

from orientd import errors
from orientd.driver import contract
from orientd.servo.device_reports import CallTimes
from orientd.stream.memory import SharedMemory
from orientd.stream.records import Answer, Command, NoteKind, ServoState, pack_note

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
    brakes = does.startswith("brakes")
    if method == "write" and does.endswith("cuts off if ``write`` raised"):
        brakes = False
    assert (len(rig.driver.setpoints) - written > 20) is brakes
    assert (len(rig.driver.setpoints) == written) is not brakes
    assert rig.servo.has_ended is ("the process ends" in does)


@pytest.mark.parametrize("method", ["health", "notices"])
def test_a_report_that_raises_brakes_on_the_path_and_is_a_fault(method):
    def fail():
        raise KeyError(method)

    rig = Rig(offers={"health": tuple, "notices": tuple} | {method: fail})
    path = turn()
    rig.start(path)
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.servo.setpoints.fault is errors.Fault.INTERNAL
    assert rig.servo.setpoints.fault_text == f"KeyError: '{method}'"
    rig.run(1000)
    assert distance_to_path(rig.sent(), path) < 1e-11
    assert max(peaks(rig.sent())) < TERMS.jerk, "it is not cut off in motion"
    assert peaks(rig.sent())[1] < TERMS.acceleration
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


MALFORMED = {
    "a dict": lambda good: {"q": good.q},
    "true": lambda good: True,
    "a plain tuple": tuple,
    "time of float": lambda good: good._replace(time_ns=float(good.time_ns)),
    "time nan": lambda good: good._replace(time_ns=math.nan),
    "time infinite": lambda good: good._replace(time_ns=math.inf),
    "time before the clock began": lambda good: good._replace(time_ns=-1),
    "time of 2^63": lambda good: good._replace(time_ns=2**63),
    "time in a minute": lambda good: good._replace(time_ns=good.time_ns + 60 * 10**9),
    "q of three": lambda good: good._replace(q=good.q[:3]),
    "q of numpy": lambda good: good._replace(q=np.array(good.q)),
    "q none": lambda good: good._replace(q=None),
    "q nan": lambda good: good._replace(q=(math.nan, *good.q[1:])),
    "q zero": lambda good: good._replace(q=(0.0, 0.0, 0.0, 0.0)),
    "rate infinite": lambda good: good._replace(omega_body=(0.0, math.inf, 0.0)),
    "rate of words": lambda good: good._replace(omega_body=("fast", 0.0, 0.0)),
    "position of two": lambda good: good._replace(position=(0.0, 0.0)),
    "position of 10^400": lambda good: good._replace(position=(10**400, 0.0, 0.0)),
    "joints of none": lambda good: good._replace(joints=(None,)),
    "nine joints": lambda good: good._replace(joints=(0.0,) * 9),
    "joints nan": lambda good: good._replace(joints=(math.nan,)),
}


@pytest.mark.parametrize("malform", MALFORMED.values(), ids=MALFORMED)
def test_malformed_feedback_brakes_on_the_path_and_is_a_fault(malform):
    rig = Rig()
    path = turn()
    rig.start(path)
    rig.run(400)
    last, written, read = rig.cycle, len(rig.driver.setpoints), rig.driver.read
    rig.driver.read = lambda: malform(read())
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    rig.run(5)
    assert rig.servo.setpoints.fault is errors.Fault.INTERNAL
    assert rig.servo.setpoints.fault_text.startswith("the driver's feedback is malformed: expected")
    assert len(rig.driver.setpoints) - written > 20
    assert distance_to_path(rig.sent(), path) < 1e-11
    assert rig.cycle.feedback_time_ns == last.feedback_time_ns, "it is not passed on"
    assert not rig.servo.has_ended


@pytest.mark.parametrize("malform", MALFORMED.values(), ids=MALFORMED)
def test_a_device_with_malformed_feedback_is_not_enabled(malform):
    rig = Rig()
    enable, disabled = rig.driver.enable, []
    rig.driver.enable = lambda: malform(enable())
    rig.driver.disable = lambda: disabled.append(True)
    answer, text = rig.ask(Command.ENABLE)
    assert answer is Answer.FAILED
    assert text.startswith("the driver's feedback is malformed: expected")
    assert disabled, "the driver must not stay enabled"
    assert rig.servo.state is ServoState.IDLE


def test_a_driver_that_cannot_say_why_feedback_is_late_brakes_on_the_path():
    def fail():
        raise KeyError("tried")

    rig = Rig(offers={"why_stale": fail, "why_ended": str})
    path = turn()
    rig.start(path)
    rig.run(300)
    newest = rig.driver.read()
    rig.driver.read = lambda: newest
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.servo.setpoints.fault is errors.Fault.FEEDBACK_STALE
    assert rig.servo.setpoints.fault_text.endswith("; why_stale failed: KeyError: 'tried'")
    assert distance_to_path(rig.sent(), path) < 1e-11


class Percent:
    """A speed scaling that is wrong while it is looked at in motion."""

    wrong = 1.0

    def __get__(self, driver, kind):
        if isinstance(self.wrong, Exception):
            raise self.wrong
        return self.wrong


@pytest.mark.parametrize("wrong", [KeyError("tried"), None, "half", math.nan, -0.1, 1.01, 100.0])
def test_a_wrong_speed_scaling_brakes_on_the_path(wrong):
    scaling = Percent()
    kind = type("Scaled", (Rig.kind,), {"speed_scaling": scaling})
    rig = Rig(kind=kind)
    path = turn()
    rig.start(path)
    rig.run(400)
    scaling.wrong = wrong
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.servo.setpoints.fault is errors.Fault.INTERNAL
    assert rig.servo.setpoints.fault_text.startswith("the driver's speed_scaling is wrong: ")
    assert distance_to_path(rig.sent(), path) < 1e-11


@pytest.mark.parametrize("declared", [0.0, -1.0, math.nan])
def test_a_wrong_declaration_of_call_times_does_not_end_the_servo(declared):
    rig = Rig(offers={"longest_call": declared})
    calls = CallTimes(rig.driver, SharedMemory.create(16, 16))
    calls.note(1, 1_000)
    assert len(calls.notices()) == 1


def test_a_driver_that_raises_when_it_is_closed_does_not_keep_the_reason_from_being_written():
    def fail():
        raise KeyError("tried")

    rig = Rig()
    rig.servo.request_end("it is time")
    rig.driver.close = fail
    rig.servo.close()
    assert rig.servo.report()["reason"] == "it is time; close failed: 'tried'"


def test_a_message_of_any_characters_becomes_a_note():
    _, kind, code, length, text = pack_note(0, NoteKind.FAULT, 8, "no \udcff")
    assert (kind, code, text[:length]) == (NoteKind.FAULT, 8, b"no ?")
