"""A daemon as systemd runs it: ready, watched, reloaded, and started again without moving."""

import contextlib
import os
import signal
import socket

import grpc
import numpy as np
import pytest
from command_line import orientd
from harness import DEVICE, DaemonProcess, spin, until
from motions import motion_of

from orientd.protocol import control_pb2 as pb


def log(daemon):
    return (daemon.folder / "log").read_text()


def test_systemd_is_told_that_it_is_ready_makes_progress_and_ends(tmp_path, monkeypatch):
    path = tmp_path / "notify"
    monkeypatch.setenv("NOTIFY_SOCKET", str(path))
    monkeypatch.setenv("WATCHDOG_USEC", "800000")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(str(path))
        receiver.settimeout(20.0)
        with DaemonProcess(tmp_path / "daemon") as daemon:
            # A daemon that starts slowly makes progress several times before it is ready.
            while receiver.recv(100) != b"READY=1":
                pass
            assert receiver.recv(100) == b"WATCHDOG=1"
            # A servo that stands still, in a process that is there.
            servo = daemon.device().servo_pid
            os.kill(servo, signal.SIGSTOP)
            try:
                until(lambda: f"watchdog: no cycle of {DEVICE}" in log(daemon), "the alarm")
                receiver.settimeout(0.0)
                with contextlib.suppress(BlockingIOError):
                    while receiver.recv(100):
                        pass
                receiver.settimeout(0.5)
                with pytest.raises(TimeoutError):
                    receiver.recv(100)
            finally:
                os.kill(servo, signal.SIGCONT)
            receiver.settimeout(20.0)
            assert receiver.recv(100) == b"WATCHDOG=1"
            daemon.end()
            while (told := receiver.recv(100)) == b"WATCHDOG=1":
                pass
            assert told == b"STOPPING=1"


def test_a_reload_changes_what_can_change_and_names_what_cannot(tmp_path):
    with DaemonProcess(tmp_path) as daemon:
        before = daemon.device().servo_pid
        text = daemon.config.read_text()
        daemon.config.write_text("[access]\nkeyframes = 2\n" + text.replace("500.0", "100.0"))
        daemon.process.send_signal(signal.SIGHUP)
        until(lambda: "reload: changed: access.keyframes" in log(daemon), "the reload")
        fixed = f"reload: needs a restart: devices.{DEVICE}.rate_hz"
        until(lambda: fixed in log(daemon), "what cannot be changed")
        motion = motion_of(*({"time": float(k)} for k in range(3)))
        with pytest.raises(grpc.RpcError, match="expected at most 2, got 3"):
            daemon.stub.Plan(pb.PlanRequest(motion=motion))
        daemon.config.write_text("nonsense")
        daemon.process.send_signal(signal.SIGHUP)
        until(lambda: "reload: nothing changed: " in log(daemon), "the refusal")
        assert daemon.device().servo_pid == before


def test_a_daemon_that_is_started_again_moves_nothing(tmp_path):
    with DaemonProcess(tmp_path) as daemon:
        daemon.move(spin(10.0))
        until(lambda: daemon.device().path_time > 0.5, "motion")
        daemon.process.kill()
        daemon.end()
        daemon.start()
        first = daemon.device().cycle.index
        until(lambda: daemon.device().cycle.index > first + 250, "cycles")
        device = daemon.device()
        assert (device.state, device.motion_number) == (pb.STATE_HOLDING, 0)
        sent = daemon.sent()[-200:]
        assert np.all(sent == sent[0])


def test_the_unit_is_written_for_the_user(tmp_path, monkeypatch):
    config = tmp_path / "orientd.toml"
    config.write_text('[devices.arm]\ndriver = "loopback"\n')
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    done = orientd("service", "install", "--user", "--config", config, env=dict(os.environ))
    assert done.returncode == 0, done.stderr
    written = (tmp_path / "systemd/user/orientd.service").read_text()
    printed = orientd("service", "install", "--user", "--print", "--config", config)
    assert printed.stdout == written
    assert "systemctl --user enable --now orientd" in done.stdout
