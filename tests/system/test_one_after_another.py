"""Motions that follow one another on a real daemon, judged by what its driver was sent."""

import time
from itertools import pairwise
from math import radians

import numpy as np
import pytest
from harness import DEVICE, peaks, read_recording

import orientd
from orientd import rotation
from orientd.planner import NOT_BLENDED
from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.world

PLACES = [(0.0, 0.0, 0.0), (0.1, 0.0, 0.0), (0.1, 0.1, 0.0)]


@pytest.fixture
def robot(daemon):
    with orientd.connect(daemon.socket) as robot:
        if robot.state().devices[DEVICE].state == pb.STATE_FAULT:
            robot.reset()  # of a test that failed
        robot.move([key(0, 0, 0)], positions=PLACES[:1]).wait(20.0)
        yield robot


class Sent:
    """What the driver was sent from now on."""

    def __init__(self, daemon):
        self._process = daemon
        self._before = daemon.at_rest()

    def poses(self):
        setpoints = read_recording(self._process.recording)[self._before :]
        return (
            np.array([setpoint.q for setpoint in setpoints]),
            np.array([setpoint.position for setpoint in setpoints]),
        )

    def assert_limits_kept(self):
        self._process.assert_limits_kept(self._before)


def key(*vector):
    w, x, y, z = rotation.exp(np.array(vector, dtype=float)).tolist()
    return orientd.Quaternion(w=w, x=x, y=y, z=z)


def legs(*vectors):
    """Return the keyframes of a first leg about z, and of a second one about x."""
    turns = [rotation.exp(np.array(vector)) for vector in vectors]
    q = [np.array([1.0, 0.0, 0.0, 0.0])]
    for turn in turns:
        q.append(rotation.multiply(q[-1], turn))
    return q


def quaternions(*qs):
    return [orientd.Quaternion(w=w, x=x, y=y, z=z) for w, x, y, z in map(np.ndarray.tolist, qs)]


def off(points, corners):
    """Return the farthest distance of setpoints from straight legs, rad or m."""
    shares = np.linspace(0.0, 1.0, 1000)[:, None]
    is_turn = points.shape[1] == 4
    lines = []
    for a, b in pairwise(corners):
        if is_turn:
            turn = rotation.log(rotation.multiply(rotation.conjugate(a), b))
            lines.append(rotation.multiply(a, rotation.exp(shares * turn)))
        else:
            lines.append(np.array(a) + shares * (np.array(b) - np.array(a)))
    line, some = np.concatenate(lines), points[::5]
    if is_turn:
        return 2.0 * np.arccos(np.minimum(np.abs(some @ line.T), 1.0)).min(axis=1).max()
    return np.linalg.norm(some[:, None] - line, axis=2).min(axis=1).max()


SLOW = {
    "the guide": ({"limits": {"velocity": 0.2}}, (0.0, 0.0, 1.5), (0.6, 0.0, 0.0)),
    "a pace": ({"pace": 0.12}, (0.0, 0.0, 1.0), (0.8, 0.0, 0.0)),
    "times": ({"times": [0.0, 3.5]}, (0.0, 0.0, 1.0), (0.8, 0.0, 0.0)),
}


@pytest.mark.parametrize("has_positions", [False, True])
@pytest.mark.parametrize("slow", SLOW)
def test_a_blend_from_a_slow_motion_into_a_quick_one_stays_near_both(
    daemon, robot, slow, has_positions
):
    how, *turns = SLOW[slow]
    q, sent, tolerance = legs(*turns), Sent(daemon), radians(5)
    positions = PLACES if has_positions else None
    first = robot.move(
        quaternions(*q[:2]), **how, **({"positions": positions[:2]} if positions else {})
    )
    second = robot.move(
        quaternions(*q[1:]),
        approach=True,
        queue=True,
        blend_tolerance=tolerance,
        **({"positions": positions[1:]} if positions else {}),
    )
    ended = [first.wait(30.0).outcome, second.wait(30.0).outcome]
    assert ended == [pb.OUTCOME_PASSED, pb.OUTCOME_DONE]
    orientations, places = sent.poses()
    assert off(orientations, q) <= tolerance + 1e-3
    if has_positions:
        assert off(places, PLACES) <= tolerance * 0.1 / min(map(np.linalg.norm, turns)) + 1e-4
    steps = rotation.angle(orientations[:-1], orientations[1:])
    assert steps.sum() <= sum(map(np.linalg.norm, turns)) + 1e-6
    # Until the corner, the pace of the first motion holds.
    corner = int(np.argmin(rotation.angle(orientations, q[1])))
    usual = first.plan.certificate.peak_velocity.value
    assert steps[: corner - 5].max() <= 1.011 * usual * daemon.period
    assert steps.max() > 2.0 * usual * daemon.period
    sent.assert_limits_kept()


@pytest.mark.parametrize(
    "narrow", [{"acceleration": 1.0}, {"jerk": 30.0}, {"linear_acceleration": 0.1}]
)
@pytest.mark.parametrize("blend", [0.0, 0.2])
def test_a_queued_motion_may_have_narrower_limits(daemon, robot, narrow, blend):
    q, sent = legs((0.0, 0.0, 1.0), (0.8, 0.0, 0.0)), Sent(daemon)
    begins = {"start_time": time.time() + 3.0}
    first = robot.move(quaternions(*q[:2]), positions=PLACES[:2], **begins)
    second = robot.move(
        quaternions(*q[1:]),
        positions=PLACES[1:],
        limits=narrow,
        approach=True,
        queue=True,
        blend_tolerance=blend,
    )
    ended = [first.wait(20.0).outcome, second.wait(20.0).outcome]
    assert ended in ([pb.OUTCOME_DONE] * 2, [pb.OUTCOME_PASSED, pb.OUTCOME_DONE])
    orientations, _ = sent.poses()
    if ended[0] == pb.OUTCOME_DONE:
        held = np.flatnonzero(rotation.angle(orientations, q[1]) < 1e-9)
        assert len(held) >= 3
        _, acceleration, jerk = peaks(orientations[held[2] :], daemon.period)
        assert acceleration <= 1.001 * narrow.get("acceleration", 17.0)
        assert jerk <= 1.001 * narrow.get("jerk", 8500.0)
    sent.assert_limits_kept()


@pytest.mark.parametrize("has_positions", [False, True])
@pytest.mark.parametrize("ends", [None, (1.2, 0.8), (1.2007, 0.8007)])
def test_motions_join_at_their_end_velocities(daemon, robot, ends, has_positions):
    sent = Sent(daemon)
    angles, speeds = (0.0, 0.5, 1.0, 1.6), (None, 0.5, 0.8, None)
    times = (None, None, None) if ends is None else ([0, ends[0]], [0, ends[1]], [0, ends[0]])
    handles = []
    for place in range(3):
        # However busy the machine is, the others are there before the first one begins.
        fields = {"queue": True} if place else {"start_time": time.time() + 5.0}
        for name, speed in zip(("start_velocity", "end_velocity"), speeds[place:], strict=False):
            if speed is not None:
                fields[name] = [0.0, 0.0, speed]
        if times[place]:
            fields["times"] = times[place]
        if has_positions:
            fields["positions"] = [[0.1 * k, 0.0, 0.0] for k in (place, place + 1)]
        keys = [key(0, 0, angle) for angle in angles[place : place + 2]]
        handles.append(robot.move(keys, **fields))
    assert [handle.wait(20.0).outcome for handle in handles] == [pb.OUTCOME_DONE] * 3
    orientations, _ = sent.poses()
    turned = rotation.log(orientations)[:, 2]
    for angle, speed in zip(angles[1:3], speeds[1:3], strict=True):
        at = int(np.argmin(np.abs(turned - angle)))
        passed = (turned[at + 1] - turned[at - 1]) / (2.0 * daemon.period)
        # Over two cycles the acceleration changes it a little.
        assert passed == pytest.approx(speed, abs=17.0 * daemon.period)
    assert turned.max() <= 1.6 + 1e-9
    sent.assert_limits_kept()


def test_a_motion_to_be_blended_says_why_it_is_not(robot):
    robot.move([key(0, 0, 0), key(0, 0, 0.5)], limits={"velocity": 0.3})
    still = robot.move(
        [key(0, 0, 0.5)] * 2,
        positions=PLACES[:2],
        queue=True,
        approach=True,
        blend_tolerance=0.1,
    )
    assert still.wait(20.0).outcome == pb.OUTCOME_DONE
    (note,) = still.plan.certificate.notes
    assert note.startswith(f"{NOT_BLENDED}: the orientation changes on one side")
    late = robot.move([key(0, 0, 0)], queue=True, blend_tolerance=0.1)
    assert late.wait(20.0).outcome == pb.OUTCOME_DONE
    assert list(late.plan.certificate.notes) == [f"{NOT_BLENDED}: the device was at rest"]
