"""Bad messages of a stream are counted one by one, and told by few events."""

import time
from types import SimpleNamespace

import pytest
from fake_device import FakeDevice, FakeServo

from orientd import config
from orientd.daemon.calls import following
from orientd.daemon.calls.following import SPACING, Following
from orientd.daemon.device import EventKind
from orientd.daemon.device.target_writer import TargetWriter
from orientd.errors import RequestError
from orientd.protocol import control_pb2 as pb
from orientd.servo.tracking.chunks import Smoothed
from orientd.stream.memory import SharedMemory

TARGET = pb.TrackTarget(orientation=pb.Quaternion(w=1.0))


class Device:
    """A device of which only its events and what is handed to its servo are kept."""

    def __init__(self):
        self.events = []
        self.unreachable = ""
        self.targets = SimpleNamespace(count=lambda: None, aim=self._aim, play=self._play)

    def tell(self, kind, text):
        assert kind is EventKind.WARNING
        self.events.append(text)

    def _aim(self, *_):
        if self.unreachable:
            raise RequestError("target", self.unreachable)

    def _play(self, samples, observed_ns):
        curve = Smoothed([])
        return (1, self.unreachable, curve) if self.unreachable else (0, "", curve)


@pytest.fixture
def clock(monkeypatch):
    now = SimpleNamespace(s=100.0)
    times = SimpleNamespace(monotonic=lambda: now.s, monotonic_ns=lambda: round(1e9 * now.s))
    monkeypatch.setattr(following, "time", times)
    return now


def pose(time_ns=0, q=(1.0, 0.0, 0.0, 0.0)):
    return pb.TrackChunk(times_ns=[time_ns], orientations=q)


def test_a_stream_of_bad_targets_is_counted_and_told_once_in_a_while(clock):
    device = Device()
    session = Following(device)
    for _ in range(1000):
        session.take(pb.TrackTarget())
        clock.s += 0.001
    problem = "target.orientation: expected a quaternion of norm 1 within 1e-06, got norm 0"
    problem += "; give a unit quaternion"
    assert device.events == [f"a client's targets: {problem}"]
    clock.s += SPACING
    session.take(pb.TrackTarget())
    more = "(and 999 other problems since the last event)"
    assert device.events[1:] == [f"a client's targets: {problem} {more}"]


def test_a_pose_out_of_reach_is_told(clock):
    device = Device()
    device.unreachable = "the elbow would be stretched"
    session = Following(device)
    session.take_chunk(pose(round(1e9 * clock.s) + 1))
    session.take(TARGET)
    assert device.events == ["a client's targets: the elbow would be stretched; skipped"]


def test_a_chunk_in_unix_time_is_named_for_that(clock):
    device = Device()
    Following(device).take_chunk(pose(time.time_ns()))
    (text,) = device.events
    assert "chunk.times_ns: " in text
    assert text.endswith("is Unix time; give the daemon's monotonic clock, now 100000000000 ns")


@pytest.fixture
def followed():
    """A device whose servo has the rings of a real one."""
    settings = config.default_settings().devices["arm"]
    device = FakeDevice(settings)
    device.servo = FakeServo(settings, read_ahead=4096, tell=lambda *_: None)
    device.targets = TargetWriter(device.servo, axes=None)
    return device


def test_targets_and_chunks_of_earlier_callers_are_not_counted(followed, clock):
    for count in (3, 2):
        session = Following(followed)
        for _ in range(count):
            session.take(TARGET)
            session.take_chunk(pose(round(1e9 * clock.s) + 1))
        report = session.report()
        assert (report.targets, report.chunks.chunks) == (count, count)


def test_a_servo_that_starts_again_is_not_reported_to_callers_of_the_one_before(followed):
    Following(followed).take(TARGET)
    session = Following(followed)
    followed.servo.memory = SharedMemory.create(8192, 256)
    assert session.report() is None
    assert Following(followed).report().targets == 0
