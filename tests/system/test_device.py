"""A device of the daemon on the loopback driver, asked faster than its own thread looks."""

import numpy as np
import pytest
from harness import until

from orientd import rotation
from orientd.config import DeviceSettings
from orientd.daemon.device import Device
from orientd.daemon.device_report import EventKind
from orientd.daemon.manner import Prepared
from orientd.planner import Keyframe, MotionRequest
from orientd.stream import State


@pytest.fixture
def events():
    return []


@pytest.fixture
def device(events, monkeypatch):
    """A device that holds; its thread looks a few times a second."""
    monkeypatch.setattr("orientd.daemon.device.TICK", 0.5)
    settings = DeviceSettings(name="arm", driver="loopback", priority=0, heartbeat_timeout=3.0)
    device = Device(settings, on_event=events.append)
    device.launch()
    try:
        assert device.wait_ready(20.0), device.failure
        until_holding(device)
        yield device
    finally:
        device.shutdown()


def until_holding(device):
    until(lambda: device.snapshot().state is State.HOLDING, "holding")


def turn_from_here(device, angle):
    start = device.commanded().q
    away = rotation.multiply(start, rotation.exp(angle * np.array([0.0, 0.6, 0.8])))
    return MotionRequest(keyframes=[Keyframe(start), Keyframe(away)])


def test_a_plan_begins_where_a_stop_just_ended(device, events):
    first = device.start(Prepared(device.plan(turn_from_here(device, 1.0))))
    until(lambda: device.snapshot().path_time > 0.1, "the motion under way")
    device.stop()
    until_holding(device)

    held = device.commanded()
    motion = device.plan(turn_from_here(device, 0.05))
    assert np.array_equal(motion.state_at(0).q, held.q)
    second = device.start(Prepared(motion))

    told = [(event.kind, event.motion_number) for event in events if event.motion_number]
    assert told == [
        (EventKind.MOTION_STARTED, first),
        (EventKind.MOTION_STOPPED, first),
        (EventKind.MOTION_STARTED, second),
    ]
    until_holding(device)
