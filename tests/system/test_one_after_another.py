"""Motions that follow one another on a real daemon, judged by what its driver was sent."""

import time

import numpy as np
import pytest
from harness import DEVICE, peaks, read_recording

import orientd
from orientd import rotation
from orientd.planner.blending import NOT_BLENDED
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
