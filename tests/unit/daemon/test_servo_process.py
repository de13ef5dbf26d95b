"""What is between the daemon and a servo process: a real one, with the loopback driver."""

import time

import pytest

from orientd.config import DeviceSettings
from orientd.daemon.device.servo_process import ServoProcess
from orientd.errors import StateError
from orientd.stream import Command


@pytest.fixture
def servo():
    settings = DeviceSettings(name="arm", driver="loopback", priority=0, heartbeat_timeout=10.0)
    servo = ServoProcess(settings, read_ahead=4096, tell=lambda *_: None)
    servo.start()
    yield servo
    servo.end()


def test_answers_that_nobody_waits_for_are_not_kept(servo):
    ends = time.monotonic() + 30.0
    while not servo.next_cycle and time.monotonic() < ends:
        time.sleep(0.01)
    for _ in range(20):
        servo.brake()
    # Answered behind all of them, though there were more than there is room for.
    with pytest.raises(StateError, match="not possible while idle"):
        servo.ask(Command.SPEED, speed=1.0)
    assert not servo._answers
    assert not servo._awaited
