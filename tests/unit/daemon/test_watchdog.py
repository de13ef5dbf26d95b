"""systemd's watchdog is fed by the cycles of the servos."""

import os
from types import SimpleNamespace

import pytest

from orientd.daemon.systemd import Watchdog, watchdog_seconds


class FakeDevice:
    """A servo process and the number of its newest cycle."""

    def __init__(self):
        self.pid, self.index = 7, 1

    def snapshot(self):
        cycle = None if self.index is None else SimpleNamespace(index=self.index)
        return SimpleNamespace(servo_pid=self.pid, cycle=cycle)


@pytest.fixture
def device():
    return FakeDevice()


@pytest.fixture
def watchdog(device):
    return Watchdog({"arm": device})


def test_a_servo_that_runs_and_does_no_cycle_is_stuck(watchdog, device):
    assert watchdog.stuck() == []
    device.index += 1
    assert watchdog.stuck() == []
    assert watchdog.stuck() == ["arm"]
    device.index += 1
    assert watchdog.stuck() == []


def test_a_servo_that_has_ended_or_has_not_begun_is_not(watchdog, device):
    watchdog.stuck()
    device.pid = None
    assert watchdog.stuck() == watchdog.stuck() == []
    device.pid, device.index = 8, None
    assert watchdog.stuck() == watchdog.stuck() == []


def test_another_servo_at_the_same_cycle_has_made_progress(watchdog, device):
    watchdog.stuck()
    device.pid = 8
    assert watchdog.stuck() == []


def test_the_watchdog_of_another_process_is_not_ours(monkeypatch):
    monkeypatch.setenv("WATCHDOG_USEC", "3000000")
    monkeypatch.setenv("WATCHDOG_PID", str(os.getpid()))
    assert watchdog_seconds() == 3.0
    monkeypatch.setenv("WATCHDOG_PID", "1")
    assert watchdog_seconds() is None
    monkeypatch.delenv("WATCHDOG_USEC")
    assert watchdog_seconds() is None
