"""The socket where a servo hears of stops: who is heard, and what is answered."""

import contextlib
import json
import os
import socket
import subprocess
import sys

import pytest
from rig import Rig, peaks, turn

from orientd.servo.stop_socket import HEARD, StopSocket
from orientd.stream.records import Command, ServoState, Stop

OURS = {"users": [os.getuid()], "groups": []}
NOBODY = {"users": [], "groups": []}


@pytest.fixture
def path(tmp_path):
    return str(tmp_path / "arm")


@contextlib.contextmanager
def listening(path, admitted=OURS, daemon_pid=0):
    stop_socket = StopSocket(path, daemon_pid, admitted)
    try:
        yield stop_socket
    finally:
        stop_socket.close()


@contextlib.contextmanager
def sender(path, *words):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as one:
        one.bind("")
        one.settimeout(5.0)
        for word in words:
            one.sendto(word, path)
        yield one


@pytest.mark.parametrize("kind", ["stop", "halt"])
def test_a_stop_from_the_socket_is_taken_like_a_command(path, kind):
    def rest(begin):
        rig = Rig()
        rig.start(turn())
        rig.run(300)
        begin(rig)
        rig.run_until(lambda servo: servo.state is ServoState.HOLDING)
        return rig, rig.sent()[300:]

    with listening(path) as stop_socket, sender(path) as one:

        def ask(rig):
            rig.servo._stop_socket = stop_socket
            one.sendto(kind.encode(), path)

        rig, sent = rest(ask)
        answer = one.recv(100)
    assert answer == f"took STREAMING {rig.cycle.motion}".encode()
    stop = Stop(*rig.memory.stops.read(0))
    assert stop == (0, kind == "halt", os.getpid(), os.getuid(), os.getgid())
    assert peaks(rig.sent())[0] > 0.0
    assert (sent == rest(lambda rig: rig.ask(Command[kind.upper()]))[1]).all()


def test_a_user_who_is_not_admitted_is_refused(path):
    with listening(path, NOBODY) as stop_socket, sender(path, b"stop") as one:
        assert list(stop_socket.requests()) == []
        assert one.recv(100) == f"refused {os.getuid()}".encode()


def test_a_group_of_the_sender_admits_it(path):
    gid = max(os.getgroups() or [os.getgid()])
    with (
        listening(path, {"users": [], "groups": [gid]}) as stop_socket,
        sender(path, b"halt"),
    ):
        (request,) = stop_socket.requests()
    assert (request.is_quickest, request.gid) == (True, gid)


@pytest.mark.skipif(os.getuid() != 0, reason="becomes another user, which root may")
def test_any_group_of_the_sender_admits_it_and_only_while_it_is_listed(open_folder):
    path, user, group = str(open_folder / "leg"), 54303, 54399
    program = (
        f"import os, socket\nos.setgroups([{group}])\nos.setgid({user})\nos.setuid({user})\n"
        "one = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)\n"
        f"one.bind('')\none.sendto(b'halt', {path!r})\nprint(flush=True)\n"
        "print(one.recv(100).decode())"
    )
    for listed, answer in ((group, "took"), (group + 1, f"refused {user}")):
        with (
            listening(path, {"users": [], "groups": [listed]}) as stop_socket,
            subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE) as process,
        ):
            process.stdout.readline()
            requests = list(stop_socket.requests())
            for request in requests:
                stop_socket.answer(request.sender, "took")
            assert process.stdout.readline().decode().strip() == answer
        assert [(one.uid, one.gid) for one in requests] == [(user, group)] * (listed == group)


@pytest.mark.parametrize("word", [b"", b"{}", b"go", b"\xff", b"stopped", b"x" * 20_000])
def test_nonsense_is_answered_and_stops_nothing(path, word):
    with listening(path) as stop_socket, sender(path, word) as one:
        assert list(stop_socket.requests()) == []
        assert one.recv(100) == b"wrong"


def test_a_sender_without_an_address_or_that_is_gone_is_heard(path):
    with listening(path) as stop_socket:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as one:
            one.sendto(b"stop", path)
        with sender(path, b"stop"):
            pass
        requests = list(stop_socket.requests())
        for request in requests:
            stop_socket.answer(request.sender, "took HOLDING 0")
    assert len(requests) == 2


def test_a_cycle_hears_a_few_at_the_most(path):
    with listening(path) as stop_socket, sender(path, *[b"stop"] * (HEARD + 2)):
        assert len(list(stop_socket.requests())) == HEARD
        assert len(list(stop_socket.requests())) == 2


def test_the_daemon_alone_says_who_is_admitted(path):
    news = b"admit " + json.dumps(OURS).encode()
    with listening(path, NOBODY) as stop_socket, sender(path, news, b"hello") as one:
        assert list(stop_socket.requests()) == []
        assert one.recv(100).startswith(b"refused")
    with listening(path, NOBODY, os.getpid()) as stop_socket, sender(path, news, b"hello") as one:
        assert list(stop_socket.requests()) == []
        assert one.recv(100) == b"admitted"
