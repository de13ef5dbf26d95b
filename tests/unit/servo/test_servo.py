import json
from dataclasses import replace

import numpy as np
import pytest
from rig import PERIOD, PERIOD_NS, TERMS, Rig, distance_to_path, peaks, turn

from orientd import rotation
from orientd.errors import Fault, LinkError, SpentLinkError
from orientd.servo.state_table import TRANSITIONS, Event, advance
from orientd.stream.records import Answer, Command, NoteKind, ServoState


@pytest.fixture
def rig():
    return Rig()


def assert_limits_kept(rig):
    velocity, acceleration, jerk = peaks(rig.sent())
    assert velocity <= TERMS.velocity * 1.001
    assert acceleration <= TERMS.acceleration * 1.001
    assert jerk <= TERMS.jerk * 1.001


def test_a_motion_as_planned_sends_exactly_its_records(rig):
    path = turn()
    rig.start(path)
    rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
    sent = rig.sent()
    moving = sent[np.any(sent != sent[0], axis=1).argmax() - 1 :][: len(path[0])]
    np.testing.assert_array_equal(moving, path[0])
    assert rig.cycle.q == tuple(path[0][-1])


@pytest.fixture
def let_go(rig, monkeypatch):
    """Return a list of the last two orientations before each time that the device is let go."""
    last = []
    monkeypatch.setattr(rig.driver, "disable", lambda: last.append(rig.sent()[-2:]))
    return last


@pytest.mark.parametrize(
    ("command", "fault"),
    [(Command.DISABLE, Fault.NONE), (Command.RESET, Fault.DEVICE_FAULT)],
    ids=["disable", "reset"],
)
def test_a_device_is_let_go_once_two_setpoints_are_the_same(rig, let_go, command, fault):
    rig.start(turn(duration=0.2, angle=0.02))
    rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
    if fault:
        rig.servo.setpoints.brake(fault, "tried")
    last = rig.sent()[-2:]
    assert np.any(last[0] != last[1])
    rig.ask(command)
    assert not let_go
    rig.run()
    assert rig.notes(NoteKind.ANSWER)[-1].code == Answer.DONE
    (last,) = let_go
    np.testing.assert_array_equal(last[0], last[1])


def test_a_servo_that_ends_lets_its_device_go_once_two_setpoints_are_the_same(rig, let_go):
    rig.start(turn(duration=0.2, angle=0.02))
    rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
    rig.servo.request_end("tried")
    rig.run_until(lambda servo: servo.has_ended)
    rig.servo.close()
    (last,) = let_go
    np.testing.assert_array_equal(last[0], last[1])


def test_a_cycle_says_where_the_path_is(rig):
    path = turn()
    first = rig.start(path)
    rig.ask(Command.SPEED, speed=0.7)
    cycle = rig.run(300)
    assert cycle.path_fraction
    assert cycle.planned_q == cycle.q
    k = cycle.path_index - first
    whole = rotation.angle(path[0][k], path[0][k + 1])
    assert rotation.angle(path[0][k], cycle.planned_q) == pytest.approx(
        cycle.path_fraction * whole, rel=1e-2
    )
    # Off the path it stays where the path was left.
    rig.servo.setpoints.leave_path(Fault.INTERNAL, "a reason")
    gone = rig.run(100)
    assert (gone.path_index, gone.path_fraction) == (cycle.path_index, cycle.path_fraction)
    assert gone.planned_q == cycle.q
    assert rotation.angle(gone.q, gone.planned_q) > 1e-3


def test_a_cycle_without_a_path_has_no_place_on_it(rig):
    rig.ask(Command.ENABLE)
    assert rig.run(3).planned_q is None
    rig.start(turn())
    rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
    assert rig.run(3).planned_q == rig.cycle.q
    assert rig.ask(Command.TRACK, motion=2)[0] is Answer.DONE
    assert rig.run(3).planned_q is None


@pytest.mark.parametrize("moment", [5, 150, 500, 700, 900, 995])
def test_stop_comes_to_rest_on_the_path_inside_the_limits(rig, moment):
    path = turn()
    rig.start(path)
    rig.run(moment)
    assert rig.ask(Command.STOP)[0] is Answer.DONE
    cycles = rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
    rig.run(5)
    assert cycles * PERIOD <= 1.0 / TERMS.brake_rate + 3 * PERIOD
    assert_limits_kept(rig)
    assert distance_to_path(rig.sent(), path) < 1e-12


def test_a_speed_above_the_planned_one_is_refused(rig):
    rig.start(turn())
    rig.run(100)
    for speed in (1.5, -0.1, float("nan")):
        text = f"speed must be between 0 and 1, got {speed!r}"
        assert rig.ask(Command.SPEED, speed=speed) == (Answer.REFUSED, text)


def test_a_motion_that_could_not_be_stopped_takes_over_from_none(rig):
    rig.start(turn())
    rig.run(100)
    for rate in (0.0, float("nan")):
        answer = rig.ask(Command.SPLICE, servo_limits=replace(TERMS, brake_rate=rate))
        assert answer == (Answer.REFUSED, f"brake rate must be positive, got {rate!r}")


def test_a_starved_path_is_a_stop_on_the_path_and_a_fault(rig):
    path = turn(duration=4.0)
    rig.start(path, most=1000, is_whole=False)
    rig.run_until(lambda servo: servo.state is ServoState.STOPPING)
    begin = rig.cycle.path_index
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.cycle.fault == Fault.PATH_STARVED
    assert begin < rig.cycle.path_index < 1000
    assert_limits_kept(rig)
    assert distance_to_path(rig.sent(), path) < 1e-12


def test_without_its_daemon_it_stops_on_the_path_and_ends(rig):
    path = turn()
    rig.start(path)
    rig.run(500)
    rig.parent_is_alive = False
    rig.run(8)
    assert rig.cycle.state is ServoState.STOPPING
    rig.run_until(lambda servo: servo.has_ended)
    assert rig.servo.report()["reason"] == "the daemon is gone"
    assert_limits_kept(rig)
    assert distance_to_path(rig.sent(), path) < 1e-12


@pytest.mark.parametrize("size", [1e-4, 0.01, 0.5, 3.0])
def test_a_jump_in_the_path_is_never_written(rig, size):
    path = turn(duration=4.0)
    from orientd import rotation

    path[0][700:] = rotation.multiply(path[0][700:], rotation.exp([size, 0.0, 0.0]))
    rig.start(path)
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    rig.run(5)
    assert rig.cycle.fault == Fault.LIMIT_GUARD
    assert "limit" in rig.notes(NoteKind.FAULT)[0].text
    assert_limits_kept(rig)


def test_reset_leads_back_to_a_moving_device(rig):
    rig.start(turn(duration=4.0), most=1000, is_whole=False)
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.ask(Command.RESET)[0] is Answer.DONE
    assert rig.cycle.state is ServoState.IDLE
    held = rig.cycle.q
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    assert rig.cycle.q == held
    from orientd import rotation

    q, omega, alpha = turn()
    first = rig.lay(rotation.multiply(np.array(held), q), omega, alpha)
    assert rig.ask(Command.START, path_index=first)[0] is Answer.DONE
    rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
    assert_limits_kept(rig)


def test_a_path_that_begins_elsewhere_is_refused(rig):
    rig.ask(Command.ENABLE)
    q, omega, alpha = turn()
    first = rig.lay(q[200:], omega[200:], alpha[200:])
    answer, text = rig.ask(Command.START, path_index=first)
    assert answer is Answer.REFUSED
    assert "rad from the commanded orientation" in text
    assert rig.cycle.state is ServoState.HOLDING


def test_stale_feedback_is_a_stop_on_the_path_and_a_fault(tmp_path):
    fault = tmp_path / "fault"
    rig = Rig({"fault_file": str(fault)})
    path = turn()
    rig.start(path)
    rig.run(300)
    fault.write_text("feedback_stale")
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.cycle.fault == Fault.FEEDBACK_STALE
    assert "ms old" in rig.notes(NoteKind.FAULT)[0].text
    assert_limits_kept(rig)
    assert distance_to_path(rig.sent(), path) < 1e-12


def test_the_first_reason_of_a_fault_counts():
    rig = Rig(heartbeat_ns=20_000_000)
    rig.start(turn())
    rig.run(500)
    rig.beats = False
    rig.run_until(lambda servo: servo.state is ServoState.STOPPING)
    read = rig.driver.read
    rig.driver.read = lambda: read()._replace(q=(2.0, 0.0, 0.0, 0.0))
    rig.run(2)
    assert rig.servo.state is ServoState.STOPPING
    rig.driver.read = read
    rig.run_until(lambda servo: servo.state is ServoState.FAULT)
    assert rig.cycle.fault == Fault.HEARTBEAT_LOST
    (note,) = rig.notes(NoteKind.FAULT)
    assert "no heartbeat" in note.text


@pytest.mark.parametrize("stall_ms", [120, 900, 5000])
def test_a_stall_of_its_own_is_nobody_elses_fault(stall_ms):
    rig = Rig(stall_ns=10**10)
    rig.start(turn())
    rig.run(300)
    for _ in range(3):
        rig.stall(stall_ms)  # the daemon has not run either
        rig.run(20)
    assert rig.servo.state is ServoState.STREAMING
    rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
    assert rig.cycle.fault == Fault.NONE


def test_after_a_stall_of_its_own_stale_feedback_is_still_found(tmp_path):
    fault = tmp_path / "fault"
    rig = Rig({"fault_file": str(fault)})
    rig.start(turn())
    rig.run(300)
    fault.write_text("feedback_stale")
    rig.clock.advance(300_000_000)
    rig.servo.cycle(rig.clock.now_ns(), 0)
    cycles = rig.run_until(lambda servo: servo.state is ServoState.STOPPING)
    assert cycles * PERIOD < 0.11
    assert rig.cycle.fault == Fault.FEEDBACK_STALE


@pytest.mark.parametrize(
    ("kind", "fault"), [("link_lost", Fault.LINK_LOST), ("device_fault", Fault.DEVICE_FAULT)]
)
def test_after_a_device_fault_nothing_is_written_until_reset(tmp_path, kind, fault):
    file = tmp_path / "fault"
    rig = Rig({"fault_file": str(file)})
    rig.start(turn())
    rig.run(300)
    file.write_text(kind)
    rig.run()
    assert rig.cycle.state is ServoState.FAULT
    assert rig.cycle.fault == fault
    written = len(rig.driver.setpoints)
    rig.run(10)
    assert len(rig.driver.setpoints) == written
    assert rig.ask(Command.RESET)[0] is Answer.DONE
    assert rig.ask(Command.ENABLE)[0] is not Answer.DONE
    file.unlink()
    rig.ask(Command.RESET)
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE


def test_a_defect_of_a_driver_is_a_fault_and_not_the_end(rig):
    rig.start(turn())
    rig.driver.write = lambda setpoint: 1 / 0
    rig.run()
    assert rig.cycle.fault == Fault.INTERNAL
    assert "ZeroDivisionError" in rig.notes(NoteKind.FAULT)[0].text


def test_every_event_has_a_place_in_the_table_and_every_state_can_fail():
    assert set(TRANSITIONS) == {*Command, *Event} - {Command.SHUTDOWN}
    for state in ServoState:
        assert advance(state, Event.FAIL) is ServoState.FAULT


def test_path_clock_follows_the_speed_the_device_allows():
    rig = Rig(offers={"speed_scaling": 1.0})
    path = turn()
    rig.start(path)
    rig.run(200)
    rig.driver.speed_scaling = 0.5
    rig.run(200)
    assert rig.cycle.speed == 0.5
    assert rig.ask(Command.SPEED, speed=0.5)[0] is Answer.DONE
    rig.run(200)
    assert rig.cycle.speed == 0.25
    rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
    assert_limits_kept(rig)
    assert rig.cycle.q == tuple(path[0][-1])


def test_servo_ends_when_its_link_is_spent(rig, monkeypatch):
    rig.start(turn())
    rig.run(200)
    monkeypatch.setattr(rig.driver, "read", raiser(LinkError("gone")))
    rig.run()
    assert not rig.servo.has_ended
    monkeypatch.setattr(rig.driver, "read", raiser(SpentLinkError("gone for good")))
    rig.run()
    assert rig.servo.has_ended
    assert rig.servo.report()["fault"] == "link_lost"


def test_the_age_of_feedback_counts_from_the_enabling_on(rig, monkeypatch):
    pose = rig.driver.enable()._replace(time_ns=0)
    monkeypatch.setattr(rig.driver, "enable", lambda: pose)
    monkeypatch.setattr(rig.driver, "read", lambda: None)
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    most = rig.feedback_ns // PERIOD_NS
    assert (rig.run(most - 5).state, rig.cycle.fault) == (ServoState.HOLDING, Fault.NONE)
    assert rig.run(10).fault == Fault.FEEDBACK_STALE


def test_feedback_lags_by_delay_cycles():
    rig = Rig({"delay_cycles": 7})
    rig.start(turn())
    cycle = rig.run(300)
    assert cycle.feedback_q == rig.driver.setpoints[-1 - 8].q
    assert cycle.feedback_age_ns == 8 * 2_000_000


def test_options_that_the_driver_refuses_are_refused_in_its_words(rig):
    rig.ask(Command.ENABLE)
    answer, text = tune(rig, {"gain": 300})
    assert answer is Answer.REFUSED
    assert "no options of one motion, got 'gain'" in text
    assert rig.servo.state is ServoState.HOLDING


@pytest.fixture
def parked(rig, monkeypatch):
    calls = []
    monkeypatch.setattr(rig.driver, "park", lambda: calls.append("park"), raising=False)
    monkeypatch.setattr(rig.driver, "disable", lambda: calls.append("disable"))
    monkeypatch.setattr(rig.driver, "close", lambda: calls.append("close"))
    return calls


def end(rig):
    rig.run_until(lambda servo: servo.has_ended)
    rig.servo.close()


def test_device_is_parked_when_the_daemon_ends_in_order(rig, parked):
    rig.start(turn())
    rig.run(100)
    assert rig.ask(Command.SHUTDOWN)[0] is Answer.DONE
    assert not parked
    end(rig)
    assert parked == ["disable", "park", "close"]


def test_device_is_parked_when_its_process_is_told_to_end(rig, parked):
    rig.servo.request_orderly_end("SIGTERM")
    end(rig)
    assert parked == ["park", "close"]


@pytest.mark.parametrize("is_told", [False, True])
def test_device_goes_on_holding_when_the_daemon_is_lost(rig, parked, is_told):
    rig.start(turn())
    rig.run(100)
    rig.parent_is_alive = False
    if is_told:
        rig.servo.request_orderly_end("SIGTERM")
    end(rig)
    assert parked == ["disable", "close"]


def test_device_in_a_fault_is_not_moved_at_the_end(rig, parked, monkeypatch):
    rig.start(turn())
    monkeypatch.setattr(rig.driver, "read", raiser(LinkError("gone")))
    rig.run()
    rig.ask(Command.SHUTDOWN)
    end(rig)
    assert parked == ["disable", "close"]


def test_park_that_fails_is_written_down(rig, monkeypatch):
    rig.start(turn())
    monkeypatch.setattr(rig.driver, "park", raiser(LinkError("gone")), raising=False)
    rig.ask(Command.SHUTDOWN)
    end(rig)
    assert "park failed: gone" in rig.servo.report()["reason"]


def raiser(error):
    def read():
        raise error

    return read


def tune(rig, options):
    text = json.dumps(options).encode()
    rig.memory.tunings.publish(len(text), text)
    return rig.ask(Command.TUNE)


def test_driver_is_handed_the_options_of_the_motions_to_come(rig):
    taken = []
    rig.driver.tune = taken.append
    assert tune(rig, {"gain": 300})[0] is Answer.WRONG_STATE
    rig.ask(Command.ENABLE)
    assert tune(rig, {"gain": 300, "name": "soft"})[0] is Answer.DONE
    assert tune(rig, {})[0] is Answer.DONE
    assert taken == [{"gain": 300, "name": "soft"}, {}]


def test_a_path_that_begins_at_another_position_is_refused():
    rig = Rig()
    path = turn()
    assert rig.ask(Command.ENABLE)[0] is Answer.DONE
    first = rig.lay(*path, position=np.full((len(path[0]), 3), 1e-3))
    answer, text = rig.ask(Command.START, path_index=first)
    assert answer is Answer.REFUSED
    assert text == "the path begins 0.00173 m from the commanded position"
    rig.run(5)
    assert rig.servo.state is ServoState.HOLDING
