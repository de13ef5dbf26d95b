"""Effects of options of commands; the tests of the commands cover the other options."""

import json
import os
import subprocess
import time

import numpy as np
import pytest
from command_line import begin, environment, inside
from gimbal_bench import EmulatedGimbal
from harness import DEVICE, peaks, until

from orientd.protocol import control_pb2 as pb
from orientd.rotation import angle, conjugate, exp, log, multiply
from orientd_loopback import read_recording

pytestmark = pytest.mark.world

RATE = 0.8


def told(*words):
    done = inside(*words, "--json")
    assert (done.returncode, done.stderr) == (0, ""), done
    return json.loads(done.stdout)


def test_a_turn_has_the_rate_duration_axis_and_frame_that_it_is_given(daemon):
    def turn(*words):
        begun = len(daemon.sent())
        told("turn", *words, "--duration", "0.5", "--socket", daemon.socket)
        return daemon.sent()[begun:]

    turn("--rate", "2.4")  # the tool's axes lie elsewhere than the world's
    for frame in ("body", "world"):
        q = turn("--rate", str(-RATE), "--axis", "x", "--frame", frame)
        step = multiply(conjugate(q[0]), q[-1])
        turned = log(step if frame == "body" else multiply(q[-1], conjugate(q[0])))
        assert turned[1:] == pytest.approx([0.0, 0.0], abs=1e-9)
        # At the rate for the duration, and the way there and back to rest.
        assert -0.5 * RATE - 0.4 < turned[0] < -0.5 * RATE
        assert peaks(q, daemon.period)[0] == pytest.approx(RATE, rel=1e-6)


def test_a_target_without_a_lifetime_counts_for_the_one_that_is_given(daemon):
    words = ("track", "--time-to-live", "0.3", "--socket", daemon.socket)
    with begin(*words, stdin=subprocess.PIPE, env=environment()) as process:
        target = {"rotation_vector": [0, 0, 0], "angular_velocity": [0, 0, 0.5]}
        process.stdin.write(json.dumps(target) + "\n")
        process.stdin.flush()
        until(lambda: daemon.device().state == pb.STATE_TRACKING, "targets to be followed")

        def rests():
            q = daemon.sent()[-100:]
            return np.array_equal(q[0], q[-1]) and daemon.device().state == pb.STATE_TRACKING

        # Its input is still open: it rests since the target has expired.
        until(rests, "rest")
        process.communicate(timeout=30)
    assert process.returncode == 0


def test_a_motion_is_done_on_target_as_it_is_asked(daemon, tmp_path):
    file = tmp_path / "there.json"
    file.write_text(json.dumps({"keyframes": [{"rotation_vector": [0, 0, 0.2]}]}))
    words = ("move", file, "--socket", daemon.socket, "--on-target")
    assert told(*words, "1,1,0.05")["summary"]["outcome"] == "done"
    assert inside(*words, "1,1").returncode == 2


def test_a_motion_starts_after_the_delay_that_is_given(daemon, tmp_path):
    file = tmp_path / "there.json"
    file.write_text(json.dumps({"keyframes": [{"rotation_vector": [0, 0, -0.2]}]}))
    asked_ns, begun = time.monotonic_ns(), len(daemon.sent())
    told("move", file, "--start-in", "5", "--socket", daemon.socket)
    sent = read_recording(daemon.recording)[begun:]
    first = next(one for one in sent if one.q != sent[0].q)
    # A setpoint is the target for the end of its cycle.
    assert first.time_ns + 1e9 * daemon.period > asked_ns + 5_000_000_000


def test_a_delay_does_not_depend_on_the_time_of_day(daemon, tmp_path, monkeypatch):
    file = tmp_path / "there.json"
    file.write_text(json.dumps({"keyframes": [{"rotation_vector": [0, 0, 0.1]}]}))
    right = time.time
    monkeypatch.setattr(time, "time", lambda: right() + 50_000.0)
    asked_ns, begun = time.monotonic_ns(), len(daemon.sent())
    done = told("move", file, "--start-in", "5", "--socket", daemon.socket)
    assert done["summary"]["outcome"] == "done"
    sent = read_recording(daemon.recording)[begun:]
    first = next(one for one in sent if one.q != sent[0].q)
    assert first.time_ns + 1e9 * daemon.period > asked_ns + 5_000_000_000


def test_a_queued_motion_is_blended_by_at_most_what_is_given(daemon, tmp_path):
    there, on = tmp_path / "there.json", tmp_path / "on.json"
    there.write_text(json.dumps({"keyframes": [{"rotation_vector": [0, 0, 0]}]}))
    told("move", there, "--socket", daemon.socket)
    begun = len(daemon.sent())
    there.write_text(
        json.dumps({"keyframes": [{"rotation_vector": [0, 0, 1.5]}], "limits": {"velocity": 0.2}})
    )
    keyframes = [{"rotation_vector": [0, 0, 1.5]}, {"rotation_vector": [0.6, 0, 1.5]}]
    on.write_text(json.dumps({"keyframes": keyframes, "approach": True}))
    with begin("move", there, "--socket", daemon.socket, "--json", env=environment()) as first:
        until(lambda: daemon.device().state == pb.STATE_STREAMING, "the first motion")
        words = ("--queue", "--blend", "5", "--lease", "--socket", daemon.socket)
        assert told("move", on, *words)["summary"]["outcome"] == "done"
        output, errors = first.communicate(timeout=30)
    assert first.returncode == 0, errors
    assert json.loads(output)["summary"]["outcome"] == "passed"
    corner = exp([0.0, 0.0, 1.5])
    assert 1e-3 < angle(daemon.sent()[begun:], corner).min() <= np.radians(5.0) + 1e-9


def test_emulated_servos_listen_at_the_line_speed_that_is_given(tmp_path, monkeypatch):
    sdk = pytest.importorskip("dynamixel_sdk")
    words = ("--baud", "57600", "--ideal", "--seed", "3", "--servos", "1:xm430")
    bus = EmulatedGimbal(tmp_path / "bus", *words)
    port = sdk.PortHandler(str(tmp_path / "bus"))
    try:
        assert port.openPort()
        # The vendor allows 34 ms for an answer, but a busy machine may not run the bus for longer.
        for baud, latency_ms, answer in ((1_000_000, 16, -3001), (57_600, 5000, 0)):
            monkeypatch.setattr("dynamixel_sdk.port_handler.LATENCY_TIMER", latency_ms)
            assert port.setBaudRate(baud)
            assert sdk.Protocol2PacketHandler().ping(port, 1)[1] == answer
    finally:
        port.closePort()
        bus.end()


def test_a_service_of_the_system_runs_as_the_user_that_is_given(tmp_path):
    config = tmp_path / "orientd.toml"
    config.write_text(f'[devices.{DEVICE}]\ndriver = "loopback"\n')
    done = inside("service", "install", "--config", config, "--as", "nobody", "--print")
    if os.getuid() == 0 and done.returncode:
        assert "nobody cannot" in done.stderr  # the folder is root's alone
    else:
        assert "User=nobody" in done.stdout.splitlines()


def test_the_configuration_of_a_router_is_printed(tmp_path):
    pytest.importorskip("zenoh")
    config = tmp_path / "router.toml"
    config.write_text(
        '[fleet]\ncell = "line"\nname = "router"\nlisten = ["tls/127.0.0.1:7447"]\n'
        'certificate = "r.pem"\nkey = "r.key"\n'
        'ca = "ca.pem"\ndaemons = ["arm-1"]\n[access.certificates]\npendant = "operator"\n'
    )
    done = inside("fleet", "router", "--config", config, "--print")
    assert done.returncode == 0, done.stderr
    assert "tls/127.0.0.1:7447" in done.stdout
