"""Where pages are served, and who may talk to them."""

import re
import socket

import pytest

pytest.importorskip("viser")

import viser
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from orientd.errors import DaemonError
from orientd.viewer import web


@pytest.fixture(scope="module")
def server():
    served = web.serve("127.0.0.1", 0)
    served.scene.add_frame("/something")
    yield served
    web.stop(served)


def greeting(server, **headers):
    """What the server says first to a connection with such headers; ``None`` for nothing."""
    protocol = f"viser-v{viser.__version__}"
    url = f"ws://127.0.0.1:{server.get_port()}"
    with connect(url, subprotocols=[protocol], additional_headers=headers) as connection:
        try:
            return connection.recv(timeout=5.0)
        except ConnectionClosed:
            return None


def test_a_page_that_was_served_here_is_talked_to(server):
    assert greeting(server, Origin=f"http://127.0.0.1:{server.get_port()}")


def test_what_is_no_browser_is_talked_to(server):
    assert greeting(server)


def test_a_page_from_elsewhere_is_not_talked_to(server):
    assert greeting(server, Origin="https://elsewhere.example") is None


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
    headers = {"Host": host} if origin is None else {"Host": host, "Origin": origin}
    assert web.is_own_page(headers, is_local=is_local) is is_own


def test_a_port_in_use_is_refused_and_no_other_taken():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(DaemonError, match=f"port {port} is in use"):
            web.serve("127.0.0.1", port)


def test_an_address_of_another_machine_is_refused():
    with pytest.raises(DaemonError, match=re.escape("cannot serve at 192.0.2.7")):
        web.serve("192.0.2.7", 0)


def test_nothing_is_said_on_standard_output(capsys):
    web.stop(web.serve("127.0.0.1", 0))
    assert capsys.readouterr().out == ""


def test_the_share_button_shares_nothing(server):
    from viser import _messages

    assert _messages.ShareUrlRequest not in server._websock_server._incoming_handlers
