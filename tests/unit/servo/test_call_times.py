"""The servo measures how long reads and writes take, and warns of a driver that takes too long."""

import pytest
from rig import PERIOD_NS, Rig

from orientd.stream.memory import LONGEST_READ_WORD, LONGEST_WRITE_WORD
from orientd.stream.records import Command, NoteKind

SECOND = 10**9 // PERIOD_NS


@pytest.fixture
def rig():
    it = Rig(offers={"longest_call": 0.001})
    it.takes_ns = 0
    for name in ("read", "write"):
        slow_down(it, name)
    it.ask(Command.ENABLE)
    return it


def slow_down(rig, name):
    call = getattr(rig.driver, name)

    def slow(*arguments):
        rig.clock.advance(rig.takes_ns)
        return call(*arguments)

    setattr(rig.driver, name, slow)


def warnings(rig):
    return [note.text for note in rig.notes(NoteKind.NOTICE)]


def take(rig, read_ns, write_ns):
    rig.takes_ns = read_ns
    step = rig.servo.setpoints.step

    def between(*arguments):
        rig.takes_ns = write_ns
        return step(*arguments)

    rig.servo.setpoints.step = between
    rig.run()
    rig.servo.setpoints.step = step
    rig.takes_ns = 0


def test_the_longest_of_each_is_published(rig):
    take(rig, 300_000, 200_000)
    take(rig, 100_000, 400_000)
    pulse = rig.memory.pulse
    assert (pulse[LONGEST_READ_WORD], pulse[LONGEST_WRITE_WORD]) == (300_000, 400_000)
    report = rig.servo.report()
    assert (report["longest_read_ns"], report["longest_write_ns"]) == (300_000, 400_000)


def test_a_driver_that_always_takes_longer_than_it_declares_is_warned_of_once(rig):
    rig.takes_ns = 1_100_000
    rig.run(3 * SECOND)
    assert warnings(rig) == [
        "the driver keeps the servo waiting: reads took up to 1.1 ms and writes up to 1.1 ms, "
        "at most 1.0 ms are declared"
    ]


@pytest.mark.parametrize(("taken_ns", "count"), [(9_900_000, 0), (10_000_000, 1)])
def test_one_call_is_warned_of_if_it_takes_ten_times_as_long(rig, taken_ns, count):
    take(rig, taken_ns, 0)
    rig.run(SECOND)
    assert len(warnings(rig)) == count


def test_a_few_interruptions_in_every_second_are_the_machines_own(rig):
    for _ in range(20):
        take(rig, 2_000_000, 2_000_000)
        rig.run(SECOND // 2)
    assert not warnings(rig)


def test_the_warning_is_given_anew_after_a_reset(rig):
    take(rig, 20_000_000, 0)
    rig.run(SECOND)
    rig.ask(Command.DISABLE)
    rig.ask(Command.RESET)
    rig.run(2 * SECOND)
    assert len(warnings(rig)) == 1
    take(rig, 20_000_000, 0)
    rig.run(SECOND)
    assert len(warnings(rig)) == 2


def test_a_driver_that_declares_nothing_is_measured_only():
    rig = Rig()
    rig.takes_ns = 50_000_000
    slow_down(rig, "read")
    rig.run(2 * SECOND)
    assert rig.memory.pulse[LONGEST_READ_WORD] == 50_000_000
    assert not warnings(rig)
