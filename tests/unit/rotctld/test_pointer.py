"""When a position that a program repeats moves the device again."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from orientd import rotation
from orientd.protocol import control_pb2 as pb
from orientd_rotctld import pointer as pointer_module
from orientd_rotctld.pointer import Pointer
from orientd_rotctld.ranges import Ranges
from orientd_serving.pointing import Direction, direction, orientation


class Device:
    """A device that is where its last motion ended, or where it was stopped."""

    def __init__(self):
        self.moves = 0
        self.place(Direction(0.0, 0.0))

    def place(self, direction):
        w, x, y, z = orientation(direction)
        self._q = pb.Quaternion(w=w, x=x, y=y, z=z)

    def report(self):
        return pb.DeviceReport(cycle=pb.Cycle(q=self._q))

    def move(self, poses, **_):
        self.moves += 1
        (pose,) = poses
        self._q = pb.Quaternion(w=pose.w, x=pose.x, y=pose.y, z=pose.z)
        return SimpleNamespace(is_done=True)

    def stop(self):
        pass


@pytest.mark.parametrize("short", [0.001, 0.03, 5.0])
def test_a_position_is_reached_again_after_a_stop_shortly_before_it(short):
    device = Device()
    passes = SimpleNamespace(takes=lambda *_: False, leave=lambda: None)
    pointer = Pointer(device, passes, Ranges((-180.0, 540.0), (-90.0, 90.0)))
    pointer.go(Direction(40.0, 20.0))
    pointer.go(Direction(40.0, 20.0))
    assert device.moves == 1
    pointer.stop()
    device.place(Direction(40.0 - short, 20.0))
    pointer.go(Direction(40.0, 20.0))
    assert device.moves == 2
    pointer.go(Direction(40.0, 20.0))
    assert device.moves == 2


@pytest.mark.parametrize(
    ("ranges", "path", "end"),
    [
        (Ranges((-180.0, 540.0), (0.0, 90.0)), [(100.0, 14.0 - 2.0 * k) for k in range(8)], 1),
        (Ranges((0.0, 200.0), (0.0, 90.0)), [(186.0 + 2.0 * k, 30.0) for k in range(8)], 0),
    ],
)
def test_a_predicted_path_ends_at_the_end_of_a_range(monkeypatch, ranges, path, end):
    """A program sends positions up to the end, and the target goes on."""
    device = Device()
    sent = []
    device.track = lambda: SimpleNamespace(chunk=lambda poses, **_: sent.extend(poses))
    clock = SimpleNamespace(now=100.0)
    clock.monotonic = lambda: clock.now
    monkeypatch.setattr(pointer_module, "time", clock)
    passes = SimpleNamespace(takes=lambda *_: False, leave=lambda: None)
    pointer = Pointer(device, passes, ranges)
    for azimuth, elevation in path:
        device.place(Direction(azimuth, elevation))
        pointer.go(Direction(azimuth, elevation))
        clock.now += 1.0
    assert len(sent) > 100
    aims = [direction((one.w, one.x, one.y, one.z)) for one in sent]
    for aim in aims:
        near = ranges.nearest(aim)
        assert (aim.azimuth, aim.elevation) == pytest.approx((near.azimuth, near.elevation))
    reached = [(aim.azimuth, aim.elevation)[end] for aim in aims]
    assert path[-1][end] in [pytest.approx(one) for one in reached]


@pytest.mark.parametrize(
    ("ranges", "end"),
    [
        (Ranges((0.0, 270.0), (0.0, 60.0)), Direction(265.0, 2.0)),
        (Ranges((5.0, 355.0), (10.0, 80.0)), Direction(350.0, 79.0)),
    ],
)
def test_a_move_goes_around_what_is_beyond_the_ranges(ranges, end):
    device, sent = Device(), []
    device.rest = lambda: None
    device.move = lambda poses, **_: sent.extend(poses) or SimpleNamespace(is_done=True)
    passes = SimpleNamespace(takes=lambda *_: False, leave=lambda: None)
    pointer = Pointer(device, passes, ranges=ranges)
    begin = ranges.nearest(Direction(10.0, 20.0))
    device.place(begin)
    pointer.go(end)
    turns = [np.array([one.w, one.x, one.y, one.z]) for one in sent]
    assert rotation.angle(turns[0], orientation(begin)) < 1e-9
    assert rotation.angle(turns[-1], orientation(end)) < 1e-9
    for one, other in itertools.pairwise(turns):
        assert rotation.angle(one, other) < np.radians(15.0)
        assert ranges.has_form(direction(tuple(other.tolist())))


def test_a_moving_device_near_an_edge_stops_before_it_turns_back():
    device, done = Device(), []
    device.rest = lambda: done.append("rest")
    device.move = lambda *_, **__: done.append("move") or SimpleNamespace(is_done=True)
    passes = SimpleNamespace(takes=lambda *_: False, leave=lambda: None)
    ranges = Ranges((0.0, 270.0), (0.0, 60.0))
    pointer = Pointer(device, passes, ranges=ranges)
    for elevation, expected in ((4.0, ["rest", "move"]), (30.0, ["move"])):
        device.place(Direction(100.0, elevation))
        cycle = pb.Cycle(q=device.report().cycle.q, omega_body=pb.Vector3(y=1.0))
        report = pb.DeviceReport(cycle=cycle, limits=pb.Limits(acceleration=10.0))
        device.report = lambda report=report: report
        pointer.go(Direction(150.0, 35.0 + elevation / 10.0))
        assert done == expected
        done.clear()
        del device.report
