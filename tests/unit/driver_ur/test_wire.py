"""Connections to a controller, against a peer that answers whatever the test says."""

import contextlib
import os
import socket
import struct
import time

import pytest
from peers import package

from orientd.errors import LinkError
from orientd_ur.link import are_open, send_at_once
from orientd_ur.timing import TickListener
from orientd_ur.wire import (
    DASHBOARD_PORT,
    RTDE_PORT,
    SCRIPT_PORT,
    Connection,
    Dashboard,
    RtdeClient,
    take,
)

HEADER = struct.Struct(">HB")
SO_TIMESTAMPNS = 35


def rtde(peer, *answers):
    """Return a client whose version was accepted, and what it said after that."""
    host, heard = peer(RTDE_PORT, None, package("V", b"\1"), *answers)
    return RtdeClient(host, 1.0), heard


def test_messages_are_taken_one_by_one():
    stream = package("S", b"\1") + package("U", b"abc")
    kind, payload, rest = take(stream, HEADER, 100)
    assert (kind, payload) == (ord("S"), b"\1")
    assert take(rest, HEADER, 6) == (ord("U"), b"abc", b"")
    assert take(rest[:5], HEADER, 100) is None
    assert take(rest[:2], HEADER, 100) is None
    with pytest.raises(ValueError, match="a message of 2 bytes"):
        take(b"\0\2V", HEADER, 100)
    with pytest.raises(ValueError, match="a message of 6 bytes"):
        take(rest, HEADER, 5)


def test_name_of_a_server_that_is_not_there_is_in_the_error():
    with pytest.raises(LinkError, match=r"no dashboard server at 127\.96\.1\.1:29999: [A-Z]"):
        Dashboard("127.96.1.1")


def test_total_time_bounds_every_answer_together(peer):
    host, _ = peer(RTDE_PORT, None, package("V", b"\1"))
    client = RtdeClient(host, 300.0, total=0.3)
    with client, pytest.raises(LinkError, match="data packages: timed out"):
        client.sample()


def test_connection_that_the_controller_closes_is_said_to_be_closed(peer):
    host, _ = peer(RTDE_PORT)
    with Connection(host, RTDE_PORT, "server", 5.0) as connection:
        connection.sock.shutdown(socket.SHUT_WR)
        with pytest.raises(LinkError, match="did not send a word: it closed the connection"):
            connection.receive(lambda _: None, "a word")
    assert connection.sock.fileno() == -1


def test_lines_of_a_dashboard_are_answered_one_by_one(peer):
    host, heard = peer(
        DASHBOARD_PORT, b"Connected\n", b"first\nsecond\n", b"TRUE\n", b"False\n",
        b"could not understand: is in remote control\n",
    )  # fmt: skip
    with Dashboard(host, timeout=1.0) as dashboard:
        assert dashboard.ask("one") == "first"
        assert dashboard.ask("two") == "second"
        assert dashboard.is_remote is True
        assert dashboard.is_remote is False
        assert dashboard.is_remote is None
    assert heard[:2] == [b"one\n", b"two\n"]


def test_other_protocol_is_refused(peer):
    host, _ = peer(RTDE_PORT, None, package("V", b"\0"))
    with pytest.raises(LinkError, match="does not speak version 2 of RTDE"):
        RtdeClient(host, 1.0)


def test_version_of_the_controller_is_four_numbers(peer):
    client, heard = rtde(peer, package("v", struct.pack(">4I", 5, 12, 6, 7)), package("v", b"\1"))
    with client:
        assert client.controller_version() == (5, 12, 6, 7)
        with pytest.raises(LinkError, match="says its version in 1 bytes, not 16"):
            client.controller_version()
    assert heard[0] == b"\0\3v"


def test_registers_that_another_client_has_are_not_free(peer):
    client, heard = rtde(peer, package("I", b"\1INT32,IN_USE"), package("I", b"\1INT32,DOUBLE"))
    with client:
        assert not client.claim("a", "b")
        assert client.claim("a", "b")
    assert heard[0] == package("I", b"a,b")


def test_values_come_by_the_types_that_the_controller_says(peer):
    answer = package("O", b"\1DOUBLE,VECTOR6D,INT32,UINT32")
    values = package("U", struct.pack(">Bd6diI", 1, 0.5, 1, 2, 3, 4, 5, 6, -7, 8))
    client, heard = rtde(peer, answer, package("S", b"\1") + values[:20], values[20:])
    with client:
        client.subscribe(125.0, ["a", "b", "c", "d"])
        client.sock.sendall(b"more")
        assert client.sample() == {"a": (0.5,), "b": (1, 2, 3, 4, 5, 6), "c": (-7,), "d": (8,)}
    assert heard[0] == package("O", struct.pack(">d", 125.0) + b"a,b,c,d")


def test_answers_of_another_length_are_no_answers(peer):
    client, _ = rtde(
        peer, package("O", b"\1VECTOR6D"), package("S", b"\1") + package("U", b"\1" + bytes(8))
    )
    with client:
        client.subscribe(125.0, ["a"])
        words = "does not answer what was asked: a data package is 49 bytes, got 9"
        with pytest.raises(LinkError, match=words):
            client.sample()


def test_optional_variable_may_be_unknown_and_others_are_named(peer):
    lacks = package("O", b"\1DOUBLE,NOT_FOUND")
    client, heard = rtde(
        peer, lacks, package("O", b"\1DOUBLE"), package("S", b"\1"), lacks, package("O", b"\1")
    )
    with client:
        client.subscribe(125.0, ["a", "b"], optional="b")
        assert heard[1] == package("O", struct.pack(">d", 125.0) + b"a")
        with pytest.raises(LinkError, match="does not know the RTDE variable b"):
            client.subscribe(125.0, ["a", "b"])
        with pytest.raises(LinkError, match="does not know the RTDE variable a, b"):
            client.subscribe(125.0, ["a", "b"])


def test_packages_are_found_in_chunks(peer):
    one = [package("U", struct.pack(">Bd", 1, k)) for k in (1.0, 2.0, 3.0)]
    client, _ = rtde(peer, package("O", b"\1DOUBLE"), package("S", b"\1") + one[0])
    with client:
        client.subscribe(25.0, ["timestamp"])
        # It may have come together with the answer before.
        rest = b"" if client._pending else client.sock.recv(4096)
        assert client.samples_in(rest + one[1][:5]) == [{"timestamp": (1.0,)}]
        more = one[1][5:] + package("M", b"a message") + one[2]
        assert client.samples_in(more) == [{"timestamp": (2.0,)}, {"timestamp": (3.0,)}]
        with pytest.raises(ValueError, match="a data package is 9 bytes, got 2"):
            client.samples_in(package("U", b"\1\2"))


def arrived(sock, count):
    """Wait until *count* bytes can be read; return when that was seen, ns."""
    ends = time.monotonic() + 10.0
    while time.monotonic() < ends:
        with contextlib.suppress(BlockingIOError):
            if len(sock.recv(4096, socket.MSG_PEEK)) >= count:
                return time.monotonic_ns()
    raise AssertionError("nothing comes")


@pytest.fixture
def stamps():
    """Wait until the kernel stamps what arrives: it begins some time after a socket asks for it."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        sender = socket.create_connection(server.getsockname())
        receiver, _ = server.accept()
        with sender, receiver:
            receiver.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
            notes = []
            while not notes:
                sender.sendall(b"x")
                _, notes, _, _ = receiver.recvmsg(1, 64)
            yield


@pytest.mark.usefixtures("stamps")
def test_arrival_of_packages_is_told_by_the_kernel_until_nothing_comes_any_more(peer):
    *stamps, later = [package("U", struct.pack(">Bd", 1, k)) for k in (1.0, 2.0, 3.0)]
    host, _ = peer(
        RTDE_PORT, None, package("V", b"\1"), package("O", b"\1DOUBLE"), package("S", b"\1"),
        b"".join(stamps), later,
    )  # fmt: skip
    listener, begun_ns = TickListener(host), time.monotonic_ns()
    sock = listener._client.sock
    try:
        assert listener.heard() is None
        assert listener.silence_ns() is None
        sock.sendall(b"more")
        seen_ns = arrived(sock, 24)
        time.sleep(0.05)
        stamp, arrived_ns = listener.heard()
        assert stamp == 2.0
        # Not when it was read, which is later.
        assert begun_ns < arrived_ns <= seen_ns + 1_000_000
        assert listener.heard() is None
        assert listener.silence_ns() >= 49_000_000
        sock.sendall(b"more")
        arrived(sock, 12)
        assert listener.heard()[0] == 3.0
        sock.shutdown(socket.SHUT_RD)
        assert [listener.heard() for _ in range(3)] == [None] * 3
    finally:
        listener.close()
    assert listener.heard() is None


def test_controller_that_does_not_tell_its_time_is_named(peer):
    host, _ = peer(RTDE_PORT, None, package("V", b"\1"), package("O", b"\1NOT_FOUND"))
    with pytest.raises(LinkError, match=r"does not tell its time: .*variable timestamp"):
        TickListener(host)


def test_connections_to_the_rtde_and_script_ports_send_at_once_and_are_known_again(peer):
    ports = (RTDE_PORT, SCRIPT_PORT, DASHBOARD_PORT)
    for port in ports:
        host, _ = peer(port)
    socks = [socket.create_connection((host, port), 1.0) for port in ports]
    try:
        known = send_at_once(host)
        assert {one.descriptor for one in known} == {sock.fileno() for sock in socks[:2]}
        delays = [sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) for sock in socks]
        assert list(map(bool, delays)) == [True, True, False]
        assert send_at_once("127.96.1.2") == frozenset()
        assert are_open(known)
        # The library closes a socket and opens another, mostly with the same descriptor.
        with socket.socket() as other:
            os.dup2(other.fileno(), socks[0].fileno())
        assert not are_open(known)
        os.dup2(socks[1].fileno(), socks[0].fileno())
        assert not are_open(known)
        socks[1].close()
        assert not are_open(known)
    finally:
        for sock in socks:
            sock.close()
