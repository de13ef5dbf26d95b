"""Where pages are served, and who may talk to them."""

import contextlib
import json
import re
import threading
import urllib.request

import pytest

pytest.importorskip("websockets")

from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from orientd.errors import DaemonError, LeaseError
from orientd.own_socket import MOST_CLIENTS
from orientd.viewer.server import PageServer


class Source:
    """A page with one number on it."""

    def __init__(self):
        self.number, self.done, self.holding = 0, [], threading.Event()

    def picture(self, seen):
        return {"said": 0.0, "number": self.number}

    def do(self, request):
        if request["do"] == "wait":
            self.holding.wait(10.0)
        if request["do"] == "forbidden":
            raise LeaseError("take the lease first")
        self.done.append(request["do"])


@pytest.fixture
def source():
    return Source()


@pytest.fixture
def server(source):
    served = PageServer("127.0.0.1", 0, source)
    yield served
    source.holding.set()
    served.close()


def page(server, **headers):
    return connect(f"ws://127.0.0.1:{server.port}/", additional_headers=headers)


def hear(connection, key):
    """Return the first value that is sent under *key*."""
    while True:
        news = json.loads(connection.recv(timeout=10.0))
        if key in news:
            return news[key]


def test_the_page_is_one_file_and_loads_nothing_else(server):
    with urllib.request.urlopen(f"http://127.0.0.1:{server.port}/") as answer:
        content = answer.read()
    assert b"<html" in content
    assert not re.search(rb"(src|href)=|@import|https?://(?!\$)", content)


def test_a_browser_is_sent_what_has_changed_and_no_more(server, source):
    with page(server) as connection:
        assert json.loads(connection.recv(timeout=10.0)) == {"said": 0.0, "number": 0}
        source.number = 7
        assert hear(connection, "number") == 7
        assert all("number" not in json.loads(connection.recv(timeout=10.0)) for _ in range(3))


def test_a_stop_waits_for_no_other_request(server, source):
    with page(server) as connection:
        for _ in range(20):
            connection.send('{"do": "wait"}')
        connection.send('{"do": "stop"}')
        assert hear(connection, "answered") == "stop"
        assert source.done == ["stop"]


def test_a_refusal_is_told_and_nonsense_changes_nothing(server, source):
    with page(server) as connection:
        for nonsense in ("", "[]", "{}", "null", '{"do": null}', b"\xff"):
            connection.send(nonsense)
        connection.send('{"do": "forbidden"}')
        assert hear(connection, "refused") == "take the lease first"


@pytest.mark.parametrize("origin", ["https://elsewhere.example", "http://127.0.0.1:1", "null"])
def test_a_page_from_elsewhere_is_not_talked_to(server, origin):
    with pytest.raises(InvalidStatus, match="403"), page(server, Origin=origin):
        pass


def test_a_page_that_was_served_here_is_talked_to(server):
    with page(server, Origin=f"http://127.0.0.1:{server.port}") as connection:
        assert hear(connection, "number") == 0


def test_more_pages_than_a_server_may_have_are_refused(server):
    with contextlib.ExitStack() as stack:
        for _ in range(MOST_CLIENTS):
            hear(stack.enter_context(page(server)), "number")
        with pytest.raises(InvalidStatus, match="503"), page(server):
            pass


def test_an_address_of_another_machine_is_refused(source):
    with pytest.raises(DaemonError, match=re.escape("cannot serve at 192.0.2.7")):
        PageServer("192.0.2.7", 0, source)
