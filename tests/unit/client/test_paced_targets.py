"""A client that aims faster than targets can be taken sends the newest ones."""

import queue

import numpy as np
import pytest

from orientd.client import tracking
from orientd.client.tracking import paced
from orientd.protocol import control_pb2 as pb
from orientd.protocol import quaternion
from orientd.protocol.targets import poses_from_message

COUNT = 1000


@pytest.fixture(autouse=True)
def _longest_spacing(monkeypatch):
    monkeypatch.setattr(tracking, "_SPACING", 3600.0)


def sent(*messages, skip=lambda: None):
    outgoing = queue.SimpleQueue()
    for message in (*messages, None):
        outgoing.put(message)
    return list(paced(outgoing, skip))


def target(number, time_ns=0):
    return pb.TrackRequest(target=pb.TrackTarget(time_ns=time_ns, time_to_live=number))


def test_of_targets_for_their_arrival_the_newest_is_sent():
    skipped = []
    messages = sent(*map(target, range(COUNT)), skip=lambda: skipped.append(1))
    assert [one.target.time_to_live for one in messages] == [0, COUNT - 1]
    assert len(skipped) == COUNT - 2


def test_targets_with_a_time_and_other_messages_are_all_sent_in_order():
    begin = pb.TrackRequest(start=pb.TrackStart(device="arm"))
    chunk = pb.TrackRequest(chunk=pb.TrackChunk(times_ns=[1]))
    stamped = [target(number, time_ns=1 + number) for number in range(100)]
    assert sent(begin, *stamped, chunk, *stamped) == [begin, *stamped, chunk, *stamped]


def poses_of(times_ns, orientations, frame=pb.FRAME_BODY, rates=()):
    """Return the poses of a chunk."""
    rows = [quaternion(q) for q in orientations]
    message = pb.TrackChunk(
        times_ns=times_ns,
        orientations=[number for q in rows for number in (q.w, q.x, q.y, q.z)],
        angular_velocities=np.ravel(rates),
        velocity_frame=frame,
    )
    return poses_from_message(message, 0)


UPRIGHT, QUARTER = (1.0, 0.0, 0.0, 0.0), (0.5**0.5, 0.0, 0.0, 0.5**0.5)


def test_a_pose_of_a_chunk_with_an_impossible_velocity_is_skipped():
    rates = np.array([[0.1, 0.0, 0.0], [1e150, 0.0, 0.0], [1001.0, 0.0, 0.0], [0.0, 0.0, -900.0]])
    poses = poses_of([10**6 * (k + 1) for k in range(4)], [UPRIGHT] * 4, rates=rates)
    assert poses.skipped == 2
    assert [sample.omega for sample in poses.samples] == [tuple(rates[0]), tuple(rates[3])]


def test_of_poses_of_a_chunk_for_one_instant_the_last_one_counts():
    poses = poses_of([1_000_000, 1_400_000, 2_000_000], [UPRIGHT, QUARTER, UPRIGHT])
    assert poses.skipped == 1
    assert [sample.time_ns for sample in poses.samples] == [1_400_000, 2_000_000]
    assert [sample.q for sample in poses.samples] == [QUARTER, UPRIGHT]


def test_velocities_of_a_chunk_may_be_given_in_the_world():
    rates = [[0.3, 0.0, 0.1], [0.0, 0.2, 0.0]]
    poses = poses_of([10**6, 2 * 10**6], [QUARTER] * 2, pb.FRAME_WORLD, rates)
    in_body = [sample.omega for sample in poses.samples]
    np.testing.assert_allclose(in_body, [[0.0, -0.3, 0.1], [0.2, 0.0, 0.0]], atol=1e-15)
