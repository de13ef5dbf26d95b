"""What a program leaves behind when it leaves ``with orientd.connect()``, and what waiting says."""

import time
from contextlib import closing, suppress

import pytest
from harness import DEVICE, until

import orientd
from orientd.errors import MotionStopped, StateError
from orientd.protocol import control_pb2 as pb
from orientd.rotation import angle

pytestmark = pytest.mark.world

THERE = {"rotation_vector": [0.0, 0.0, 0.6]}
BACK = {"rotation_vector": [0.0, 0.0, 0.0]}
SLOWLY = {"velocity": 0.1}


@pytest.fixture
def daemon(daemon):
    daemon.at_rest()
    with closing(orientd.connect(daemon.socket)) as robot:
        robot.move([BACK], approach=True).wait(20.0)
    return daemon


def state(daemon):
    with closing(orientd.connect(daemon.socket)) as robot:
        return robot.state().devices[DEVICE]


def leave_after(daemon, act):
    with orientd.connect(daemon.socket) as robot:
        act(robot)


def is_at(daemon, keyframe):
    q = state(daemon).cycle.q
    goal = orientd.Pose(**keyframe).q
    return angle((q.w, q.x, q.y, q.z), goal) < 1e-6


def test_it_waits_for_what_moves_and_for_what_is_queued_behind_that(daemon):
    with orientd.connect(daemon.socket) as robot:
        robot.move([THERE], approach=True)
        robot.move([BACK, THERE], approach=True, queue=True)
    assert is_at(daemon, THERE)
    assert state(daemon).ended.outcome == pb.OUTCOME_DONE


@pytest.mark.parametrize("error", [KeyboardInterrupt, ZeroDivisionError])
def test_an_exception_stops_what_moves(daemon, error):
    def fail(robot):
        robot.move([THERE], approach=True, limits=SLOWLY)
        raise error

    with pytest.raises(error):
        leave_after(daemon, fail)
    until(lambda: state(daemon).state == pb.STATE_HOLDING, "rest")
    assert not is_at(daemon, THERE)


def begin_later(robot):
    robot.move([THERE], approach=True, start_time=time.time() + 600.0)


def turn_endlessly(robot):
    robot.turn_endlessly([0.0, 0.0, 0.2])


def begin_and_pause(robot):
    robot.move([THERE], approach=True, limits=SLOWLY)
    robot.pause()


@pytest.mark.parametrize(
    ("begin", "why"),
    [
        (begin_later, "has a later start time"),
        (turn_endlessly, "turns until it is stopped"),
        (begin_and_pause, "is paused"),
    ],
)
def test_it_does_not_wait_for_what_does_not_end_by_itself_soon_and_says_so(daemon, begin, why):
    begun = time.monotonic()
    expected = f"^motion [0-9]+ {why}, so the end of `with` stopped it"
    with pytest.raises(StateError, match=expected):
        leave_after(daemon, begin)
    assert time.monotonic() - begun < 60.0
    until(lambda: state(daemon).state == pb.STATE_HOLDING, "rest")
    assert not is_at(daemon, THERE)


def test_a_motion_that_somebody_else_stops_is_an_error_unless_it_was_told(daemon):
    with closing(orientd.connect(daemon.socket, holder="ben")) as other:

        def begin(robot):
            robot.move([THERE], approach=True, limits=SLOWLY)
            other.stop()

        with pytest.raises(MotionStopped, match=r"^motion [0-9]+: stopped by") as raised:
            leave_after(daemon, begin)
        assert raised.value.summary.outcome == pb.OUTCOME_STOPPED
        with orientd.connect(daemon.socket) as robot:
            motion = robot.move([THERE], approach=True, limits=SLOWLY)
            other.stop()
            with suppress(MotionStopped):
                motion.wait(20.0)


@pytest.mark.parametrize("end", ["stop", "halt", "cancel"])
def test_a_stop_of_ones_own_is_no_error_at_the_end(daemon, end):
    with orientd.connect(daemon.socket) as robot:
        motion = robot.move([THERE], approach=True, limits=SLOWLY)
        motion.cancel() if end == "cancel" else getattr(robot, end)()
    assert motion.wait(check=False).outcome == pb.OUTCOME_STOPPED
    with pytest.raises(MotionStopped):
        motion.wait()


def test_a_motion_that_another_one_replaces_is_no_error(daemon):
    with orientd.connect(daemon.socket) as robot:
        first = robot.move([THERE], approach=True, limits=SLOWLY)
        robot.move([BACK], approach=True)
        assert first.wait(20.0).outcome == pb.OUTCOME_REPLACED


def test_a_file_by_its_name_and_a_motion_that_is_planned_already_are_run(daemon, tmp_path):
    file = tmp_path / "turn.yaml"
    file.write_text("keyframes: [{rotation_vector: [0, 0, 0.6]}]\napproach: true\n")
    planned = orientd.plan([THERE, BACK], approach=True)
    with orientd.connect(daemon.socket) as robot:
        robot.move(str(file)).wait(20.0)
        assert is_at(daemon, THERE)
        robot.move(planned).wait(20.0)
        assert is_at(daemon, BACK)
        with pytest.raises(TypeError, match="a motion file has its own limits"):
            robot.move(str(file), limits=SLOWLY)
