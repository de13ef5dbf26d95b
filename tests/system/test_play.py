"""Chunks of poses through a real daemon: from the client to the setpoints that the driver got."""

import getpass
import math
import threading
import time

import numpy as np
import pytest
from harness import until
from scipy.spatial.transform import Rotation

import orientd
from orientd.errors import OrientdError
from orientd.protocol import to_vector
from orientd_loopback import read_recording

pytestmark = pytest.mark.world

Q = orientd.Quaternion
RATE = 30.0


@pytest.fixture
def before(daemon):
    """How many setpoints the driver got before the test, but for those that differences take."""
    return max(0, len(daemon.sent()) - 3)


@pytest.fixture
def robot(daemon, before):
    with orientd.connect(daemon.socket) as robot:
        robot.move([Q(w=1, x=0, y=0, z=0)], approach=True).wait(20.0)
        yield robot


def about_z(angles):
    return Rotation.from_rotvec([[0.0, 0.0, angle] for angle in angles])


def angle_of(report):
    return 2.0 * math.atan2(report.q.z, report.q.w)


@pytest.mark.real
def test_chunks_of_a_policy_make_one_motion(daemon, robot, before):
    begin = time.monotonic()

    def pose(t):
        return 0.3 * math.sin(2.0 * t)

    with robot.play() as play:
        for _ in range(8):
            observed = time.monotonic()
            time.sleep(0.1)  # infers
            stamps = observed + np.arange(16) / RATE
            play.chunk(about_z([pose(t - begin) for t in stamps]), times=stamps)
        until(lambda: play.timing().chunks == 8, "the last chunk")
        timing = play.timing()
        assert timing.stale >= 8 * 3
        assert 0.1 <= timing.inference < math.inf > timing.longest_inference
    daemon.assert_limits_kept(before)


def test_every_form_of_a_pose_is_taken_and_no_pose_is_skipped(robot):
    poses = [
        Q(w=1, x=0, y=0, z=0),
        Rotation.from_rotvec([0.0, 0.0, 0.02]),
        {"rotation_vector": [0.0, 0.0, 0.04]},
        Q(w=math.nan, x=0, y=0, z=0),
        {"quaternion": {"w": 0.0, "x": 0.0, "y": 0.0, "z": 0.0}},
        Q(w=0.5, x=0, y=0, z=0),
        {"rotation_vector": [math.nan, 0.0, 0.0]},
        {"rotation_vector": [0.0, 0.0, 0.1]},
    ]
    with robot.play() as play:
        play.chunk(poses, rate=RATE)
    assert angle_of(play.report) == pytest.approx(0.1, abs=1e-5)
    assert play.timing().skipped == 4


def test_positions_are_played_too(robot):
    with robot.play() as play:
        positions = np.column_stack([np.linspace(0.0, 0.03, 30), np.zeros(30), np.zeros(30)])
        play.chunk(about_z(np.linspace(0.0, 0.1, 30)), rate=RATE, positions=positions)
        play.wait(10.0)
        assert to_vector(play.report.position) == pytest.approx((0.03, 0.0, 0.0), abs=1e-5)
        play.chunk(
            [{"rotation_vector": [0, 0, 0.1], "position": [0.03, 0.01 * k, 0]} for k in (0, 1, 2)],
            rate=10.0,
        )
    (device,) = robot.state().devices.values()
    assert to_vector(device.cycle.position) == pytest.approx((0.03, 0.02, 0.0), abs=1e-4)


def test_a_position_that_the_limits_hold_back_is_told_in_metres(robot):
    with robot.play(limits={"linear_velocity": 0.02}) as play:
        places = np.tile(to_vector(play.report.position), (30, 1))
        places[:, 0] += np.linspace(0.0, 0.1, 30)
        play.chunk(about_z(np.zeros(30)), rate=RATE, positions=places)
        until(lambda: play.timing().position_lag > 0.0, "a report on the way")
    timing = play.timing()
    assert timing.largest_position_behind == pytest.approx(0.08, abs=0.01)
    assert timing.position_behind < 1e-4
    assert (timing.largest_behind, timing.lag) == (0.0, 0.0)


def test_the_distance_to_a_target_is_reported_in_metres(robot):
    with robot.track() as tracking:
        tracking.aim(Q(w=1, x=0, y=0, z=0))
        until(lambda: tracking.report.HasField("error"), "the target")
        assert tracking.timing().position_error is None
        x, y, z = to_vector(tracking.report.position)
        tracking.aim(Q(w=1, x=0, y=0, z=0), position=[x + 0.05, y, z], time_to_live=5.0)
        until(lambda: tracking.report.position_error > 0.01, "a report on the way")
        until(lambda: tracking.report.position_error < 1e-6, "the position")
        timing = tracking.timing()
        assert (timing.targets, timing.refused, timing.refusal) == (2, 0, "")
        assert max(timing.error, timing.position_error) < 1e-6
        # This device has no axes that turn its tool off a line.
        assert timing.path_deviation == timing.largest_path_deviation == 0.0


def test_a_noisy_chunk_is_smoothed_within_its_tolerance(robot):
    noise = 0.002 * (-1.0) ** np.arange(30)
    poses = [*about_z(0.01 * np.arange(30) + noise), {"rotation_vector": [math.nan, 0.0, 0.0]}]
    places = np.column_stack([noise, np.zeros(30), np.zeros(30)])
    positions = np.vstack([places, [[0.0, 0.0, 0.0]]])
    with robot.play() as play:
        play.chunk(poses, rate=RATE, positions=positions, tolerance=0.003, position_tolerance=0.003)
        play.wait(10.0)
    assert angle_of(play.report) == pytest.approx(0.29, abs=1e-3)
    assert to_vector(play.report.position) == pytest.approx((0.0, 0.0, 0.0), abs=1e-3)
    assert play.timing().skipped == 1


def test_noise_that_would_break_the_limits_is_smoothed_and_told(robot):
    noise = 0.02 * (-1.0) ** np.arange(256)
    with robot.play(limits={"acceleration": 5.0}) as play:
        play.chunk(about_z(0.001 * np.arange(256)), rate=100.0)
        until(lambda: play.timing().chunks == 1, "the chunk")
        assert play.timing().smoothed == 0
        play.chunk(about_z(0.001 * np.arange(256) + noise), rate=100.0)
    timing = play.timing()
    assert (timing.smoothed, timing.largest_position_smoothing) == (1, 0.0)
    assert 0.02 < timing.largest_smoothing < 0.06
    # The last pose stays.
    assert angle_of(play.report) == pytest.approx(0.255 - 0.02, abs=1e-5)


@pytest.mark.real
def test_the_latency_is_from_the_observation_to_the_setpoints_of_a_chunk(robot):
    with robot.play() as play:
        for k in range(10):
            observed = time.monotonic()
            time.sleep(0.05)  # infers
            assert play.timing().latency_p50 is None or k
            stamps = observed + np.arange(16) / RATE
            play.chunk(about_z(0.01 * (stamps - observed)), times=stamps, observed=observed)
        until(lambda: play.timing().chunks == 10, "the last chunk")
        play.wait(10.0)
    timing = play.timing()
    assert 0.05 < timing.latency_p50 <= timing.latency_p95 < 0.5
    assert timing.inference < timing.latency_p95
    assert timing.inference < timing.longest_inference < 16 / RATE


def test_a_stop_ends_the_playing(daemon, robot, before):
    play = robot.play()
    play.chunk(about_z(0.02 * np.arange(60)), rate=RATE)
    threading.Timer(0.3, robot.stop).start()
    with pytest.raises(OrientdError, match="no longer follows targets: stopped by ") as error:
        play.wait(10.0)
    assert getpass.getuser() in str(error.value)
    play.close()
    daemon.assert_limits_kept(before)


def at_rest(play):
    """Wait until the device rests at its target; the velocity alone is zero at a reversal too."""

    def is_there():
        report = play.report
        return max(math.hypot(*to_vector(report.omega_body)), report.error) < 1e-9

    until(is_there, "rest")


def test_a_hand_moves_the_device_and_letting_go_moves_nothing(daemon, robot, before):
    with robot.play() as play:
        for k in range(10):
            with play.engage(scale=0.5) as clutch:
                for step in range(10):
                    turn = Rotation.from_rotvec([0.0, 1.0, 0.02 * step])
                    clutch.move(turn, position=np.array([0.001 * step, 0.3 * k, 0.0]))
                    time.sleep(0.02)
            at_rest(play)
            begin_ns = time.monotonic_ns()
            with play.engage() as clutch:
                for _ in range(5):
                    clutch.move(Rotation.from_rotvec([2.0, 0.1 * k, 0.0]), position=[5.0, k, 0.0])
                    time.sleep(0.02)
            at_rest(play)
            setpoints = read_recording(daemon.recording)
            sent = np.array([one.q for one in setpoints if one.time_ns > begin_ns])
            assert np.abs(sent - sent[0]).max() < 1e-7
        assert angle_of(play.report) > 0.5
    daemon.assert_limits_kept(before)


def test_a_hand_takes_over_from_a_policy_once_the_device_rests(daemon, robot, before):
    with robot.play() as play:
        play.chunk(about_z(0.02 * np.arange(60)), rate=RATE)
        until(lambda: angle_of(play.report) > 0.1, "motion")
        with play.engage() as clutch:
            until(lambda: clutch.holds or clutch.move(Rotation.identity()), "the clutch")
        at_rest(play)
        assert 0.1 < angle_of(play.report) < 0.5
    daemon.assert_limits_kept(before)
