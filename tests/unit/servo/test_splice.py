"""A motion that replaces or continues another one is joined to its path, in path time."""

from dataclasses import replace

import numpy as np
import pytest
from rig import PERIOD, TERMS, Rig, peaks, turn

from orientd import rotation
from orientd.curves import METHODS
from orientd.stream.records import NO_JOINTS, Answer, Command, ServoState

PATH = turn()


def bridge(path, leave, target, duration):
    """Return a path from record *leave* of *path* to rest at *target*."""
    q, omega, alpha = path
    curve = METHODS["kks_quintic_hermite"](
        q0=q[leave],
        q1=target,
        omega0=omega[leave],
        omega1=np.zeros(3),
        alpha0=alpha[leave],
        alpha1=np.zeros(3),
        t0=0.0,
        t1=duration,
    )
    return curve.evaluate(np.arange(round(duration / PERIOD) + 1) * PERIOD)


def laid(rig, path):
    """Put *path* behind what the ring holds; return its first and last index."""
    ring = rig.memory.path
    first = ring.head
    for k, (q, omega, alpha) in enumerate(zip(*path, strict=True)):
        fields = (*q, *omega, *alpha, *np.zeros(6), *NO_JOINTS, *NO_JOINTS)
        ring.put([ring.layout.pack(first + k, *fields)], first + k)
    ring.advance(first + len(path[0]))
    return first, first + len(path[0]) - 1


def splice(rig, path, leave, *, motion=2, servo_limits=TERMS):
    first, final = laid(rig, path)
    answer = rig.ask(
        Command.SPLICE,
        motion=motion,
        path_index=first,
        leave=leave,
        final=final,
        servo_limits=servo_limits,
    )
    return answer, first


def ends_at(rig, target):
    rig.run_until(lambda servo: not servo.is_moving)
    assert rig.cycle.state is ServoState.HOLDING
    sent = rig.sent()
    assert rotation.angle(sent[-1], target) < 1e-9
    assert not rig.memory.notes.head or not rig.cycle.fault
    return sent


def test_the_rest_of_a_motion_is_replaced_without_a_step():
    rig = Rig()
    first = rig.start(PATH)
    rig.run(400)
    target = rotation.exp([0.0, 0.9, 0.2])
    leave = rig.cycle.path_index + 5
    new = bridge(PATH, leave - first, target, 1.2)
    (answer, text), _ = splice(rig, new, leave)
    assert (answer, text) == (Answer.DONE, "")
    assert rig.cycle.motion == 1
    rig.run(6)
    assert rig.cycle.motion == 2
    sent = ends_at(rig, target)
    velocity, acceleration, jerk = peaks(sent)
    planned = np.vstack([PATH[0][: leave - first], new[0]])
    assert (velocity, acceleration, jerk) == pytest.approx(peaks(planned), rel=1e-6)


@pytest.mark.parametrize("speed", [1.0, 0.7])
def test_a_motion_is_left_at_the_record_that_was_sent_last(speed):
    rig = Rig()
    first = rig.start(PATH)
    assert rig.ask(Command.SPEED, speed=speed)[0] is Answer.DONE
    rig.run(300)
    cycle = rig.cycle
    leave = cycle.path_index
    target = rotation.exp([0.0, 0.9, 0.2])
    (answer, text), _ = splice(rig, bridge(PATH, leave - first, target, 1.2), leave)
    if cycle.path_fraction:
        assert answer is Answer.REFUSED
        assert f"has passed record {leave}" in text
        return
    assert (answer, text) == (Answer.DONE, "")
    assert rig.cycle.motion == 2
    ends_at(rig, target)


def test_a_motion_replaced_before_it_began_binds_no_stop_any_more():
    rig = Rig()
    first = rig.start(PATH)
    rig.run(300)
    clock = rig.servo.setpoints.time_scaling
    before = clock.brake_rate
    slow = replace(TERMS, brake_rate=0.5 * before)
    for servo_limits, ahead, expected in ((slow, 40, 0.5 * before), (TERMS, 20, before)):
        leave = rig.cycle.path_index + ahead
        target = rotation.exp([0.0, 0.9, 0.2])
        new = bridge(PATH, leave - first, target, 1.2)
        (answer, text), _ = splice(rig, new, leave, servo_limits=servo_limits)
        assert (answer, text) == (Answer.DONE, "")
        assert clock.brake_rate == expected


def test_a_motion_replaced_before_it_began_binds_no_change_of_speed_any_more():
    rig = Rig()
    first = rig.start(PATH)
    rig.run(300)
    clock = rig.servo.setpoints.time_scaling
    before = clock.brake_rate
    target = rotation.exp([0.0, 0.9, 0.2])
    for servo_limits, ahead in ((replace(TERMS, brake_rate=0.5 * before), 40), (TERMS, 20)):
        leave = rig.cycle.path_index + ahead
        new = bridge(PATH, leave - first, target, 1.2)
        assert splice(rig, new, leave, servo_limits=servo_limits)[0] == (Answer.DONE, "")
        rig.ask(Command.SPEED, speed=0.3)
        rig.run(2)
        assert not clock.is_steady
    assert clock.brake_rate == before


@pytest.mark.parametrize(("speed", "share"), [(0.3, 0.5), (0.0, 1.0)], ids=["slower", "a pause"])
def test_a_motion_that_binds_a_change_of_speed_under_way_is_taken_after_it(speed, share):
    rig = Rig(capacity=8192)
    first = rig.start(PATH)
    rig.run(300)
    slow = replace(TERMS, brake_rate=share * TERMS.brake_rate)
    rig.ask(Command.SPEED, speed=speed)
    rig.run(3)
    for expected in (Answer.NOT_YET, Answer.DONE):
        leave = rig.cycle.path_index + 60
        new = bridge(PATH, leave - first, PATH[0][0], 2.0)
        (answer, text), _ = splice(rig, new, leave, servo_limits=slow)
        assert answer is expected
        assert text == ("the speed is changing" if answer is Answer.NOT_YET else "")
        rig.run_until(lambda servo: servo.setpoints.time_scaling.is_steady)
        rig.run(3)
    rig.ask(Command.SPEED, speed=1.0)
    ends_at(rig, PATH[0][0])


@pytest.mark.parametrize("behind", [2, 3, 50])
def test_a_record_that_is_passed_is_refused_and_nothing_changes(behind):
    rig = Rig()
    first = rig.start(PATH)
    rig.run(300)
    leave = rig.cycle.path_index + 1 - behind
    (answer, text), _ = splice(rig, bridge(PATH, leave - first, PATH[0][0], 2.0), leave)
    assert answer is Answer.REFUSED
    assert f"has passed record {leave}" in text
    ends_at(rig, PATH[0][-1])


def test_a_later_splice_takes_the_place_of_one_ahead_of_it():
    rig = Rig(capacity=8192)
    first = rig.start(PATH)
    rig.run(300)
    here = rig.cycle.path_index
    late, early = here + 100, here + 20
    (answer, _), dropped = splice(rig, bridge(PATH, late - first, PATH[0][0], 2.0), late)
    assert answer is Answer.DONE
    (answer, _), _ = splice(rig, bridge(PATH, early - first, PATH[0][5], 2.0), early, motion=3)
    assert answer is Answer.DONE
    (answer, text), _ = splice(rig, bridge(PATH, late - first, PATH[0][0], 2.0), late, motion=4)
    assert answer is Answer.REFUSED
    assert "not on the path any more" in text
    (answer, text), _ = splice(rig, PATH, dropped + 3, motion=5)
    assert answer is Answer.REFUSED
    ends_at(rig, PATH[0][5])


def test_a_motion_waits_for_its_instant():
    rig = Rig()
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    first = rig.lay(*PATH)
    instant = rig.clock.now_ns() + 101 * 2_000_000
    assert rig.ask(Command.START, path_index=first, start_ns=instant)[0] is Answer.DONE
    rig.run(98)
    assert rig.cycle.path_index == first
    rig.run(10)
    assert rig.cycle.deadline_ns - instant == (rig.cycle.path_index - first - 1) * 2_000_000
    ends_at(rig, PATH[0][-1])


@pytest.mark.parametrize("after_ns", [1, 400_000, 1_999_999])
@pytest.mark.parametrize("speed", [1.0, 0.5])
def test_a_motion_is_as_far_along_as_its_instant_is_past(after_ns, speed):
    rig = Rig()
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    first = rig.lay(*PATH)
    instant = rig.clock.now_ns() + 20 * 2_000_000 - after_ns
    asked = rig.ask(Command.START, path_index=first, start_ns=instant, speed=speed)
    assert asked[0] is Answer.DONE
    for _ in range(100):
        rig.run(1)
        cycle = rig.cycle
        # A setpoint is where the device is to be at the end of its cycle.
        past = max(0.0, (cycle.deadline_ns + 2_000_000 - instant) / 2_000_000)
        records = cycle.path_index + cycle.path_fraction - first
        assert records == pytest.approx(speed * past, abs=1e-9)
    assert cycle.state is ServoState.STREAMING
    ends_at(rig, PATH[0][-1])


def test_a_motion_that_replaces_a_waiting_one_begins_at_once():
    rig = Rig()
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    first = rig.lay(*PATH)
    instant = rig.clock.now_ns() + 10**12
    assert rig.ask(Command.START, path_index=first, start_ns=instant)[0] is Answer.DONE
    rig.run(20)
    target = rotation.multiply(PATH[0][0], rotation.exp([0.0, 0.3, 0.0]))
    assert splice(rig, bridge(PATH, 0, target, 1.0), first)[0][0] is Answer.DONE
    rig.run(2)
    assert rig.cycle.motion == 2
    ends_at(rig, target)
    assert rig.clock.now_ns() < instant
