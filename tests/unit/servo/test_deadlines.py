"""Deadlines: a period apart, or nearly, for a device with a cycle of its own; in virtual time."""

import itertools
import math

import pytest
from rig import PERIOD_NS, Rig

from orientd.errors import Fault
from orientd.servo.process import LARGEST_SHIFT, run_cycles
from orientd.stream.records import Command, ServoState


class VirtualTimer:
    """A timer that wakes on time and ends the servo after a while."""

    def __init__(self, servo, count):
        self.servo, self.left, self.deadlines = servo, count, []

    def wait(self, deadline_ns):
        self.deadlines.append(deadline_ns)
        self.left -= 1
        if not self.left:
            self.servo.request_end("enough")
        return deadline_ns


@pytest.mark.parametrize("asked", [0, 3000, -3000, 10**9, -(10**9)])
def test_deadline_moves_by_what_the_driver_asks_and_little_at_a_time(monkeypatch, asked):
    # Real time stands still, so that no deadline passes.
    monkeypatch.setattr("orientd.servo.process.time.monotonic_ns", lambda: 10**9)
    servo = Rig().servo
    timer = VirtualTimer(servo, 20)
    device = Rig(offers={"deadline_shift_ns": lambda _deadline_ns: asked}).driver
    run_cycles(servo, timer, PERIOD_NS, device)
    steps = {b - a for a, b in itertools.pairwise(timer.deadlines)}
    most = PERIOD_NS // LARGEST_SHIFT
    assert steps == {PERIOD_NS + max(-most, min(most, asked))}


@pytest.mark.parametrize("wrong", [KeyError("tried"), None, "late", math.nan, math.inf])
def test_a_driver_that_cannot_say_its_deadline_is_in_a_fault_and_the_servo_goes_on(
    monkeypatch, wrong
):
    def fail(_deadline_ns):
        if isinstance(wrong, Exception):
            raise wrong
        return wrong

    monkeypatch.setattr("orientd.servo.process.time.monotonic_ns", lambda: 10**9)
    servo = Rig().servo
    timer = VirtualTimer(servo, 20)
    run_cycles(servo, timer, PERIOD_NS, Rig(offers={"deadline_shift_ns": fail}).driver)
    assert len(timer.deadlines) == 20
    assert (servo.state, servo.setpoints.fault) == (ServoState.FAULT, Fault.INTERNAL)


@pytest.mark.parametrize("periods", [0.0, 0.7, 1.0, 1.001, 2.5, 2.999, 7.9])
def test_a_cycle_that_takes_longer_skips_and_counts_the_deadlines_that_have_passed(
    monkeypatch, periods
):
    """The time passes only while the timer waits and in the third cycle."""
    now = [10**9]
    monkeypatch.setattr("orientd.servo.process.time.monotonic_ns", lambda: now[0])
    servo = Rig().servo

    class Timer(VirtualTimer):
        def wait(self, deadline_ns):
            assert deadline_ns >= now[0]
            now[0] = deadline_ns
            return super().wait(deadline_ns)

    def cycle(deadline_ns, lateness_ns):
        assert lateness_ns == 0
        if len(timer.deadlines) == 3:
            now[0] = deadline_ns + round(periods * PERIOD_NS)

    timer = Timer(servo, 6)
    monkeypatch.setattr(servo, "cycle", cycle)
    run_cycles(servo, timer, PERIOD_NS)
    # A deadline that is due this very instant has not passed.
    missed = max(0, math.ceil(periods) - 1)
    steps = [(b - a) // PERIOD_NS for a, b in itertools.pairwise(timer.deadlines)]
    assert steps == [1, 1, 1 + missed, 1, 1]
    assert servo.missed == missed


@pytest.mark.parametrize("phase_ns", [0, 1, PERIOD_NS - 1])
def test_deadlines_are_at_the_phase_that_is_asked_for(monkeypatch, phase_ns):
    monkeypatch.setattr("orientd.servo.process.time.monotonic_ns", lambda: 10**9 + 12_345)
    servo = Rig().servo
    timer = VirtualTimer(servo, 5)
    run_cycles(servo, timer, PERIOD_NS, phase_ns=phase_ns)
    assert {deadline % PERIOD_NS for deadline in timer.deadlines} == {phase_ns}


def test_deadline_that_moves_is_no_deadline_missed():
    rig = Rig()
    rig.ask(Command.ENABLE)
    read = rig.driver.read
    rig.driver.read = lambda: read()._replace(time_ns=rig.clock.now_ns() - 10**6)
    for _ in range(2000):
        rig.clock.advance(PERIOD_NS + PERIOD_NS // LARGEST_SHIFT)
        rig.memory.beat(rig.clock.now_ns())
        rig.servo.cycle(rig.clock.now_ns(), 0)
    # All those shifts together must not excuse a device that says nothing.
    rig.driver.read = lambda: None
    rig.run(round(rig.feedback_ns / PERIOD_NS) + 3)
    assert rig.servo.state is ServoState.FAULT


def test_counts_of_late_cycles_stay_within_the_record():
    rig = Rig()
    rig.servo.count_late(overruns=2**32 - 2, missed=2**40)
    rig.servo.count_late(overruns=3)
    cycle = rig.run()
    assert (cycle.overruns, cycle.missed) == (2**32 - 1, 2**32 - 1)
