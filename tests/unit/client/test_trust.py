"""Ownership of the socket: the client refuses one that others own or can replace."""

import contextlib
import os
import socket
import subprocess
import sys

import pytest

from orientd.client import trust
from orientd.client.channel import Way
from orientd.client.stop_call import ask_to_stop
from orientd.client.trust import check_folder, check_socket
from orientd.errors import AccessError, DaemonError

OTHER = 54321

needs_root = pytest.mark.skipif(os.getuid() != 0, reason="gives files to others, which root may")


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "folder"
    made.mkdir(mode=0o700)
    return made


@pytest.fixture
def listening(folder):
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(folder / "control.sock"))
        listener.listen(20)
        yield folder / "control.sock"


def refused(path, reason):
    """Check that nobody talks to what is at *path*."""
    with pytest.raises(DaemonError, match=reason):
        check_socket(path)
    with pytest.raises(DaemonError, match=reason):
        Way(path).open()


def test_ones_own_socket_in_ones_own_folder_is_taken(listening):
    check_socket(listening)


def test_where_there_is_nothing_nothing_is_refused(folder):
    check_socket(folder / "none.sock")
    check_socket(folder / "none" / "at" / "all.sock")


@pytest.mark.parametrize("mode", [0o702, 0o777, 0o1777, 0o703])
def test_a_folder_that_others_can_write_is_refused(folder, mode):
    check_folder(folder)
    folder.chmod(mode)
    with pytest.raises(DaemonError, match=rf"others can write {folder} \(mode {mode:o}\)"):
        check_folder(folder)


def test_the_advice_for_a_shared_folder_changes_nothing_for_others(folder):
    folder.chmod(0o1777)
    with pytest.raises(DaemonError, match=r"\(mode 1777\): choose another folder$"):
        check_folder(folder)
    folder.chmod(0o777)
    with pytest.raises(DaemonError, match=rf": chmod o-w {folder}, or choose another folder$"):
        check_folder(folder)


def test_a_folder_that_its_group_can_write_is_named_in_a_warning(folder, caplog):
    check_folder(folder)
    assert not caplog.messages
    folder.chmod(0o770)
    check_folder(folder)
    (warning,) = caplog.messages
    assert warning.startswith(f"the group of {folder} can remove the sockets in it (mode 770)")
    assert warning.endswith(f"chmod g-w {folder}")


@needs_root
def test_a_folder_of_others_is_refused(folder):
    os.chown(folder, OTHER, OTHER)
    with pytest.raises(DaemonError, match=rf"{folder} is of user {OTHER}"):
        check_folder(folder)


@pytest.mark.parametrize("kind", ["file", "folder", "fifo", "link"])
def test_what_is_no_socket_is_refused(folder, listening, kind):
    path = folder / "fake"
    make = {
        "file": path.touch,
        "folder": path.mkdir,
        "fifo": lambda: os.mkfifo(path),
        "link": lambda: path.symlink_to(listening),
    }
    make[kind]()
    refused(path, "is not a socket")


LISTENER = f"""
import contextlib, os, socket, sys
listener = socket.socket(socket.AF_UNIX)
os.setgroups([]); os.setgid({OTHER}); os.setuid({OTHER})
listener.bind(sys.argv[1])
listener.listen(20)
print("listening", flush=True)
while True:
    with contextlib.suppress(OSError), listener.accept()[0] as caller:
        caller.recv(1)
"""

SERVO = f"""
import contextlib, os, socket, sys
listener = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
os.setgroups([]); os.setgid({OTHER}); os.setuid({OTHER})
os.mkdir(sys.argv[1] + ".stop", 0o755)
listener.bind(sys.argv[1] + ".stop/arm")
os.chmod(sys.argv[1] + ".stop/arm", 0o666)
print("listening", flush=True)
while True:
    with contextlib.suppress(OSError):
        _, sender = listener.recvfrom(100)
        listener.sendto(b"took HOLDING 0", sender)
"""


@contextlib.contextmanager
def served_as_other(program, path):
    """Have a process of another user listen at *path*."""
    command = [sys.executable, "-c", program, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as server:
        try:
            assert server.stdout.readline() == b"listening\n"
            yield
        finally:
            server.kill()


@needs_root
@pytest.mark.parametrize(
    ("program", "talk"),
    [(LISTENER, check_socket), (SERVO, lambda path: ask_to_stop(path, "stop"))],
    ids=["listener", "servo"],
)
def test_a_daemon_of_others_is_refused_unless_it_is_named(
    open_folder, monkeypatch, request, program, talk
):
    shared = open_folder / request.node.callspec.id
    shared.mkdir()
    shared.chmod(0o777)
    with served_as_other(program, shared / "control.sock"):
        shared.chmod(0o755)
        monkeypatch.setenv(trust.DAEMON_USER, "")
        with pytest.raises(DaemonError, match=rf"user {OTHER}"):
            talk(shared / "control.sock")
        monkeypatch.setenv(trust.DAEMON_USER, str(OTHER))
        talk(shared / "control.sock")


def test_a_user_that_there_is_not_is_no_daemon_user(folder, monkeypatch):
    monkeypatch.setenv(trust.DAEMON_USER, "nobody-of-that-name")
    with pytest.raises(DaemonError, match="there is no user 'nobody-of-that-name'"):
        check_folder(folder)


@needs_root
def test_the_folder_of_the_system_is_whose_root_says(folder, monkeypatch):
    os.chown(folder, OTHER, OTHER)
    monkeypatch.setattr(trust, "SYSTEM_SOCKET", str(folder / "control.sock"))
    check_folder(folder)


@pytest.fixture
def stop_folder(folder):
    made = folder / "control.sock.stop"
    made.mkdir(mode=0o700)
    return made


def test_an_answer_of_another_user_is_no_stop(folder, stop_folder):
    answers = {"arm": ("took HOLDING 1", OTHER)}
    with pytest.raises(DaemonError, match=rf"{stop_folder / 'arm'} is of .*{OTHER}"):
        ask_to_stop(folder / "control.sock", "stop", answers=answers)


def test_answers_from_a_folder_that_others_can_write_are_no_stop(folder, stop_folder):
    stop_folder.chmod(0o777)
    with pytest.raises(DaemonError, match=f"others can write {stop_folder}"):
        ask_to_stop(folder / "control.sock", "stop", answers={"arm": ("took HOLDING 1", 0)})


def test_a_stop_that_a_servo_refuses_is_refused(folder, stop_folder):
    with pytest.raises(AccessError, match=f"user {OTHER} is not admitted"):
        ask_to_stop(folder / "control.sock", "stop", answers={"arm": (f"refused {OTHER}", 0)})


def test_a_device_that_does_not_answer_a_stop_is_named(folder, stop_folder):
    answers = {"arm": ("", -1), "leg": ("took HOLDING 1", 0)}
    told = "no servo of arm answers the stop: it may still move; told to stop: leg"
    with pytest.raises(DaemonError, match=told):
        ask_to_stop(folder / "control.sock", "stop", answers=answers)
