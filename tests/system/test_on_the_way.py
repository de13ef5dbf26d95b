"""Transitions between motions in a real daemon: replace, queue, halt, track."""

import time
from contextlib import closing

import harness
import numpy as np
import pytest
from harness import (
    ACCELERATION,
    DEVICE,
    JERK,
    DaemonProcess,
    until,
)

import orientd
from orientd import rotation
from orientd.errors import LimitError, RequestError, StateError
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.world

Q = orientd.Quaternion


class Daemon:
    """The daemon, of which only what is sent from now on counts."""

    def __init__(self, process):
        self.socket, self.period = process.socket, process.period
        self._process = process
        self._before = process.at_rest()

    def sent(self):
        return self._process.sent()[self._before :]

    def assert_limits_kept(self):
        self._process.assert_limits_kept(self._before)


@pytest.fixture
def daemon(daemon):
    return Daemon(daemon)


@pytest.fixture
def robot(daemon):
    with closing(orientd.connect(daemon.socket)) as robot:
        if state(robot).state == pb.STATE_FAULT:
            robot.reset()  # of a test that failed
        robot.move([key(0, 0, 0)], approach=True).wait(20.0)
        robot.set_speed(1.0)
        yield robot


def key(*vector):
    w, x, y, z = rotation.exp(np.array(vector)).tolist()
    return Q(w=w, x=x, y=y, z=z)


def state(robot):
    return robot.state().devices[DEVICE]


def moving(robot):
    return until(lambda: state(robot).path_time > 0.3, "a motion under way")


def turn(robot, angle=2.0, **how):
    return robot.move([key(0, 0, 0), key(0, 0, angle)], approach=True, **how)


def long_turn(robot):
    """Begin a turn that nothing a busy machine does outlasts; wait until it is under way."""
    handle = turn(robot, limits={"velocity": 0.1})
    moving(robot)
    return handle


def test_a_motion_is_replaced_on_its_way_without_a_step(daemon, robot):
    first = long_turn(robot)
    second = robot.move([key(0.4, 0, 0), key(0.4, 0.3, 0)], approach=True)
    assert second.wait(20.0).outcome == pb.OUTCOME_DONE
    assert first.wait(5.0).outcome == pb.OUTCOME_REPLACED
    sent = daemon.sent()
    assert rotation.angle(sent[-1], rotation.exp([0.4, 0.3, 0.0])) < 1e-9
    daemon.assert_limits_kept()
    assert second.timing.attempts >= 1
    measured = second.wait().statistics
    assert measured.acceleration <= ACCELERATION * 1.001
    assert measured.jerk <= JERK * 1.001
    assert state(robot).fault_text == ""


def test_it_may_be_replaced_again_and_again(daemon, robot):
    generator = np.random.default_rng(11)
    handles = [long_turn(robot)]
    for _ in range(25):
        # So slow that a busy machine lets none of them end.
        target = generator.normal(size=3)
        handles.append(robot.move([key(*target)], approach=True, limits={"velocity": 0.1}))
    handles.append(robot.move([key(*target)], approach=True))
    assert handles[-1].wait(20.0).outcome == pb.OUTCOME_DONE
    assert {handle.wait(5.0).outcome for handle in handles[:-1]} == {pb.OUTCOME_REPLACED}
    sent = daemon.sent()
    assert rotation.angle(sent[-1], rotation.exp(target)) < 1e-9
    daemon.assert_limits_kept()


@pytest.mark.parametrize("what", ["pause", "speed"])
def test_it_may_be_replaced_while_paused_or_slowed(daemon, robot, what):
    long_turn(robot)
    robot.pause() if what == "pause" else robot.set_speed(0.4)
    until(lambda: state(robot).is_paused if what == "pause" else state(robot).speed == 0.4, "it")
    second = robot.move([key(0.4, 0, 0)], approach=True)
    assert second.wait(20.0).outcome == pb.OUTCOME_DONE
    daemon.assert_limits_kept()


def test_what_is_asked_for_during_a_stop_waits_for_rest_and_says_so(daemon, robot):
    long_turn(robot)
    robot.stop()
    second = robot.move([key(0.4, 0, 0)], approach=True)
    assert 0.0 < second.timing.waiting < second.timing.planning
    assert second.wait(20.0).outcome == pb.OUTCOME_DONE
    daemon.assert_limits_kept()


def test_a_refused_motion_says_how_long_the_device_was_waited_for(robot):
    long_turn(robot)
    robot.stop()
    too_quick = [
        {"rotation_vector": [0, 0, 0], "time": 0},
        {"rotation_vector": [0, 0, 3], "time": 0.1},
    ]
    with pytest.raises(LimitError) as refused:
        robot.move(too_quick, approach=True)
    assert 0.0 < refused.value.waiting < refused.value.planning
    assert robot.plan([key(0.4, 0, 0)], approach=True).planning > 0.0


def test_queued_motions_follow_one_another(daemon, robot):
    handles = [turn(robot, 0.8)]
    targets = [(0.3, 0, 0.8), (0, 0.3, 0.2), (0, 0, 0)]
    handles += [robot.move([key(*target)], approach=True, queue=True) for target in targets]
    assert [handle.wait(30.0).outcome for handle in handles] == [pb.OUTCOME_DONE] * 4
    sent = daemon.sent()
    for target in targets:
        assert rotation.angle(sent, rotation.exp(np.array(target, float))).min() < 1e-9
    daemon.assert_limits_kept()


def test_a_blended_corner_is_not_a_stop_and_stays_within_its_tolerance(daemon, robot):
    corner = np.array([0.0, 0.0, 1.0])
    slow = {"limits": {"velocity": 0.5}}  # nothing a busy machine does outlasts the first
    first = turn(robot, 1.0, **slow)
    blended = {"queue": True, "blend_tolerance": 0.1, **slow}
    second = robot.move([key(0.8, 0, 1.0)], approach=True, **blended)
    passed, done = first.wait(20.0), second.wait(20.0)
    assert (passed.outcome, done.outcome) == (pb.OUTCOME_PASSED, pb.OUTCOME_DONE)
    sent = daemon.sent()
    gaps = rotation.angle(sent, rotation.exp(corner))
    nearest = int(np.argmin(gaps))
    assert gaps[nearest] < 0.1
    said = float(passed.text.removesuffix(" deg from its end"))
    assert said == pytest.approx(np.degrees(gaps[nearest]), rel=0.02)
    speed = rotation.angle(sent[:-1], sent[1:]) / daemon.period
    assert speed[nearest - 20 : nearest + 20].min() > 0.05
    daemon.assert_limits_kept()


def test_a_motion_to_be_blended_is_run_however_late_it_is_asked_for(daemon, robot):
    ended = []
    for k in range(12):
        first = turn(robot, 0.3)
        ahead = first.plan.duration * (1.0 - k / 12)
        next((now for now in first if now.duration - now.path_time < ahead), None)
        second = turn(robot, -0.3, queue=True, blend_tolerance=0.2)
        ended += [first.wait(10.0, check=False).outcome, second.wait(10.0, check=False).outcome]
    assert pb.OUTCOME_STOPPED not in ended
    daemon.assert_limits_kept()


def test_a_motion_that_is_stopped_between_its_blend_and_its_corner_says_so(daemon, robot):
    slow = {"limits": {"velocity": 0.2}}
    first = turn(robot, 1.0, **slow)
    blended = {"queue": True, "blend_tolerance": 0.05, **slow}
    second = robot.move([key(0.8, 0, 1.0)], approach=True, **blended)
    number = second.motion_number
    # Whoever asks may wait a tenth of a second for the answer, and the blend lasts no longer.
    next(batch for batch in robot.watch(DEVICE) if any(cycle.motion == number for cycle in batch))
    robot.stop()
    ended = first.wait(20.0, check=False), second.wait(20.0, check=False)
    assert [summary.outcome for summary in ended] == [pb.OUTCOME_STOPPED] * 2
    assert "left for motion" in ended[0].text
    assert "stopped by" in ended[0].text
    daemon.assert_limits_kept()


def test_a_stop_ends_what_runs_and_what_was_to_follow(daemon, robot):
    handles = [long_turn(robot), robot.move([key(0, 0, 0)], approach=True, queue=True)]
    robot.stop()
    assert {handle.wait(10.0, check=False).outcome for handle in handles} == {pb.OUTCOME_STOPPED}
    assert state(robot).state == pb.STATE_HOLDING
    daemon.assert_limits_kept()


def test_nothing_is_queued_behind_a_motion_that_ends_early(daemon, robot):
    # From there on the first motion is so short that the servo has the second soon after.
    assert robot.move([key(0, 0, 0)], approach=True).wait(20.0).outcome == pb.OUTCOME_DONE
    first = turn(robot, 0.3)
    second = robot.move([key(0, 0, 1.3)], approach=True, queue=True)
    next(now for now in first if now.path_time > 0.1)
    second.cancel()
    with pytest.raises(StateError, match="which this was to follow, ends early: stopped by"):
        robot.move([key(0, 0, 0)], approach=True, queue=True)
    assert first.wait(10.0).outcome == pb.OUTCOME_DONE
    until(lambda: state(robot).state == pb.STATE_HOLDING, "rest")
    daemon.assert_limits_kept()


def test_a_halt_is_quicker_than_a_stop_and_keeps_the_limits(daemon, robot):
    handle = long_turn(robot)
    robot.halt()
    summary = handle.wait(10.0, check=False)
    assert summary.outcome == pb.OUTCOME_STOPPED
    assert "stopped by" in summary.text
    assert turn(robot, 0.1).wait(10.0).outcome == pb.OUTCOME_DONE
    daemon.assert_limits_kept()


def test_a_device_that_never_is_on_target_is_said_not_to_be(tmp_path):
    model = "model = 'orientd_loopback.joint:LaggedBody'"
    options = f"{model}\nmodel_options = {{bandwidth_hz = 0.1}}"
    with DaemonProcess(tmp_path / "daemon", options=options) as daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with orientd.connect(daemon.socket) as robot:
            gate = orientd.OnTarget(tolerance=1e-4, rate=1e-2, settle_time=0.1, timeout=0.3)
            summary = turn(robot, 0.4, on_target=gate).wait(20.0)
    assert summary.outcome == pb.OUTCOME_UNSETTLED
    assert "not on target within 0.3 s" in summary.text


WOBBLING = '''
from math import cos, sin
from orientd.driver import ZERO
from orientd.floats import multiply

class WobblingBody:
    """A body that is where it is sent for 0.1 s, and 0.01 rad beside it for the next 0.1 s."""

    def __init__(self):
        self.seconds = 0.0

    def place(self, q):
        """Stand still."""

    def follow(self, q, period):
        self.seconds += period
        half = 0.005 if self.seconds % 0.2 < 0.1 else 0.0
        return multiply(q, (cos(half), sin(half), 0.0, 0.0)), ZERO
'''


def test_a_device_is_on_target_only_if_it_stays_there(tmp_path, monkeypatch):
    (tmp_path / "wobbling.py").write_text(WOBBLING)
    monkeypatch.syspath_prepend(tmp_path)
    daemon = DaemonProcess(tmp_path / "daemon", options="model = 'wobbling:WobblingBody'")
    daemon.import_from(tmp_path)
    with daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with orientd.connect(daemon.socket) as robot:
            outcomes = []
            for seconds in (0.05, 0.15):
                gate = orientd.OnTarget(tolerance=1e-3, rate=0.1, settle_time=seconds, timeout=1.0)
                outcomes.append(turn(robot, seconds, on_target=gate).wait(20.0).outcome)
    assert outcomes == [pb.OUTCOME_DONE, pb.OUTCOME_UNSETTLED]


def test_devices_begin_together(tmp_path):
    daemon = DaemonProcess(tmp_path / "daemon")
    text = daemon.config.read_text()
    daemon.config.write_text(f'{text}\n[devices.leg]\ndriver = "loopback"\nrate_hz = 500.0\n')
    with daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with orientd.connect(daemon.socket) as robot:
            assert turn(robot, 0.1, device="leg").wait(20.0).outcome == pb.OUTCOME_DONE
            assert len({device.phase for device in robot.devices()}) == 2
            instant = time.time() + 2.0
            handles = [
                turn(robot, 0.4, device=name, start_time=instant) for name in (DEVICE, "leg")
            ]
            summaries = [handle.wait(20.0) for handle in handles]
    assert {summary.outcome for summary in summaries} == {pb.OUTCOME_DONE}
    for summary in summaries:
        assert 0.0 <= summary.start_lateness < 0.5
        assert summary.HasField("start_skew")


def test_devices_begin_together_although_the_clock_is_set_between_their_requests(
    tmp_path, monkeypatch
):
    with DaemonProcess(tmp_path / "daemon", others=["leg"]) as daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        with orientd.connect(daemon.socket) as robot:
            instant, unix_ns = time.time() + 2.0, time.time_ns
            first = turn(robot, 0.4, device=DEVICE, start_time=instant)
            # A daemon in virtual time shares this clock.
            monkeypatch.setattr(time, "time_ns", lambda: unix_ns() - 300_000_000)
            second = turn(robot, 0.4, device="leg", start_time=instant)
            summaries = [handle.wait(20.0) for handle in (first, second)]
    assert [summary.outcome for summary in summaries] == [pb.OUTCOME_DONE] * 2
    assert summaries[1].HasField("start_skew")


def test_the_time_that_planning_takes_is_allowed_for_once_it_is_known(robot, monkeypatch):
    if harness.MACHINE.is_patient:
        pytest.skip("real planners take no certain time")
    for module in ("processes", "planners"):  # of the world
        monkeypatch.setattr(f"{module}.PLANNING", (0.02,))
    long_turn(robot)
    attempts = [
        turn(robot, angle, limits={"velocity": 0.1}).timing.attempts
        for angle in (1.0, -1.0, 1.0, -1.0, 1.0)
    ]
    assert attempts[-3:] == [1, 1, 1]


def test_a_start_time_is_refused_while_the_device_moves(robot):
    first = long_turn(robot)
    with pytest.raises(StateError, match="is moving: a start time needs one at rest"):
        turn(robot, -0.3, start_time=time.time() + 5.0)
    assert not first.is_done


def test_a_motion_replaces_one_that_waits_for_its_start_time(daemon, robot):
    first = turn(robot, 0.4, start_time=time.time() + 400.0)
    after = turn(robot, 0.1, queue=True)
    second = turn(robot, -0.3)
    assert second.wait(20.0).outcome == pb.OUTCOME_DONE
    outcomes = {handle.wait(10.0, check=False).outcome for handle in (first, after)}
    assert outcomes == {pb.OUTCOME_REPLACED}
    daemon.assert_limits_kept()


def test_the_end_of_a_motion_waits_for_none_that_has_not_begun(robot):
    """Nor does that one end with it."""
    first = turn(robot, 0.4, start_time=time.time() + 400.0)
    second, third = (turn(robot, angle, queue=True) for angle in (0.1, 0.2))
    third.cancel()
    assert third.wait(10.0, check=False).outcome == pb.OUTCOME_STOPPED
    second.cancel()
    assert second.wait(10.0, check=False).outcome == pb.OUTCOME_STOPPED
    assert not first.is_done
    first.cancel()
    assert first.wait(10.0, check=False).outcome == pb.OUTCOME_STOPPED


def test_a_motion_queued_behind_a_waiting_one_follows_it(daemon, robot):
    first = turn(robot, 0.4, start_time=time.time() + 2.0)
    second = turn(robot, 0.1, queue=True, blend_tolerance=0.05)
    assert first.wait(20.0).outcome == pb.OUTCOME_PASSED
    assert second.wait(20.0).outcome == pb.OUTCOME_DONE
    daemon.assert_limits_kept()


def test_what_cannot_be_asked_for_is_refused(robot):
    for how, field in (
        ({"blend_tolerance": 0.1}, "blend_tolerance"),
        ({"blend_tolerance": 4.0, "queue": True}, "blend_tolerance"),
        ({"blend_tolerance": "wide", "queue": True}, "blend_tolerance: expected a number, got 'wi"),
        ({"progress_rate_hz": None}, "progress_rate_hz: expected a number, got None"),
        ({"start_time": time.time() - 5.0}, "start_time"),
        ({"start_time": time.time() + 5.0, "queue": True}, "start_time"),
        (
            {"on_target": orientd.OnTarget(tolerance=0.0, rate=1.0, settle_time=1.0)},
            "on_target.tolerance",
        ),
    ):
        with pytest.raises(RequestError, match=field):
            turn(robot, 0.4, **how)
    with pytest.raises(RequestError, match="speed: expected more than 0 and at most 1, got 'slow'"):
        robot.set_speed("slow")
