"""A device of the daemon on the loopback driver, asked faster than its own thread looks."""

import functools
import os
import signal

import numpy as np
import pytest
from direct_planners import DirectPlanners, plan, run, state_at
from harness import until

from orientd import rotation
from orientd.config import DeviceSettings
from orientd.daemon.device import Device, EventKind
from orientd.errors import GOING_DOWN, DaemonError, Fault
from orientd.model.request import Keyframe, MotionRequest
from orientd.stream.records import ServoState

pytestmark = pytest.mark.world


@pytest.fixture
def events():
    return []


@pytest.fixture
def limits():
    return {"velocity": 1.0, "acceleration": 0.4}


@pytest.fixture
def device(events, limits, monkeypatch):
    """A device that holds, and takes seconds to stop; its thread looks a few times a second."""
    monkeypatch.setattr("orientd.daemon.device.device.TICK", 0.5)
    settings = DeviceSettings(
        name="arm",
        driver="loopback",
        priority=0,
        heartbeat_timeout=3.0,
        limits=limits,
    )
    planners = DirectPlanners([settings])
    device = Device(settings, planners=planners, on_event=events.append)
    device.launch()
    try:
        assert device.wait_ready(20.0), device.failure
        until_holding(device)
        yield device
    finally:
        device.shutdown()


def until_holding(device):
    until(lambda: device.snapshot().state is ServoState.HOLDING, "holding")


def turn_from_here(device, angle):
    start = device.commanded().q
    away = rotation.multiply(start, rotation.exp(angle * np.array([0.0, 0.6, 0.8])))
    return MotionRequest(keyframes=[Keyframe(start), Keyframe(away)])


def test_a_device_shows_what_a_command_has_changed_once_that_is_done(device):
    for _ in range(20):
        device.disable()
        assert device.snapshot().state is ServoState.IDLE
        device.enable()
        assert device.snapshot().state is ServoState.HOLDING


def test_a_motion_that_has_ended_is_at_its_end(device):
    motion = plan(device, turn_from_here(device, 0.3))
    run(device, motion)
    until(lambda: device.snapshot().path_time > 0.1, "the motion under way")
    until_holding(device)
    assert device.snapshot().path_time == motion.facts.duration


@pytest.mark.parametrize("limits", [{"velocity": 0.1, "acceleration": 0.02}])
def test_a_device_that_is_slow_to_stop_runs_for_longer_than_is_usually_read_ahead(device):
    motion = plan(device, turn_from_here(device, 3.0))
    assert motion.facts.duration > motion.facts.stop_time > 16.0
    run(device, motion)
    # By then the ring holds less than the stop takes, unless more is read ahead.
    until(lambda: device.snapshot().path_time > 2.0, "the motion under way")
    assert device.snapshot().state is ServoState.STREAMING
    device.stop()
    until_holding(device)
    assert device.snapshot().fault is Fault.NONE


def test_a_plan_begins_where_a_stop_just_ended(device, events):
    first = run(device, plan(device, turn_from_here(device, 1.0)))
    until(lambda: device.snapshot().path_time > 0.1, "the motion under way")
    device.stop()
    until_holding(device)

    held = device.commanded()
    motion = plan(device, turn_from_here(device, 0.05))
    assert np.abs(state_at(motion, 0).q - held.q).max() < 1e-15
    second = run(device, motion)

    told = [(event.kind, event.motion_number) for event in events if event.motion_number]
    assert told == [
        (EventKind.MOTION_STARTED, first.number),
        (EventKind.MOTION_STOPPED, first.number),
        (EventKind.MOTION_STARTED, second.number),
    ]
    until_holding(device)


def test_a_fault_is_told_as_such_only_when_the_device_has_come_to_rest(device, monkeypatch):
    def broken():
        raise OSError("nothing to see")

    run(device, plan(device, turn_from_here(device, 2.5)))
    until(lambda: device.snapshot().path_time > 0.8, "the motion under way")
    monkeypatch.setattr(device, "_tick", broken)

    def seen(claim):
        snapshot = device.snapshot()
        return snapshot.fault is Fault.INTERNAL and claim(snapshot.state) and snapshot

    braking = until(lambda: seen(lambda state: state is ServoState.STOPPING), "braking, in a fault")
    assert braking.cycle.state is ServoState.STOPPING
    # It was told to; it did not wait for the heartbeat to be late.
    assert braking.cycle.fault == Fault.NONE
    resting = until(lambda: seen(lambda state: state is not ServoState.STOPPING), "rest")
    assert resting.state is ServoState.FAULT
    assert "nothing to see" in resting.fault_text


def test_a_device_that_nobody_watches_begins_no_motion_until_it_is_reset(device, monkeypatch):
    def broken():
        raise OSError("nothing to see")

    motion = plan(device, turn_from_here(device, 0.3))
    with monkeypatch.context() as while_broken:
        while_broken.setattr(device, "_tick", broken)
        until(lambda: device.failure, "the failure")
    with pytest.raises(DaemonError, match=r"nothing to see; reset it first$"):
        run(device, motion)
    device.reset()
    run(device, plan(device, turn_from_here(device, 0.1)))
    until_holding(device)
    assert device.snapshot().fault is Fault.NONE


def test_a_device_that_has_ended_says_why_and_does_not_begin_again(device):
    planning = functools.partial(plan, device, turn_from_here(device, 1.0))
    device.shutdown()
    for act in (planning, device.enable, device.reset):
        with pytest.raises(DaemonError, match=f"^{GOING_DOWN}$"):
            act()
    assert device.snapshot().servo_pid is None


def test_a_servo_that_is_gone_before_it_answers_is_told_as_gone(device, events, monkeypatch):
    def asking():
        os.kill(device.snapshot().servo_pid, signal.SIGKILL)
        until(lambda: device.snapshot().servo_pid is None, "the end of the process")
        raise DaemonError("the servo process has ended, it cannot splice")

    monkeypatch.setattr(device, "_tick", asking)
    until(lambda: any(event.kind is EventKind.SERVO_DIED for event in events), "word of the loss")
    assert device.snapshot().fault is Fault.SERVO_DIED
    assert "signal 9" in device.failure
