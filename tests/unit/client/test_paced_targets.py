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


def test_without_a_spacing_every_target_is_sent(monkeypatch):
    monkeypatch.setattr(tracking, "_SPACING", 0.0)
    assert len(sent(*map(target, range(COUNT)))) == COUNT


def test_targets_with_a_time_and_other_messages_are_all_sent_in_order():
    begin = pb.TrackRequest(start=pb.TrackStart(device="arm"))
    chunk = pb.TrackRequest(chunk=pb.TrackChunk(times_ns=[1]))
    stamped = [target(number, time_ns=1 + number) for number in range(100)]
    assert sent(begin, *stamped, chunk, *stamped) == [begin, *stamped, chunk, *stamped]


def test_a_target_that_another_message_follows_is_sent_before_it():
    chunk = pb.TrackRequest(chunk=pb.TrackChunk(times_ns=[1]))
    found = sent(target(1), target(2), target(3), chunk, target(4))
    assert found == [target(1), target(3), chunk, target(4)]


def test_a_pose_of_a_chunk_with_an_impossible_velocity_is_skipped():
    identity = quaternion((1.0, 0.0, 0.0, 0.0))
    rates = np.array([[0.1, 0.0, 0.0], [1e150, 0.0, 0.0], [1001.0, 0.0, 0.0], [0.0, 0.0, -900.0]])
    chunk = pb.TrackChunk(
        times_ns=[10**6 * (k + 1) for k in range(4)],
        orientations=[identity.w, identity.x, identity.y, identity.z] * 4,
        angular_velocities=rates.ravel(),
        velocity_frame=pb.FRAME_BODY,
    )
    poses = poses_from_message(chunk, 0)
    assert poses.skipped == 2
    assert [sample.omega for sample in poses.samples] == [tuple(rates[0]), tuple(rates[3])]
