"""One round each of some of the faults that `make chaos` tries many times."""

import os
import signal
import time

import grpc
import pytest
from harness import DEVICE, nudge, until
from stage import Stage
from tally import Tally

from orientd.protocol import control_pb2 as pb

STALL_TIMEOUT = 2.0


@pytest.fixture(scope="module")
def stage(tmp_path_factory):
    tally = Tally("one round", 0, "")
    it = Stage(tmp_path_factory.mktemp("stage"), tally)
    # On a busy machine, the test itself may be late to continue the servo process.
    config = it.daemon.config
    table = f"stall_timeout = {STALL_TIMEOUT!r}\n[devices.{DEVICE}.options]\n"
    config.write_text(config.read_text().replace(f"[devices.{DEVICE}.options]\n", table))
    with it:
        it.calls.longest = 30.0  # only a call that hangs fails here
        yield it


def test_a_stopped_servo_process_is_told_of_and_goes_on(stage):
    with stage.round():
        servo = stage.servo
        os.kill(servo, signal.SIGSTOP)
        try:
            with pytest.raises(grpc.RpcError) as refused:
                stage.command("Reset")
        finally:
            os.kill(servo, signal.SIGCONT)
        assert refused.value.code() is grpc.StatusCode.UNAVAILABLE
        assert "is stopped (SIGSTOP or a debugger), it cannot reset" in refused.value.details()
        stage.recover()
        assert stage.servo == servo


def test_what_was_to_follow_on_a_stopped_servo_process_ends_at_rest_in_a_fault(stage):
    with stage.round():
        servo = stage.servo
        stage.begin(nudge(0.5))
        os.kill(servo, signal.SIGSTOP)
        try:
            stage.begin(nudge(-0.4), queue=True)
            until(lambda: stage.device().state == pb.STATE_FAULT, "the fault")
        finally:
            os.kill(servo, signal.SIGCONT)
        time.sleep(1.0)
        stage.rests()
        stage.streams.clear()
        stage.check_truth(faults=("internal",))
        stage.check_sent()
        stage.recover()
        assert stage.servo == servo


def test_motion_goes_on_from_rest_when_a_stopped_servo_process_goes_on(stage):
    with stage.round():
        moving = stage.begin(nudge(0.8))
        hold_up(stage.servo, 0.25)
        *_, last = moving
        assert last.summary.outcome == pb.OUTCOME_DONE
        assert stage.daemon.judged()[1].rests == 1
        stage.settle(faults=("none",))


def test_motion_does_not_go_on_by_itself_when_a_servo_process_was_stopped_for_long(stage):
    with stage.round():
        stage.begin(nudge(0.8))
        hold_up(stage.servo, STALL_TIMEOUT + 0.3)
        stage.await_fault()
        stage.rests()
        assert "the servo process did not run for" in stage.device().fault_text
        stage.settle(faults=("servo_stalled",))


def test_what_a_stopped_servo_process_was_asked_in_vain_it_does_not_do_later(stage):
    with stage.round():
        servo, before = stage.servo, len(stage.daemon.sent())
        os.kill(servo, signal.SIGSTOP)
        try:
            with pytest.raises(grpc.RpcError, match="is stopped"):
                stage.begin(nudge(0.3))
        finally:
            os.kill(servo, signal.SIGCONT)
        time.sleep(0.5)
        sent = stage.daemon.sent()
        assert len(sent) > before
        assert (sent == sent[0]).all()
        stage.settle(faults=("none",))


def hold_up(pid, seconds):
    """Stop a process for a while, in the middle of a motion."""
    time.sleep(0.3)
    os.kill(pid, signal.SIGSTOP)
    time.sleep(seconds)
    os.kill(pid, signal.SIGCONT)
