"""When a position that a program repeats moves the device again."""

from types import SimpleNamespace

import pytest

from orientd.protocol import control_pb2 as pb
from orientd_rotctld.pointer import Pointer
from orientd_serving.pointing import Direction, orientation


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
    pointer = Pointer(device, passes, north=0.0, tips=False)
    pointer.go(Direction(40.0, 20.0))
    pointer.go(Direction(40.0, 20.0))
    assert device.moves == 1
    pointer.stop()
    device.place(Direction(40.0 - short, 20.0))
    pointer.go(Direction(40.0, 20.0))
    assert device.moves == 2
    pointer.go(Direction(40.0, 20.0))
    assert device.moves == 2
