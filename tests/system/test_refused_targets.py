"""Targets, chunks and samples that are refused: the call raises, or they are counted and told."""

import math
import os
import signal
import threading
import time

import numpy as np
import pytest
from harness import DaemonProcess, until
from scipy.spatial.transform import Rotation

import orientd
from orientd.client import playing
from orientd.errors import DaemonError, OrientdError, RequestError, StateError
from orientd.protocol import control_pb2 as pb
from orientd_diffusion_policy import RTDEInterpolationController

pytestmark = pytest.mark.world

IDENTITY = orientd.Quaternion(w=1, x=0, y=0, z=0)
NO_POSE = orientd.Quaternion(w=math.nan, x=0, y=0, z=0)


@pytest.fixture
def robot(daemon):
    with orientd.connect(daemon.socket) as robot:
        robot.move([IDENTITY], approach=True).wait(20.0)
        yield robot


@pytest.fixture
def warnings(robot):
    """Return the texts of the warnings about the device, as they come."""
    observer, texts = robot.observe(), []

    def read():
        events = observer.events()
        texts.extend(event.text for event in events if event.kind == pb.EVENT_KIND_WARNING)

    thread = threading.Thread(target=read)
    thread.start()
    time.sleep(0.1)
    yield texts
    observer.close()
    thread.join()


def ramp(count):
    return Rotation.from_rotvec(np.outer(np.linspace(0.0, 0.2, count), [0.0, 0.0, 1.0]))


def move_once_with_a_position(play):
    with play.engage() as clutch:
        clutch.move(IDENTITY)
        clutch.move(IDENTITY, position=[1.0, 0.0, 0.0])


WRONG = {
    "300 poses": (
        lambda play: play.chunk(ramp(300), rate=50.0),
        r"poses: expected 1 to 256 poses, got 300; send them as several chunks, one behind",
    ),
    "no pose": (
        lambda play: play.chunk([], rate=30.0),
        r"poses: expected 1 to 256 poses, got 0; send no chunk$",
    ),
    "an observation to come": (
        lambda play: play.chunk(ramp(9), rate=30.0, observed=time.monotonic() + 1.0),
        r"observed: expected at most 0 s ahead, got (1|0\.99)",
    ),
    "an observation in Unix time": (
        lambda play: play.chunk(ramp(9), rate=30.0, observed=time.time()),
        r"observed: .* s is Unix time; give time.monotonic\(\) of this machine, now",
    ),
    "only NaN": (
        lambda play: play.chunk([NO_POSE] * 16, rate=30.0),
        r"poses\[15\]: expected a quaternion of norm 1 within 1e-06, got norm nan; "
        r"none of the 16 is a pose, so there is nothing to play",
    ),
    "infinite positions": (
        lambda play: play.chunk(ramp(2), rate=30.0, positions=[[0.0, math.inf, 0.0]] * 2),
        r"poses\[1\]: expected a position within 1000 m, got \(0.0, inf, 0.0\); none of the 2 is",
    ),
    "a position that is text": (
        lambda play: play.chunk(ramp(2), rate=30.0, positions=[[0, 0, 0], [0, "a", 0]]),
        r"positions\[1\]: expected three numbers, got \[0, 'a', 0\]; give x, y and z$",
    ),
    "a pose with two numbers as its position": (
        lambda play: play.chunk([{"rotation_vector": [0, 0, 0], "position": [0, 1]}], rate=30.0),
        r"poses\[0\].position: expected three numbers, got \[0, 1\]; give x, y and z$",
    ),
    "one position for two poses": (
        lambda play: play.chunk(ramp(2), rate=30.0, positions=np.zeros((1, 3))),
        r"positions: expected 2, one for each pose, got 1$",
    ),
    "a time that is text": (
        lambda play: play.chunk(ramp(2), times=[0.0, "soon"]),
        r"times\[1\]: expected seconds of time.monotonic\(\).*, got 'soon'; give a number$",
    ),
    "a rate of 1e9": (
        lambda play: play.chunk(ramp(2), rate=1e9),
        r"rate: expected more than 0 and at most 2000 poses a second, or times, got 1000000000.0",
    ),
    "12 s ahead": (
        lambda play: play.chunk(ramp(16), start=time.monotonic() + 12.0, rate=30.0),
        r"start: expected at most 10 s ahead, got 1[12].* s; "
        r"give time.monotonic\(\) of this machine, now [0-9.]+ s$",
    ),
    "Unix time": (
        lambda play: play.chunk(ramp(16), start=time.time(), rate=30.0),
        r"start: [0-9.]+ s is Unix time; give time.monotonic\(\) of this machine, now [0-9.]+ s$",
    ),
    "Unix times": (
        lambda play: play.chunk(ramp(16), times=time.time() + np.arange(16) / 30.0),
        r"times: [0-9.]+ s is Unix time; give time.monotonic\(\)",
    ),
    "nanoseconds": (
        lambda play: play.chunk(ramp(16), start=time.monotonic_ns(), rate=30.0),
        r"start: .* s is a time in nanoseconds; give time.monotonic\(\) of this machine",
    ),
    "times from 0": (
        lambda play: play.chunk(ramp(16), times=np.arange(16) / 30.0 - 100.0),
        r"times: expected at most 60 s ago, got [0-9.]+ s; give time.monotonic\(\) of this",
    ),
    "a target in Unix time": (
        lambda play: play.aim(IDENTITY, time_ns=time.time_ns()),
        r"target.time_ns: .* ns is Unix time; give time.monotonic_ns\(\) of this machine",
    ),
    "a target in seconds": (
        lambda play: play.aim(IDENTITY, time_ns=round(time.monotonic())),
        r"target.time_ns: .* ns is a time in seconds; give time.monotonic_ns\(\) of this machine",
    ),
    "a target in a fraction": (
        lambda play: play.aim(IDENTITY, time_ns=time.monotonic()),
        r"target.time_ns: expected a whole number of nanoseconds, got [0-9.]+; give time.monotonic",
    ),
    "a target that lives for ever": (
        lambda play: play.aim(IDENTITY, time_to_live=math.inf),
        r"target.time_to_live: expected more than 0 and at most 60 s, got inf; repeat a target",
    ),
    "a point in Unix time": (
        lambda play: play.look_at([1.0, 0.0, 0.0], time_ns=time.time_ns()),
        r"time_ns: .* ns is Unix time; give time.monotonic_ns\(\) of this machine",
    ),
    "a direction 5 s ahead": (
        lambda play: play.point(0.0, 0.0, time_ns=time.monotonic_ns() + 5_000_000_000),
        r"time_ns: expected at most 1 s ahead, got [45].* s; give time.monotonic_ns\(\)",
    ),
    "a base in Unix time": (
        lambda play: play.base(IDENTITY, time_ns=time.time_ns()),
        r"time_ns: .* ns is Unix time; give time.monotonic_ns\(\) of this machine",
    ),
    "a base without a life": (
        lambda play: play.base(IDENTITY, time_to_live="long"),
        r"time_to_live: expected more than 0 and at most 60 s, got 'long'",
    ),
    "a scale that is none": (
        lambda play: play.engage(scale=math.nan),
        r"scale: expected a number above 0, got nan; with 1 the device turns as far as the hand$",
    ),
    "a hand without a life": (
        lambda play: play.engage(time_to_live=0.0),
        r"time_to_live: expected more than 0 and at most 60 s, got 0.0",
    ),
    "a hand with a position now and then": (
        move_once_with_a_position,
        r"position: expected in every call or in none, got \(1.0, 0.0, 0.0\) after none",
    ),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_what_the_client_knows_to_be_wrong_is_refused_at_the_call(robot, wrong):
    send, line = WRONG[wrong]
    begin = time.monotonic()
    with robot.play() as play, pytest.raises(RequestError, match=line):
        send(play)
    assert time.monotonic() - begin < 10.0
    assert play.timing().chunks == 0


def test_a_path_tolerance_that_is_none_is_refused(robot):
    for wrong in (0.0, -0.001, math.nan, math.inf):
        with pytest.raises(RequestError, match="path_tolerance: expected more than 0 m, got"):
            robot.track(path_tolerance=wrong)


POSE = {"quaternion": {"w": 1.0, "x": 0.0, "y": 0.0, "z": 0.0}}


@pytest.mark.real
def test_a_hundred_poses_are_played_as_several_chunks(robot):
    times, q = time.monotonic() + 0.2 + np.arange(100) / 50.0, ramp(100)
    with robot.play() as play:
        for part in (slice(0, 40), slice(40, 80), slice(80, 100)):
            play.chunk(q[part], times=times[part])
        assert play.wait(20.0)
        assert play.report.q.z == pytest.approx(math.sin(0.1), abs=1e-6)
    assert play.timing().chunks == 3


def test_poses_that_are_none_are_counted_and_told(robot, warnings):
    poses = [POSE, NO_POSE, POSE, orientd.Quaternion(w=2, x=0, y=0, z=0)]
    with robot.play() as play:
        play.chunk(poses, rate=30.0)
        until(lambda: play.timing().chunks, "the chunk")
    problem = "poses[3]: expected a quaternion of norm 1 within 1e-06, got norm 2; skipped"
    assert (play.timing().skipped, play.timing().refused) == (2, 0)
    assert play.timing().refusal == problem
    until(lambda: f"a client's targets: {problem}" in warnings, "the event")


def test_a_chunk_that_is_late_as_a_whole_is_counted_and_told(robot, warnings):
    with robot.play() as play:
        play.chunk(ramp(16), times=time.monotonic() - 0.6 + np.arange(16) / 30.0)
        until(lambda: play.timing().stale == 16, "the poses")
    assert "its last pose was due 0.1" in play.timing().refusal
    assert play.timing().longest_inference == pytest.approx(0.5, abs=1e-6)
    assert play.timing().starved == 1
    until(lambda: warnings, "the event")
    assert warnings[0].startswith("a client's targets: chunk: its last pose was due 0.1")
    assert "so none is played; send longer chunks, or stamp them later" in warnings[0]


def aim_late(play):
    play.aim(IDENTITY, time_ns=time.monotonic_ns() - 2_000_000_000)


@pytest.mark.parametrize(
    ("send", "problem"),
    [
        (lambda play: play.aim(NO_POSE), "target.orientation: expected a quaternion of norm 1"),
        (
            lambda play: play.aim(IDENTITY, position=[1e6, 0.0, 0.0]),
            "target.position: expected a position within 1000 m, got (1000000.0, 0.0, 0.0)",
        ),
        (
            lambda play: play.aim(IDENTITY, angular_velocity=[0.0, math.inf, 0.0]),
            "target.angular_velocity: expected an angular velocity within 1000 rad/s, got (0.0,",
        ),
        (aim_late, "target.time_ns: stamped 2"),
    ],
)
def test_a_target_that_is_none_is_counted_and_told(robot, warnings, send, problem):
    with robot.track() as tracking:
        for _ in range(3):
            send(tracking)
            time.sleep(0.01)
        until(lambda: tracking.report.refused == 3, "the refusals")
    assert tracking.report.refusal.startswith(problem)
    until(lambda: warnings, "the event")
    assert warnings[0].startswith(f"a client's targets: {problem}")
    assert len(warnings) == 1


def test_what_the_daemon_refuses_of_another_program_is_counted_and_named(robot):
    now_ns = time.monotonic_ns()
    q = [1.0, 0.0, 0.0, 0.0]
    chunks = {
        "chunk.orientations: expected 4 numbers": pb.TrackChunk(times_ns=[1], orientations=q[:2]),
        "is Unix time; give the daemon's monotonic clock": pb.TrackChunk(
            times_ns=[time.time_ns()], orientations=q
        ),
        "expected at most 60 s ago, got 70": pb.TrackChunk(
            times_ns=[now_ns - 70 * 10**9], orientations=q
        ),
        "none of its 1 poses is one": pb.TrackChunk(times_ns=[now_ns], orientations=[0.0] * 4),
    }
    with robot.play() as play:
        for count, (problem, chunk) in enumerate(chunks.items(), 1):
            play.send(pb.TrackRequest(chunk=chunk))
            until(lambda count=count: play.timing().refused == count, problem)
            assert problem in play.timing().refusal


def test_samples_of_a_point_and_a_base_that_are_too_old_are_counted(robot):
    with robot.track() as tracking:
        tracking.point(0.0, 0.0)
        tracking.point(1.0, 0.0, time_ns=time.monotonic_ns() - 10_000_000_000)
        assert tracking.skipped == 1
        tracking.point(
            1.0, 0.0, azimuth_rate=1.0, time_ns=time.monotonic_ns() - 10**9, frame="", roll=0.0
        )
        assert tracking.skipped == 2
        tracking.base(IDENTITY, time_ns=time.monotonic_ns() - 10_000_000_000)
        tracking.base(NO_POSE)
        assert tracking.base_report.skipped == 2
    assert tracking.report.left_out == 0


def test_limits_that_allow_no_motion_are_refused(robot):
    line = r"limits.acceleration: must be within 1e-09 and 1e\+12 rad/s\^2, got 1e-10; give a limit"
    with pytest.raises(RequestError, match=line):
        robot.track(limits={"acceleration": 1e-10})


def test_a_block_ends_if_the_device_does_not_come_to_rest(robot, monkeypatch):
    monkeypatch.setattr(playing, "LONGEST_SETTLING", 0.5)
    begin = time.monotonic()
    play = robot.play(limits={"velocity": 0.01})
    play.chunk(ramp(16), rate=30.0)
    line = r"does not rest 0.5 s after the last pose was due, and is 0\.1\d+ rad away from it"
    with pytest.raises(StateError, match=line), play:
        assert not play.wait()
    assert 1.5 < time.monotonic() - begin < 10.0
    assert math.hypot(play.report.omega_body.x, play.report.omega_body.z) < 1e-9


def test_a_block_ends_if_the_daemon_hangs(tmp_path, monkeypatch):
    monkeypatch.setattr(playing, "LONGEST_SETTLING", 0.5)
    with DaemonProcess(tmp_path, patience=60.0) as daemon:
        daemon.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=daemon.token))
        robot = orientd.connect(daemon.socket)
        play = robot.play()
        begin = time.monotonic()
        play.chunk(ramp(16), rate=30.0)
        os.kill(daemon.process.pid, signal.SIGSTOP)
        with pytest.raises(OrientdError, match="does not rest"), play:
            pass
        assert time.monotonic() - begin < 20.0
        os.kill(daemon.process.pid, signal.SIGCONT)
        with pytest.raises(DaemonError, match="did not report that the device rests within 10 s"):
            play.close()
        robot.close()


def test_a_block_with_a_hand_after_chunks_ends_once_the_device_rests(robot):
    with robot.play() as play:
        play.chunk(ramp(16), rate=30.0)
        with play.engage() as clutch:
            until(lambda: clutch.holds or clutch.move(IDENTITY), "the clutch")
        begin = time.monotonic()
    assert time.monotonic() - begin < 5.0


def test_a_waypoint_of_another_clock_or_without_a_pose_is_refused_and_forgotten(daemon):
    with RTDEInterpolationController(socket=daemon.socket) as controller:
        pose = [0.0] * 6
        with pytest.raises(RequestError, match=r"target_time: expected .* by time.time\(\), got"):
            controller.schedule_waypoint(pose, time.monotonic())
        with pytest.raises(RequestError, match=r"pose: expected finite numbers, got \[nan"):
            controller.schedule_waypoint([math.nan, *pose[1:]], time.time() + 0.1)
        with pytest.raises(RequestError, match=r"times: expected at most 10 s ahead, got (19|20)"):
            controller.schedule_waypoint(pose, time.time() + 20.0)
        with pytest.raises(RequestError, match=r"poses\[0\]: expected a position within 1000 m"):
            controller.schedule_waypoint([1e6, *pose[1:]], time.time() + 0.1)
        controller.schedule_waypoint(pose, time.time() + 0.5)
