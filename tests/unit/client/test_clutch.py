"""A hand moves the device relative to where it is; letting go and engaging again moves nothing."""

import math
import threading
from types import SimpleNamespace

import numpy as np
import pytest

import orientd
from orientd.client.clutch import Anchor, Clutch
from orientd.driver import ZERO
from orientd.errors import RequestError
from orientd.floats import difference, exp, multiply, norm, plus
from orientd.protocol import control_pb2 as pb
from orientd.protocol import quaternion, vector

TOOL = exp((0.3, -0.2, 0.5))
PLACE = (0.4, 0.1, 0.3)


class Targets:
    """A session of which only the targets are kept, with a device that rests."""

    def __init__(self, start=(TOOL, PLACE)):
        self.aimed = []
        self.anchor = Anchor(reported(*start))

    def aim(self, q, **options):
        self.aimed.append(((q.w, q.x, q.y, q.z), options))


def reported(q, position, omega=ZERO, time=0.0):
    return pb.TrackResponse(
        q=quaternion(q),
        position=vector(position),
        omega_body=vector(omega),
        time_ns=round(time * 1e9),
    )


def engaged(scale=1.0, frame="world", targets=None):
    targets = targets or Targets()
    return targets, Clutch(targets, targets.anchor, scale=scale, frame=frame, time_to_live=0.2)


def hand(q):
    w, x, y, z = q
    return orientd.Quaternion(w=w, x=x, y=y, z=z)


def apart(p, q):
    return norm(difference(p, q))


HAND = exp((1.0, 2.0, -0.5))


def test_the_tool_turns_as_the_hand_does_about_the_axes_of_the_world():
    targets, clutch = engaged()
    turn = exp((0.0, 0.0, 0.4))
    clutch.move(hand(HAND))
    clutch.move(hand(multiply(turn, HAND)))
    assert apart(targets.aimed[-1][0], multiply(turn, TOOL)) < 1e-12
    assert targets.aimed[-1][1]["position"] is None


def test_the_tool_turns_as_the_hand_does_about_the_axes_of_its_body():
    targets, clutch = engaged(frame="body")
    turn = exp((0.0, 0.3, 0.4))
    clutch.move(hand(HAND), position=(0.0, 0.0, 0.0))
    clutch.move(hand(multiply(HAND, turn)), position=(0.0, 0.0, 0.0))
    assert apart(targets.aimed[-1][0], multiply(TOOL, turn)) < 1e-12


def test_turn_and_way_are_scaled_and_whole_turns_count():
    targets, clutch = engaged(scale=0.25)
    for k in range(101):
        turn = exp((0.0, 0.0, 0.08 * k))
        clutch.move(hand(multiply(turn, HAND)), position=(0.01 * k, 0.0, 0.0))
    q, options = targets.aimed[-1]
    assert apart(q, multiply(exp((0.0, 0.0, 2.0)), TOOL)) < 1e-9
    assert options["position"] == pytest.approx((0.65, 0.1, 0.3))


def test_letting_go_and_engaging_elsewhere_moves_nothing():
    targets, clutch = engaged()
    clutch.move(hand(HAND))
    clutch.move(hand(multiply(exp((0.2, 0.0, 0.0)), HAND)))
    clutch.release()
    rest = targets.aimed[-1]
    assert rest[1]["angular_velocity"] == ZERO
    assert clutch.holds
    _, again = engaged(targets=targets)
    again.move(hand(exp((-2.0, 0.0, 1.0))))
    assert apart(targets.aimed[-1][0], rest[0]) < 1e-12


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    """Stand still, or a stall of this process would be a gap between two poses of the hand."""
    clock = SimpleNamespace(now=100.0, monotonic=lambda: clock.now)
    monkeypatch.setattr("orientd.client.clutch.time", clock)
    return clock


def test_after_a_gap_the_hand_engages_anew_where_the_device_has_come_to_rest(clock):
    targets, clutch = engaged()
    clutch.move(hand(HAND))
    clock.now += 0.3
    assert not clutch.holds
    moved = multiply(exp((0.5, 0.0, 0.0)), HAND)
    targets.anchor.note(reported(TOOL, PLACE, (0.1, 0.0, 0.0)))
    clutch.move(hand(moved))
    assert len(targets.aimed) == 1
    rest = multiply(TOOL, exp((0.1, 0.0, 0.0)))
    targets.anchor.note(reported(rest, PLACE))
    clutch.move(hand(moved))
    assert len(targets.aimed) == 2
    assert apart(targets.aimed[-1][0], rest) < 1e-12


def test_engaging_brakes_a_device_that_follows_something_else_and_waits_for_its_rest(clock):
    targets = Targets()
    targets.anchor.lose()
    targets.anchor.note(reported(TOOL, PLACE, (1.0, 0.0, 0.0)))
    _, clutch = engaged(targets=targets)
    for _ in range(3):
        clutch.move(hand(HAND))
    ((_, options),) = targets.aimed
    assert options["time_to_live"] < 0.1
    clock.now += 0.1
    targets.anchor.note(reported(TOOL, PLACE))
    clutch.move(hand(exp((2.0, 1.0, 0.0))))
    assert apart(targets.aimed[-1][0], TOOL) < 1e-12


def test_a_target_from_elsewhere_ends_what_a_clutch_held(clock):
    targets, clutch = engaged()
    clutch.move(hand(HAND))
    clutch.release()
    targets.anchor.lose()
    assert not clutch.holds
    there = multiply(TOOL, exp((0.0, 1.0, 0.0)))
    clock.now += 1.0
    targets.anchor.note(reported(there, PLACE))
    _, again = engaged(targets=targets)
    again.move(hand(HAND))
    assert apart(targets.aimed[-1][0], there) < 1e-12


def test_a_position_is_any_three_numbers():
    targets, clutch = engaged()
    clutch.move(hand(HAND), position=np.zeros(3))
    clutch.move(hand(HAND), position=np.array([0.0, 0.1, 0.0]))
    assert targets.aimed[-1][1]["position"] == pytest.approx((PLACE[0], PLACE[1] + 0.1, PLACE[2]))
    with pytest.raises(RequestError, match="three numbers"):
        clutch.move(hand(HAND), position=[0.0, 0.1])


def test_a_hand_that_is_no_pose_is_left_out():
    targets, clutch = engaged()
    clutch.move(hand(HAND))
    clutch.move(orientd.Quaternion(w=math.nan, x=0.0, y=0.0, z=0.0))
    clutch.move(hand(HAND), position=(math.inf, 0.0, 0.0))
    clutch.move(orientd.Quaternion(w=0.0, x=0.0, y=0.0, z=0.0))
    assert len(targets.aimed) == 1
    assert clutch.skipped == 3


def test_a_position_that_only_some_poses_of_the_hand_have_is_refused():
    _, clutch = engaged()
    clutch.move(hand(HAND))
    with pytest.raises(RequestError, match=r"position: expected in every call or in none"):
        clutch.move(hand(HAND), position=(1.0, 0.0, 0.0))


def test_nobody_who_did_not_move_is_released():
    targets, clutch = engaged()
    clutch.release()
    assert targets.aimed == []
    assert plus(ZERO, clutch.position, 1.0) == PLACE


@pytest.mark.parametrize("options", [{"scale": 0.0}, {"scale": math.nan}, {"frame": "hand"}])
def test_settings_out_of_range_are_refused(options):
    with pytest.raises(RequestError):
        engaged(**options)


def test_a_target_behind_a_report_of_rest_counts():
    anchor, threads = Anchor(reported(TOOL, PLACE)), []

    class Past(float):
        """A time in the past; another thread sends a target right after the look at it."""

        def __gt__(self, now):
            threads.append(threading.Thread(target=anchor.lose))
            threads[0].start()
            threads[0].join(0.3)
            return False

    anchor._until = Past(-math.inf)
    anchor.note(reported(TOOL, PLACE))
    threads[0].join()
    assert anchor.is_moving


def test_a_device_that_turns_back_is_not_at_rest():
    anchor = Anchor(reported(TOOL, PLACE))
    for time, turns in [(1.0, 1e-4), (1.02, 0.0), (1.04, -1e-4)]:
        anchor.note(reported(TOOL, PLACE, (0.0, 0.0, turns), time))
        assert not anchor.rests
    # Reports that come late, all at once, are no longer ago than they say.
    for time, rests in [(1.06, False), (1.08, False), (1.1, True)]:
        anchor.note(reported(TOOL, PLACE, time=time))
        assert anchor.rests is rests
