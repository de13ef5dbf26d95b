"""The link between the daemon and a real servo process with the loopback driver."""

import dataclasses
import os
import signal
import threading
import time

import pytest
from harness import until

from orientd.config import DeviceSettings
from orientd.daemon.device import Device, EventKind
from orientd.daemon.device.servo_process import ServoProcess
from orientd.errors import DaemonError, Fault, StateError
from orientd.stream.records import Command, ServoLimits, ServoState


@pytest.fixture
def gate(tmp_path):
    """Return a path at which a pipe without a writer blocks the servo's cycle."""
    return tmp_path / "gate"


@pytest.fixture
def settings(gate):
    return DeviceSettings(
        name="arm", driver="loopback", priority=0, heartbeat_timeout=10.0, stall_timeout=10.0,
        options={"fault_file": str(gate)},
    )  # fmt: skip


@pytest.fixture
def servo(settings):
    servo = ServoProcess(settings, read_ahead=4096, tell=lambda *_: None)
    servo.start()
    yield servo
    servo.end()


def block(servo, gate):
    """Let the servo's cycle wait at the pipe *gate*."""
    os.mkfifo(gate)
    head = -1
    while head != (head := servo.next_cycle):
        time.sleep(0.1)


def await_cycles(servo):
    ends = time.monotonic() + 30.0
    while not servo.next_cycle and time.monotonic() < ends:
        time.sleep(0.01)


def test_a_stop_does_not_wait_for_a_slow_command_and_others_are_refused(servo):
    await_cycles(servo)
    refused = []

    def enable():
        try:
            servo.ask(Command.ENABLE)
        except DaemonError as error:
            refused.append(str(error))

    os.kill(servo.pid, signal.SIGSTOP)
    enabling = threading.Thread(target=enable)
    enabling.start()
    try:
        time.sleep(0.1)
        with pytest.raises(StateError, match=r"enable is under way, for \d.\d s so far"):
            servo.ask(Command.RESET)
        with pytest.raises(DaemonError, match="it cannot stop"):
            servo.ask(Command.STOP)
        enabling.join()
    finally:
        os.kill(servo.pid, signal.SIGCONT)
    assert "is stopped (SIGSTOP or a debugger), it cannot enable" in refused[0]
    with pytest.raises(StateError, match="not possible while idle"):
        servo.ask(Command.SPEED, speed=1.0)


def test_a_stop_of_what_moves_waits_for_its_answer_behind_a_slow_command(servo):
    await_cycles(servo)
    servo.ask(Command.ENABLE)
    limits = ServoLimits(1.0, 10.0, 100.0, 1.0, 10.0, 1.0)
    servo.ask(Command.TRACK, motion=1, servo_limits=limits)
    until(lambda: servo.newest().state is ServoState.TRACKING, "tracking")
    os.kill(servo.pid, signal.SIGSTOP)
    refused = []

    def disable():
        try:
            servo.ask(Command.DISABLE)
        except (DaemonError, StateError) as error:
            # The servo may run again before this thread has looked at it.
            refused.append(error)

    disabling = threading.Thread(target=disable)
    disabling.start()
    try:
        until(lambda: servo._slow is not None, "a slow command under way")
        with pytest.raises(DaemonError, match="it cannot stop"):
            servo.ask(Command.STOP)
    finally:
        os.kill(servo.pid, signal.SIGCONT)
        disabling.join()
    assert refused


def test_a_stop_without_an_answer_does_not_give_up_the_slow_command_before_it(servo, gate):
    await_cycles(servo)
    block(servo, gate)
    answered = []
    resetting = threading.Thread(target=lambda: answered.append(servo.ask(Command.RESET)))
    resetting.start()
    until(lambda: servo._slow is not None, "the reset")
    with pytest.raises(DaemonError, match="reset is under way"):
        servo.ask(Command.STOP)
    with gate.open("w"):
        gate.unlink()
    resetting.join(20.0)
    assert len(answered) == 1
    servo.ask(Command.ENABLE)


def test_a_fault_whose_words_have_not_arrived_is_named_by_its_code(servo, monkeypatch):
    await_cycles(servo)
    fault = dataclasses.replace(
        servo.newest(), state=ServoState.FAULT, fault=int(Fault.LIMIT_GUARD)
    )
    monkeypatch.setattr(servo, "newest", lambda: fault)
    with pytest.raises(StateError, match="is fault, not holding: limit_guard; reset it first"):
        servo.commanded()


def test_a_fault_that_a_reset_has_cleared_is_none_afterwards(servo, gate):
    await_cycles(servo)
    gate.write_text("device_fault")
    until(lambda: servo.newest().state is ServoState.FAULT, "the fault")
    gate.unlink()
    servo.ask(Command.RESET)
    servo.read_notes()
    assert (servo.fault, servo.fault_text) == (Fault.NONE, "")


def test_a_reset_of_a_device_that_holds_clears_a_fault_that_only_the_daemon_knows(servo):
    await_cycles(servo)
    servo.ask(Command.ENABLE)
    with pytest.raises(StateError, match="reset is not possible while holding"):
        servo.leave_fault()
    servo.fault, servo.fault_text = Fault.DEVICE_FAULT, "the servo did not answer"
    servo.leave_fault()
    assert (servo.fault, servo.fault_text) == (Fault.NONE, "")
    assert servo.newest().state is ServoState.HOLDING


@pytest.mark.parametrize(
    ("command", "state"),
    [(Command.ENABLE, ServoState.HOLDING), (Command.DISABLE, ServoState.IDLE)],
)
def test_a_command_of_a_client_while_a_device_starts_is_no_fault(
    servo, gate, monkeypatch, command, state
):
    await_cycles(servo)
    block(servo, gate)
    client = threading.Thread(target=servo.ask, args=(command,))
    client.start()
    until(lambda: servo._slow is not None, "the command of the client")
    asked, refused, told = servo.ask, threading.Event(), []

    def ask(command):
        try:
            asked(command)
        finally:
            refused.set()

    monkeypatch.setattr(servo, "ask", ask)
    monkeypatch.setattr(servo, "_tell", lambda kind, _text: told.append(kind))
    servo.read_notes()  # it is ready, and the daemon enables it too
    assert refused.wait(30.0)
    with gate.open("w"):
        gate.unlink()
    assert servo.wait_ready(30.0)
    client.join()
    assert servo.newest().state is state
    assert (servo.fault, told) == (Fault.NONE, [EventKind.READY])


def test_a_device_that_moves_before_the_daemon_has_enabled_it_is_in_no_fault(servo):
    await_cycles(servo)
    servo.ask(Command.ENABLE)
    servo.ask(Command.TRACK, motion=1, servo_limits=ServoLimits(1.0, 10.0, 100.0, 1.0, 10.0, 1.0))
    until(lambda: servo.newest().state is ServoState.TRACKING, "tracking")
    servo.read_notes()
    assert servo.wait_ready(30.0)
    assert (servo.fault, servo.fault_text) == (Fault.NONE, "")


def test_a_device_that_is_enabled_after_all_is_in_no_fault(settings, gate):
    gate.write_text("feedback_stale")
    device = Device(settings, planners=None, on_event=lambda _: None)
    device.launch()
    try:
        assert device.wait_ready(60.0)
        assert device.snapshot().fault_text == "enable failed: injected fault: feedback_stale"
        gate.unlink()
        device.enable()
        now = device.snapshot()
    finally:
        device.shutdown()
        device.workers.close()
    assert (now.state, now.fault, now.fault_text) == (ServoState.HOLDING, Fault.NONE, "")


def test_the_end_of_a_daemon_does_not_wait_for_a_reset_that_hangs(settings, gate):
    device = Device(settings, planners=None, on_event=lambda _: None)
    device.launch()
    assert device.wait_ready(60.0)
    os.mkfifo(gate)
    resetting = device.workers.commands.submit(device.reset)
    until(lambda: device._servo._slow is not None, "the reset")
    ending = device.workers.stops.submit(device.shutdown)
    with pytest.raises(DaemonError, match="going down"):
        resetting.result(20.0)
    with gate.open("w"):
        gate.unlink()
    ending.result(20.0)
    device.workers.close()
