"""Where the socket is."""

import os
from pathlib import Path

import pytest

from orientd import first_stop
from orientd.client import channel
from orientd.client.channel import MAX_PATH_BYTES, default_socket, target
from orientd.errors import DaemonError


def test_the_socket_is_in_the_runtime_directory(monkeypatch):
    monkeypatch.delenv("ORIENTD_SOCKET", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/run/user/7")
    assert default_socket() == Path("/run/user/7/orientd/control.sock")
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    assert default_socket() == Path(f"/tmp/orientd-{os.getuid()}/control.sock")


def test_the_environment_names_another(monkeypatch):
    monkeypatch.setenv("ORIENTD_SOCKET", "/elsewhere/x.sock")
    assert default_socket() == Path("/elsewhere/x.sock")


def test_a_path_that_no_socket_can_have_is_refused_with_its_length():
    fits = Path("/" + "x" * (MAX_PATH_BYTES - 1))
    assert target(fits) == f"unix:{fits}"
    with pytest.raises(DaemonError, match=r"at most 107 bytes, .* has 108"):
        target(Path("/" + "x" * MAX_PATH_BYTES))


def test_the_daemon_of_the_system_is_found_where_the_user_has_none(tmp_path, monkeypatch):
    monkeypatch.delenv("ORIENTD_SOCKET", raising=False)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    own, shared = tmp_path / "orientd" / "control.sock", tmp_path / "system.sock"
    monkeypatch.setattr(first_stop, "SYSTEM_SOCKET", str(shared))
    assert channel.found_socket() == own
    shared.touch()
    assert channel.found_socket() == shared
    assert channel.default_socket() == own
    own.parent.mkdir()
    own.touch()
    assert channel.found_socket() == own
    monkeypatch.setenv("ORIENTD_SOCKET", str(tmp_path / "named"))
    assert channel.found_socket() == tmp_path / "named"
