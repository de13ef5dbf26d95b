"""A reset starts the servo again, and what the old one was doing has ended."""

import pytest
from fake_device import FakeServo, servo_of

from orientd import config
from orientd.daemon.device import Device, EventKind, servo_limits_of
from orientd.model.limits import Limits
from orientd.protocol import control_pb2 as pb

SETTINGS = config.default_settings().devices["arm"]


class MortalServo(FakeServo):
    """A servo whose process can end, and be started again."""

    def start(self):
        self._forget()
        self.is_alive = True

    def wait_ready(self, _timeout):
        return True


@pytest.fixture
def events():
    return []


@pytest.fixture
def device(events, monkeypatch):
    monkeypatch.setattr("orientd.daemon.device.device.ServoProcess", MortalServo)
    return Device(SETTINGS, planners=None, on_event=events.append)


def test_a_reset_before_the_end_of_the_servo_is_noticed_ends_what_it_did(device, events):
    with device.expecting() as run:
        device.track(run, servo_limits_of(Limits.partial(), 1.0))
    servo_of(device).is_alive = False
    device.reset()
    assert run.ended.result(0) == (pb.OUTCOME_FAULT, "the servo process was ended with status 0")
    assert device.unfinished() == []
    assert [event.kind for event in events].count(EventKind.SERVO_DIED) == 1


def test_the_end_of_a_servo_that_was_noticed_is_reported_once(device, events):
    servo_of(device).is_alive = False
    device._tick()
    device.reset()
    assert [event.kind for event in events].count(EventKind.SERVO_DIED) == 1
