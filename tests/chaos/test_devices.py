"""Emulated devices killed, stopped and resumed at random moments of motions; `make chaos`."""

import signal
import time

import pytest
from device_stage import DeviceStage
from harness import until
from tally import Tally, rounds_of

from orientd.errors import Fault
from orientd.protocol import control_pb2 as pb
from orientd.protocol.reports import word

pytestmark = [pytest.mark.chaos, pytest.mark.timeout(7200)]

FAULTS = {Fault.LINK_LOST, Fault.FEEDBACK_STALE, Fault.DEVICE_FAULT, Fault.SERVO_DIED}


def kill(stage):
    """Kill the emulator; return what starts another."""
    stage.emulator.kill()
    stage.emulator.communicate()
    return stage.start_emulator


def stop(stage):
    """Stop the emulator; return a function that continues it."""
    stage.emulator.send_signal(signal.SIGSTOP)
    return lambda: stage.emulator.send_signal(signal.SIGCONT)


def begin(stage, number, generator):
    """Begin a motion, and pause it or slow it down in two rounds of three."""
    handle = stage.turn()
    time.sleep(generator.uniform(0.0, 1.5))
    stage.check_well()
    if number % 3 == 1:
        stage.robot.pause(stage.device)
    elif number % 3 == 2:
        stage.robot.set_speed(0.5, stage.device)
    time.sleep(generator.uniform(0.0, 0.2))
    stage.check_well()
    # A busy machine may have slept until the motion was over.
    return begin(stage, number, generator) if handle.is_done else handle


@pytest.mark.parametrize("harm", [kill, stop])
@pytest.mark.parametrize("name", ["ur", "dynamixel"])
def test_a_device_is_lost(tmp_path, name, harm):
    pytest.importorskip("rtde_control" if name == "ur" else "dynamixel_sdk")
    signals = {"kill": "SIGKILL", "stop": "SIGSTOP, SIGCONT"}[harm.__name__]
    tally = Tally(
        f"`orientd sim {name}`: {signals}", 60 + (name != "ur"),
        "fault in time and with its reason, setpoints within limits, status, reset, a motion",
    )  # fmt: skip

    def one(number, generator):
        with stage.round():
            handle = stage.unless_starved(lambda: begin(stage, number, generator))
            mend = harm(stage)
            try:
                until(lambda: stage.state().state == pb.STATE_FAULT, "the fault", 4.0)
                until(lambda: stage.state().fault_text, "the fault in words", 1.0)
                report = stage.state()
                assert report.fault in FAULTS, report.fault
                stage.tally.met[word(report, "fault")] += 1
                assert handle.wait(5.0, check=False).outcome == pb.OUTCOME_FAULT
            finally:
                mend()
            stage.recover()

    with DeviceStage(tmp_path, tally, name) as stage:
        rounds_of(f"sim-{name}-{harm.__name__}", tally, one)
