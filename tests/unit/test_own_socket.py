"""Whose requests a server carries out, and how many clients it has."""

import os
import resource
import socket

import pytest

from orientd.own_socket import MOST_CLIENTS, ClientListener, is_own_page, own_socket


@pytest.mark.parametrize(
    ("origin", "host", "is_local", "is_own"),
    [
        ("http://localhost:8080", "localhost:8080", True, True),
        ("http://[::1]:8080", "[::1]:8080", True, True),
        # A name that an attacker has made to mean this machine.
        ("http://elsewhere.example:8080", "elsewhere.example:8080", True, False),
        ("http://cell-3:8080", "cell-3:8080", False, True),
        ("http://cell-3:9090", "cell-3:8080", False, False),
        ("null", "cell-3:8080", False, False),
        (None, "cell-3:8080", False, True),
    ],
)
def test_whose_page_it_is_follows_from_origin_and_host(origin, host, is_local, is_own):
    assert is_own_page(origin, host, is_local=is_local) is is_own


@pytest.fixture
def listening():
    return own_socket("127.0.0.1", 0)


@pytest.fixture
def listener(listening):
    listener = ClientListener(listening)
    yield listener
    listener.close()


def connected(listening):
    return socket.create_connection(listening.getsockname(), timeout=10.0)


def test_a_server_hangs_up_on_more_clients_than_it_may_have(listener, listening):
    clients = [(connected(listening), listener.accept()[0]) for _ in range(MOST_CLIENTS)]
    with connected(listening) as refused:
        with pytest.raises(ConnectionError):
            listener.accept()
        assert refused.recv(1) == b""
    clients[7][1].close()
    with connected(listening), listener.accept()[0]:
        pass
    for client, accepted in clients:
        client.close()
        accepted.close()


def test_a_server_without_descriptors_hangs_up_and_goes_on(listener, listening):
    waiting = [connected(listening) for _ in range(3)]
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    free = os.dup(0)
    os.close(free)
    resource.setrlimit(resource.RLIMIT_NOFILE, (free, hard))
    try:
        for client in waiting:
            with pytest.raises(ConnectionError):
                listener.accept()
            assert client.recv(1) == b""
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    with connected(listening), listener.accept()[0]:
        pass
    for client in waiting:
        client.close()
