"""Notifications to systemd."""

import socket

import pytest

from orientd.daemon.systemd import notify


@pytest.mark.parametrize("kind", ["path", "abstract"])
def test_the_state_arrives(tmp_path, monkeypatch, kind):
    address = str(tmp_path / "notify") if kind == "path" else f"@orientd-test-{tmp_path.name}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(address.replace("@", "\0", 1))
        monkeypatch.setenv("NOTIFY_SOCKET", address)
        notify("READY=1")
        assert receiver.recv(100) == b"READY=1"


def test_nobody_is_told_where_nobody_asks(monkeypatch):
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    opened = []
    monkeypatch.setattr(socket, "socket", lambda *kind: opened.append(kind))
    notify("READY=1")
    assert opened == []


def test_a_listener_that_is_gone_does_no_harm(tmp_path, monkeypatch):
    address = str(tmp_path / "gone")
    monkeypatch.setenv("NOTIFY_SOCKET", address)
    notify("READY=1")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(address)
        notify("WATCHDOG=1")
        assert receiver.recv(100) == b"WATCHDOG=1"
