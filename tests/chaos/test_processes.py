"""Processes killed, stopped and resumed at random moments of motions; run with `make chaos`."""

import json
import os
import signal
import time
import urllib.request
from importlib.util import find_spec

import grpc
import pytest
from command_line import begin, environment
from harness import DEVICE, is_alive, request_of, until
from scenes import under_way
from stage import rehearse
from tally import Tally

from orientd.protocol import control_pb2 as pb
from orientd.recorder.reader import load_recording

pytestmark = [pytest.mark.chaos, pytest.mark.timeout(7200)]


def kill_daemon(stage):
    """Kill the daemon; see the servo brake and end."""
    servo = stage.servo
    os.kill(stage.daemon.process.pid, signal.SIGKILL)
    stage.daemon.process.wait()
    until(lambda: not is_alive(servo), "the servo process ends", 5.0)
    until(lambda: not stage.family(), "all its processes end", 5.0)
    last_words = json.loads(stage.daemon.report.read_text())
    assert last_words["reason"] == "the daemon is gone"
    assert last_words["state"] == "holding"
    stage.tally.met["braked and held"] += 1


def renew(stage):
    """Start the daemon that follows; it knows of no lease and no fault."""
    stage.check_sent()
    stage.daemon.end()
    stage.start()


def test_the_daemon_is_killed(tmp_path):
    tally = Tally("daemon: SIGKILL", 10, "stop on the path within the limits, servo ended, a new "
                  "daemon starts at once, a motion")  # fmt: skip

    def harm(stage, number, generator):
        with under_way(stage, number, generator):
            kill_daemon(stage)
        renew(stage)
        stage.settle(faults=("none",))

    rehearse(tmp_path, "daemon-killed", tally, harm)


def test_the_daemon_is_stopped_and_goes_on(tmp_path):
    tally = Tally("daemon: SIGSTOP 0.1 to 2.5 s, SIGCONT", 11, "limits, no fault except "
                  "heartbeat_lost or path_starved, status, recovery")  # fmt: skip

    def harm(stage, number, generator):
        with under_way(stage, number, generator):
            process = stage.daemon.process
            process.send_signal(signal.SIGSTOP)
            stage.calls.went_on = float("inf")
            time.sleep(generator.choice((0.1, 0.4, 0.8, 1.3, 2.5)))
            stage.calls.went_on = time.monotonic()
            process.send_signal(signal.SIGCONT)
            time.sleep(0.1)
        stage.come_to_rest()
        stage.settle(faults=("none", "heartbeat_lost", "path_starved"))

    rehearse(tmp_path, "daemon-stopped", tally, harm)


def test_the_servo_is_killed(tmp_path):
    tally = Tally("servo: SIGKILL", 12, "limits up to the end, fault servo_died, reset, a "
                  "motion")  # fmt: skip

    def harm(stage, number, generator):
        with under_way(stage, number, generator):
            os.kill(stage.servo, signal.SIGKILL)
            stage.await_fault(1.0)
        stage.settle(faults=("servo_died",))

    rehearse(tmp_path, "servo-killed", tally, harm)


def test_the_servo_is_stopped_and_goes_on(tmp_path):
    tally = Tally("servo: SIGSTOP 0.02 to 1.5 s, SIGCONT", 13, "resumes from rest within the "
                  "limits or fault servo_stalled, every call answered, status, "
                  "recovery")  # fmt: skip

    def harm(stage, number, generator):
        with under_way(stage, number, generator):
            servo = stage.servo
            os.kill(servo, signal.SIGSTOP)
            try:
                time.sleep(generator.choice((0.02, 0.1, 0.3, 0.7, 1.5)))
            finally:
                os.kill(servo, signal.SIGCONT)
            time.sleep(generator.uniform(0.0, 0.1))
        stage.come_to_rest()
        # If a queued motion cannot be handed to the stopped servo, the fault is `internal`.
        stage.settle(faults=("none", "servo_stalled", "internal"))

    rehearse(tmp_path, "servo-stopped", tally, harm)


def command(stage, name):
    """Send a command that needs only its name."""
    if name == "RenewLease":
        stage.call(name, pb.RenewLeaseRequest(token=stage.daemon.token))
    elif name in ("Stop", "Halt"):
        stage.call(name, request_of(name)(device=DEVICE))
    else:
        stage.command(name, **({"speed": 0.5} if name == "SetSpeed" else {}))


COMMANDS = (
    "Stop", "Halt", "Pause", "Resume", "SetSpeed", "Enable", "Disable", "Reset", "RenewLease",
)  # fmt: skip


def test_commands_to_a_stopped_servo_are_answered(tmp_path):
    tally = Tally("servo: SIGSTOP without SIGCONT, any command", 14, "every call answered within a "
                  "second, status, recovery after SIGKILL")  # fmt: skip

    def harm(stage, number, generator):
        with under_way(stage, 0, generator):
            servo = stage.servo
            os.kill(servo, signal.SIGSTOP)
            try:
                command(stage, COMMANDS[number % len(COMMANDS)])
                tally.met["done"] += 1
            except grpc.RpcError as error:
                tally.met[error.code().name.lower()] += 1
            finally:
                os.kill(servo, signal.SIGKILL)
            stage.await_fault()
        stage.settle(faults=("servo_died",))

    rehearse(tmp_path, "servo-frozen", tally, harm)


MOTION = {
    "keyframes": [{"rotation_vector": [0, 0, 0]}, {"rotation_vector": [0, 0.5, 2.5]}],
    "approach": True,
}

LOSSES = pytest.mark.parametrize("loss", [signal.SIGKILL, signal.SIGSTOP])


@LOSSES
def test_a_client_is_lost(tmp_path, loss):
    after = {signal.SIGKILL: "the broken call", signal.SIGSTOP: "the end of the lease"}[loss]
    tally = Tally(f"client `orientd move`: {loss.name}", 20, f"stop after {after}, limits, lease "
                  "free")  # fmt: skip
    path = tmp_path / "motion.json"
    path.write_text(json.dumps(MOTION))

    def harm(stage, number, generator):
        stage.call("ReleaseLease", pb.ReleaseLeaseRequest(token=stage.daemon.token))
        client = begin(
            "move", path, "--socket", stage.daemon.socket,
            env=environment(XDG_CONFIG_HOME=str(tmp_path)),
        )  # fmt: skip
        try:
            until(lambda: stage.device().state == pb.STATE_STREAMING, "a motion", 20.0)
            time.sleep(generator.uniform(0.0, 0.8))
            client.send_signal(loss)
            stage.rests()
            until(lambda: not stage.status()["daemon"]["leases"], "a free lease", 5.0)
            assert stage.device().path_time <= stage.device().duration
        finally:
            client.kill()
            client.communicate()
            for left in stage.daemon.folder.glob("*.sock.lease*"):
                left.unlink()
        stage.settle(faults=("none",), holder="")

    name = f"client-{loss.name.lower()}"
    rehearse(tmp_path / "daemon", name, tally, harm, lease_seconds=3.0)


ONLOOKERS = {"record": ("mcap", 21), "view": ("websockets", 22)}


def onlooker(stage, what, output):
    """Begin `record` or `view`, and return the process and its address."""
    arguments = [output] if what == "record" else ["--no-open", "--port", "0"]
    process = begin(what, *arguments, "--socket", stage.daemon.socket)
    return process, process.stdout.readline().split()[-1]


def check_onlooker(process, what, address):
    """Check that the command continues: `view` answers, and both end with exit code 0."""
    if what == "view":
        with urllib.request.urlopen(address, timeout=20.0) as page:
            assert page.status == 200
    process.terminate()
    _, said = process.communicate(timeout=30.0)
    assert process.returncode == 0, said


@LOSSES
@pytest.mark.parametrize("what", ONLOOKERS)
def test_an_onlooker_is_lost(tmp_path, loss, what):
    needed, order = ONLOOKERS[what]
    goes_on = loss is signal.SIGSTOP
    word = "SIGSTOP 0.3 to 2 s, SIGCONT" if goes_on else "SIGKILL"
    claim = {"record": ", the recording opens", "view": ", the page answers" * goes_on}[what]
    claims = f"no fault, limits, status, recovery{claim}{', exit code 0' * goes_on}"
    tally = Tally(f"`orientd {what}`: {word}", order, claims)
    name = f"{what}-{loss.name.lower()}"
    if find_spec(needed) is None:
        tally.skip(name, f"{needed} was not installed")

    def harm(stage, number, generator):
        output = tmp_path / f"{number}.mcap"
        process, address = onlooker(stage, what, output)
        try:
            with under_way(stage, number, generator):
                process.send_signal(loss)
                time.sleep(generator.uniform(0.3, 2.0) if goes_on else 0.3)
                process.send_signal(signal.SIGCONT)
            stage.come_to_rest()
            if goes_on:
                check_onlooker(process, what, address)
        finally:
            process.kill()
            process.communicate()
        if output.exists():
            load_recording(output, partial=True)
            output.unlink()
        stage.settle(faults=("none",))

    rehearse(tmp_path / "daemon", name, tally, harm)
