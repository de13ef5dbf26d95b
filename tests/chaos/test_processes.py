"""Processes killed, stopped and resumed at random moments of motions; run with `make chaos`."""

import json
import os
import signal
import time
from importlib.util import find_spec

import grpc
import pytest
from command_line import begin, environment
from harness import DEVICE, is_alive, until
from ledger import Tally, rounds_of
from scenes import under_way
from stage import Stage

from orientd.rpc import control_pb2 as pb

pytestmark = [pytest.mark.chaos, pytest.mark.timeout(7200)]


def kill_daemon(stage, generator):
    """Kill the daemon; see the servo brake and end, and a new daemon take its place."""
    servo = stage.servo
    os.kill(stage.daemon.process.pid, signal.SIGKILL)
    stage.daemon.process.wait()
    until(lambda: not is_alive(servo), "the servo process ends", 5.0)
    assert not stage.family(), stage.family()
    last_words = json.loads(stage.daemon.report.read_text())
    assert last_words["reason"] == "the daemon is gone"
    assert last_words["state"] == "holding"
    stage.tally.met["braked and held"] += 1


def renew(stage):
    """Start the daemon that follows; it knows of no lease and no fault."""
    stage.check_sent()
    stage.daemon.end()
    stage.start()
    stage.check_truth(faults=("none",))


def test_the_daemon_is_killed(tmp_path):
    tally = Tally("daemon: SIGKILL", 10, "stop on the path within the limits, servo gone, next "
                  "daemon at once and a motion")  # fmt: skip

    def one(number, generator):
        with stage.round():
            with under_way(stage, number, generator):
                kill_daemon(stage, generator)
            stage.streams.clear()
            renew(stage)
            stage.recover()

    with Stage(tmp_path, tally) as stage:
        rounds_of("daemon-killed", tally, one)


def test_the_daemon_is_stopped_and_goes_on(tmp_path):
    tally = Tally("daemon: SIGSTOP 0.1 to 2.5 s, SIGCONT", 11, "limits, no fault but a lost "
                  "heartbeat, status, recovery")  # fmt: skip

    def one(number, generator):
        with stage.round():
            with under_way(stage, number, generator):
                process = stage.daemon.process
                process.send_signal(signal.SIGSTOP)
                stage.calls.went_on = float("inf")
                time.sleep(generator.choice((0.1, 0.4, 0.8, 1.3, 2.5)))
                stage.calls.went_on = time.monotonic()
                process.send_signal(signal.SIGCONT)
                time.sleep(0.1)
            stage.call("Stop", pb.StopRequest(device=DEVICE))
            stage.rests()
            stage.streams.clear()
            stage.check_truth(faults=("none", "heartbeat_lost"))
            stage.check_sent()
            stage.recover()

    with Stage(tmp_path, tally) as stage:
        rounds_of("daemon-stopped", tally, one)


def test_the_servo_is_killed(tmp_path):
    tally = Tally("servo: SIGKILL", 12, "limits up to the end, fault servo_died, reset, a "
                  "motion")  # fmt: skip

    def one(number, generator):
        with stage.round():
            with under_way(stage, number, generator):
                servo = stage.servo
                os.kill(servo, signal.SIGKILL)
                until(lambda: stage.device().state == pb.STATE_FAULT, "the fault", 1.0)
            stage.streams.clear()
            stage.check_truth(faults=("servo_died",))
            stage.check_sent()
            stage.recover()

    with Stage(tmp_path, tally) as stage:
        rounds_of("servo-killed", tally, one)


def test_the_servo_is_stopped_and_goes_on(tmp_path):
    tally = Tally("servo: SIGSTOP 0.02 to 1.5 s, SIGCONT", 13, "limits from setpoint to setpoint, "
                  "every call answered, status, recovery")  # fmt: skip

    def one(number, generator):
        with stage.round():
            with under_way(stage, number, generator):
                servo = stage.servo
                os.kill(servo, signal.SIGSTOP)
                try:
                    time.sleep(generator.choice((0.02, 0.1, 0.3, 0.7, 1.5)))
                finally:
                    os.kill(servo, signal.SIGCONT)
                time.sleep(generator.uniform(0.0, 0.1))
            stage.call("Stop", pb.StopRequest(device=DEVICE))
            stage.rests()
            stage.streams.clear()
            # A motion that is to follow cannot be handed over to who is stopped: internal.
            stage.check_truth(faults=("none", "internal"))
            stage.check_sent()
            stage.recover()

    with Stage(tmp_path, tally) as stage:
        rounds_of("servo-stopped", tally, one)


COMMANDS_OF_A_STOPPED_SERVO = (
    "Stop", "Halt", "Pause", "Resume", "SetSpeed", "Enable", "Disable", "Reset", "RenewLease",
)  # fmt: skip


def test_commands_to_a_stopped_servo_are_answered(tmp_path):
    tally = Tally("servo: SIGSTOP for good, any command", 14, "every call answered within a "
                  "second, status, recovery after SIGKILL")  # fmt: skip

    def one(number, generator):
        with stage.round():
            with under_way(stage, 0, generator):
                servo = stage.servo
                os.kill(servo, signal.SIGSTOP)
                name = COMMANDS_OF_A_STOPPED_SERVO[number % len(COMMANDS_OF_A_STOPPED_SERVO)]
                fields = {"speed": 0.5} if name == "SetSpeed" else {}
                try:
                    if name == "RenewLease":
                        stage.call(name, pb.RenewLeaseRequest(token=stage.daemon.token))
                    elif name in ("Stop", "Halt"):
                        stage.call(name, getattr(pb, f"{name}Request")(device=DEVICE))
                    else:
                        stage.command(name, **fields)
                    tally.met["done"] += 1
                except grpc.RpcError as error:
                    tally.met[error.code().name.lower()] += 1
                finally:
                    os.kill(servo, signal.SIGKILL)
                until(lambda: stage.device().state == pb.STATE_FAULT, "the fault", 2.0)
            stage.streams.clear()
            stage.check_truth(faults=("servo_died",))
            stage.check_sent()
            stage.recover()

    with Stage(tmp_path, tally) as stage:
        rounds_of("servo-frozen", tally, one)


MOTION = {
    "keyframes": [{"rotation_vector": [0, 0, 0]}, {"rotation_vector": [0, 0.5, 2.5]}],
    "approach": True,
}


@pytest.mark.parametrize("number_of_signal", [signal.SIGKILL, signal.SIGSTOP])
def test_a_client_is_lost(tmp_path, number_of_signal):
    word = number_of_signal.name
    after = "stop once the call breaks" if word == "SIGKILL" else "stop once the lease ends"
    tally = Tally(f"client `orientd move`: {word}", 20, f"{after}, limits, lease free")
    path = tmp_path / "motion.json"
    path.write_text(json.dumps(MOTION))

    def one(number, generator):
        with stage.round():
            stage.call("ReleaseLease", pb.ReleaseLeaseRequest(token=stage.daemon.token))
            client = begin(
                "move", path, "--socket", stage.daemon.socket,
                env=environment(XDG_CONFIG_HOME=str(tmp_path)),
            )  # fmt: skip
            try:
                until(lambda: stage.device().state == pb.STATE_STREAMING, "a motion", 20.0)
                time.sleep(generator.uniform(0.0, 0.8))
                client.send_signal(number_of_signal)
                stage.rests()
                until(lambda: not stage.status()["daemon"]["lease_holder"], "a free lease", 5.0)
                assert stage.device().path_time <= stage.device().duration
            finally:
                client.kill()
                client.communicate()
                for left in stage.daemon.folder.glob("*.sock.lease*"):
                    left.unlink()
            stage.check_truth(faults=("none",), holder="")
            stage.check_sent()
            request = pb.AcquireLeaseRequest(holder="test")
            stage.daemon.token = stage.call("AcquireLease", request).lease.token
            stage.recover()

    with Stage(tmp_path / "daemon", tally, lease_seconds=3.0) as stage:
        rounds_of(f"client-{word.lower()}", tally, one)


@pytest.mark.parametrize("number_of_signal", [signal.SIGKILL, signal.SIGSTOP])
@pytest.mark.parametrize("what", ["record", "view"])
def test_an_onlooker_is_lost(tmp_path, number_of_signal, what):
    word = number_of_signal.name
    tally = Tally(f"`orientd {what}`: {word}", 21 + (what == "view"), "no fault, "
                  "limits, status, recovery")  # fmt: skip
    needed = {"record": "mcap", "view": "viser"}[what]
    if find_spec(needed) is None:
        tally.skipped = f"{needed} was not installed"
        tally.keep(f"{what}-{word.lower()}")
        pytest.skip(tally.skipped)

    def one(number, generator):
        with stage.round():
            output = tmp_path / f"{number}.mcap"
            arguments = [output] if what == "record" else ["--no-open", "--port", "0"]
            onlooker = begin(what, *arguments, "--socket", stage.daemon.socket)
            try:
                onlooker.stdout.readline()
                with under_way(stage, number, generator):
                    onlooker.send_signal(number_of_signal)
                    time.sleep(0.3)
                stage.call("Stop", pb.StopRequest(device=DEVICE))
                stage.rests()
            finally:
                onlooker.kill()
                onlooker.communicate()
            if what == "record" and output.exists():
                from orientd.recorder import reader

                reader.load(output)
                output.unlink()
            stage.streams.clear()
            stage.check_truth(faults=("none",))
            stage.check_sent()
            stage.recover()

    with Stage(tmp_path / "daemon", tally) as stage:
        rounds_of(f"{what}-{word.lower()}", tally, one)
