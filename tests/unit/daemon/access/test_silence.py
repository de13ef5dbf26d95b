"""Whoever connects and says nothing, or not enough: hung up on in time, unknown to the server."""

import asyncio
import contextlib
import socket
import ssl

import pytest

from orientd.config import AccessSettings
from orientd.daemon.access import peer_credentials
from orientd.daemon.access.identity import RolePolicy
from orientd.daemon.access.peer_credentials import PeerListener

SOON = 0.2


@pytest.fixture
def refused():
    return []


@pytest.fixture
def door(refused):
    return PeerListener(
        RolePolicy(AccessSettings()),
        "",
        most_connections=5,
        refused=lambda origin, why: refused.append(why),
    )


def test_who_is_let_in_and_says_nothing_is_hung_up_on(door, refused, tmp_path, monkeypatch):
    monkeypatch.setattr(peer_credentials, "LONGEST_SILENCE", SOON)

    async def silent():
        await door.open_unix(tmp_path / "socket")
        reader, writer = await asyncio.open_unix_connection(tmp_path / "socket")
        assert await asyncio.wait_for(reader.read(), 10.0) == b""
        writer.close()
        await door.close()

    asyncio.run(silent())
    # The server, which there is none of, was never asked.
    assert refused == []


@pytest.mark.parametrize("said", [b"", b"\x16"])
def test_a_handshake_that_is_not_done_is_given_up(door, refused, monkeypatch, said):
    monkeypatch.setattr(peer_credentials, "HANDSHAKE_TIMEOUT", SOON)

    async def slow():
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        port = await door.open_tcp("127.0.0.1", 0, context)
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(said)
        with contextlib.suppress(ConnectionResetError):  # what was said was never read
            assert await asyncio.wait_for(reader.read(), 10.0) == b""
        writer.close()
        await door.close()

    asyncio.run(slow())
    assert refused == [f"handshake: not done within {SOON:g} s"]


def test_connections_are_read_in_pieces():
    """The name of what says so is asyncio's, and is not promised to stay."""

    async def sizes():
        ours, theirs = socket.socketpair()
        theirs.setblocking(False)
        reader, writer = await asyncio.open_connection(sock=ours, limit=2**20)
        found, feed = [], reader.feed_data
        reader.feed_data = lambda content: (found.append(len(content)), feed(content))
        nothing = asyncio.StreamReader()
        nothing.feed_eof()
        await peer_credentials._pour(nothing, writer)
        await asyncio.get_running_loop().sock_sendall(theirs, bytes(100_000))
        theirs.close()
        await reader.read()
        writer.close()
        return found

    found = asyncio.run(sizes())
    assert sum(found) == 100_000
    assert max(found) <= 32 * 1024
