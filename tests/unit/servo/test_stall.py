"""The servo's own process stands still in motion: what the device is sent afterwards."""

import numpy as np
import pytest
from rig import PERIOD_NS, TERMS, Rig, peaks, turn

from orientd import rotation
from orientd.errors import Fault
from orientd.servo.watchdog import SHORTEST_NS, longest_gap_ns
from orientd.stream.memory import GIVEN_UP_WORD
from orientd.stream.records import (
    NOT_GIVEN,
    UNKNOWN,
    Answer,
    Command,
    NoteKind,
    ServoState,
)

LIMITS = (TERMS.velocity, TERMS.acceleration, TERMS.jerk)


def moving(**settings):
    """Return a rig in the middle of a turn, and the path."""
    rig, path = Rig(**settings), turn()
    rig.start(path)
    rig.run(500)
    assert np.linalg.norm(rig.cycle.omega_body) > 1.0
    return rig, path


def since(rig, number):
    """Return what was sent from setpoint *number* on."""
    return np.array([setpoint.q for setpoint in rig.driver.setpoints[number:]])


def keeps_limits(q):
    return all(found <= 1.001 * limit for found, limit in zip(peaks(q), LIMITS, strict=True))


@pytest.mark.parametrize("what", ["path", "targets"])
def test_motion_does_not_go_on_by_itself_after_a_long_stall(what):
    rig, _ = moving()
    if what == "targets":
        follow(rig, [0.0, 0.9, 0.0])
        rig.run(60)
    before = rig.sent()[-1]
    rig.stall(600)
    rig.run(50)
    assert (rig.cycle.state, rig.cycle.fault) == (ServoState.FAULT, Fault.SERVO_STALLED)
    assert (since(rig, -51) == before).all()
    (note,) = rig.notes(NoteKind.FAULT)
    assert note.text == (
        "the servo process did not run for 0.600 s, at most 0.5 s are allowed in motion"
    )


@pytest.mark.parametrize("what", ["path", "targets"])
def test_after_a_long_stall_a_reset_makes_the_way_free(what):
    rig, _ = moving()
    if what == "targets":
        follow(rig, [0.0, 0.9, 0.0])
        rig.run(60)
    rig.stall(600)
    assert rig.ask(Command.RESET)[0] is Answer.DONE
    path = _anew(rig)
    rig.start(path)
    rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
    assert rig.cycle.fault == Fault.NONE
    assert rig.cycle.q == tuple(path[0][-1])


def _anew(rig):
    q, omega, alpha = turn(0.3)
    return rotation.multiply(np.array(rig.cycle.q), q), omega, alpha


@pytest.mark.parametrize("command", [Command.STOP, Command.HALT])
@pytest.mark.parametrize("stall_ms", [130, 5000])
def test_stop_is_over_after_a_stall(command, stall_ms):
    rig, _ = moving()
    rig.ask(command)
    rig.run(5)
    assert rig.servo.state is ServoState.STOPPING
    before = rig.sent()[-1]
    rig.stall(stall_ms)
    assert (rig.cycle.state, rig.cycle.fault) == (ServoState.HOLDING, Fault.NONE)
    rig.run(20)
    assert (since(rig, -21) == before).all()


def follow(rig, vector):
    """Follow a target that lives for ever."""
    if rig.servo.state is not ServoState.TRACKING:
        assert rig.ask(Command.TRACK)[0] is Answer.DONE
    now = rig.clock.now_ns()
    rig.memory.targets.publish(now, now + 10**12, *rotation.exp(vector), *([0.0] * 3), *NOT_GIVEN)


def test_following_goes_on_from_rest_to_the_same_target():
    rig = Rig()
    rig.ask(Command.ENABLE)
    follow(rig, [0.0, 0.9, 0.0])
    rig.run(100)
    assert rig.cycle.state is ServoState.TRACKING
    assert np.linalg.norm(rig.cycle.omega_body) > 0.5
    last = len(rig.driver.setpoints) - 1
    rig.stall(200)
    rig.run(1500)
    assert keeps_limits(since(rig, last))
    assert rotation.angle(rig.sent()[-1], rotation.exp([0.0, 0.9, 0.0])) < 1e-9


def fall_silent(rig):
    """Let no feedback come any more."""
    rig.driver.read = lambda: None


def test_several_stalls_in_a_row_are_no_silence_of_the_device():
    rig, _ = moving(feedback_ns=100_000_000)
    fall_silent(rig)
    for _ in range(4):
        rig.stall(70)
    assert (rig.cycle.state, rig.cycle.fault) == (ServoState.STREAMING, Fault.NONE)


def test_an_earlier_stall_does_not_excuse_a_silence_of_the_device():
    rig, _ = moving(feedback_ns=100_000_000)
    rig.stall(400)
    rig.run(200)
    fall_silent(rig)
    rig.stall(70)
    assert rig.run(45).fault == Fault.NONE
    rig.run(200)
    assert rig.servo.setpoints.fault is Fault.FEEDBACK_STALE


def test_a_cycle_or_two_of_a_slow_device_are_no_stall():
    assert longest_gap_ns(25_000_000) == 3 * 25_000_000
    assert PERIOD_NS < SHORTEST_NS


@pytest.mark.parametrize("command", [Command.SPEED, Command.STOP, Command.HALT])
def test_of_what_was_given_up_only_stops_are_carried_out(command):
    rig, _ = moving()
    ring = rig.memory.commands
    ring.publish(command, 1, 0, UNKNOWN, UNKNOWN, UNKNOWN, 0.5, *TERMS.floats())
    ring.words[GIVEN_UP_WORD] = ring.head
    rig.run(3)
    is_stop = command is not Command.SPEED
    assert (rig.cycle.speed, rig.cycle.state)[is_stop] == (ServoState.STOPPING if is_stop else 1.0)
    assert rig.ask(Command.SPEED, speed=0.5)[0] is not Answer.FAILED


def test_more_commands_than_there_is_room_for_stop_a_motion_and_leave_the_servo_listening():
    rig, _ = moving()
    ring = rig.memory.commands
    for _ in range(3 * ring.capacity):
        ring.publish(Command.SPEED, 1, 0, UNKNOWN, UNKNOWN, UNKNOWN, 1.0, *TERMS.floats())
    rig.run(1)
    assert rig.cycle.state == ServoState.STOPPING
    rig.run(ring.capacity)
    assert rig.ask(Command.SPEED, speed=0.5)[0] is Answer.WRONG_STATE
    rig.run(5000)
    assert (rig.cycle.state, rig.cycle.fault) == (ServoState.HOLDING, Fault.NONE)


def test_a_command_that_newer_ones_overwrite_is_answered():
    rig, _ = moving()
    ring = rig.memory.commands
    lost = ring.head
    for _ in range(ring.capacity + 1):
        ring.publish(Command.SPEED, 1, 0, UNKNOWN, UNKNOWN, UNKNOWN, 1.0, *TERMS.floats())
    rig.run()
    answer = rig.notes(NoteKind.ANSWER)[-1]
    assert (answer.command, answer.code) == (lost, Answer.FAILED)
    assert answer.text == "more than 16 commands waited; send it again"
    rig.run()
    assert rig.notes(NoteKind.ANSWER)[-1].command == lost + 1


def test_the_answers_to_many_overwritten_commands_leave_the_notes_before_them():
    rig = Rig()
    rig.servo.setpoints.brake(Fault.DEVICE_FAULT, "tried")
    ring = rig.memory.commands
    for _ in range(2 * rig.memory.notes.capacity):
        ring.publish(Command.STOP, 0, 0, UNKNOWN, UNKNOWN, 0, 0.0, *TERMS.floats())
    rig.run()
    (fault,) = rig.notes(NoteKind.FAULT)
    assert fault.text == "tried"
