"""The listener over real sockets: who is let in, what is served, and who is hung up on."""

import asyncio
import contextlib
import itertools
import socket
import ssl
import time
from concurrent.futures import Future
from functools import partial

import pytest
from authority import Authority
from grpclib.client import Channel, UnaryStreamMethod, UnaryUnaryMethod
from grpclib.const import Cardinality, Status
from grpclib.exceptions import GRPCError

from orientd.config import AccessSettings, TcpSettings
from orientd.daemon.access import connection, identity, listener
from orientd.daemon.access.authorization import Authorization, Method
from orientd.daemon.access.listener import Listener
from orientd.errors import PlanError
from orientd.protocol import control_pb2 as pb

SOON = 0.2
PATH = "/orientd.v1.Control/GetState"
WATCH = "/orientd.v1.Control/WatchState"


class Audit:
    def __init__(self):
        self.records = []

    def record(self, **fields):
        self.records.append(fields)

    def refusals(self):
        return [one["text"] for one in self.records if one["event"] == "refused"]


class Daemon:
    """A service of two calls behind the listener."""

    def __init__(self, path, tcp=None, access=None):
        self.path, self.audit = path, Audit()
        self.ended = []
        methods = {
            PATH: Method("GetState", self.get, pb.GetStateRequest),
            WATCH: Method("WatchState", self.watch, pb.WatchStateRequest, Cardinality.UNARY_STREAM),
        }
        self.authorization = Authorization(
            methods,
            self.audit,
            count_call=lambda *_: None,
            most_calls=128,
        )
        self.listener = Listener(
            access or AccessSettings(), tcp, self.authorization.route, self.audit
        )

    async def get(self, request, caller):
        if request.device == "slow":
            await asyncio.sleep(60.0)
        if request.device == "refused":
            raise PlanError("no way\nat all")
        if request.device == "broken":
            raise ZeroDivisionError("a mistake")
        who = caller.identity
        device = pb.DeviceReport(name=who.role.name, fault_text=who.key)
        return pb.GetStateResponse(devices=[device])

    async def watch(self, request, caller):
        try:
            for number in itertools.count():
                yield pb.WatchStateResponse(lost=number)
                await asyncio.sleep(0.001)
        finally:
            self.ended.append("watch")

    async def __aenter__(self):
        await self.listener.open(self.path)
        return self

    async def __aexit__(self, *_):
        await self.listener.close()

    def channel(self):
        return contextlib.closing(Channel(path=str(self.path)))


def run(tmp_path, work, **more):
    async def opened():
        async with Daemon(tmp_path / "socket", **more) as daemon:
            await work(daemon)

    asyncio.run(opened())


async def get(channel, device="", timeout=10.0):
    call = UnaryUnaryMethod(channel, PATH, pb.GetStateRequest, pb.GetStateResponse)
    return await call(pb.GetStateRequest(device=device), timeout=timeout)


async def until(condition):
    async with asyncio.timeout(10.0):
        while not condition():
            await asyncio.sleep(0.005)


@pytest.mark.parametrize(
    ("device", "status", "text"),
    [
        ("refused", "FAILED_PRECONDITION", "no way"),
        ("broken", "UNKNOWN", "ZeroDivisionError('a mistake')"),
    ],
    ids=["refused", "a mistake of ours"],
)
def test_a_call_that_fails_says_why_and_the_next_one_is_served(tmp_path, device, status, text):
    async def work(daemon):
        with daemon.channel() as channel:
            with pytest.raises(GRPCError) as caught:
                await get(channel, device)
            assert (caught.value.status.name, caught.value.message) == (status, text)
            assert await get(channel)

    run(tmp_path, work)


def test_a_user_is_served_although_the_name_service_does_not_answer(tmp_path, monkeypatch):
    monkeypatch.setattr(listener, "look_up", lambda _: Future())

    async def work(daemon):
        with daemon.channel() as channel:
            answer = await get(channel, timeout=5.0)
            assert answer.devices[0].name == "ADMINISTRATOR"

    run(tmp_path, work)


def test_a_call_ends_by_its_deadline(tmp_path):
    async def work(daemon):
        with daemon.channel() as channel:
            with pytest.raises((asyncio.TimeoutError, GRPCError)):
                await get(channel, "slow", timeout=SOON)
            assert await get(channel)

    run(tmp_path, work)


@pytest.mark.parametrize("how", ["cancelled", "hung up"])
def test_a_call_ends_with_its_client(tmp_path, how):
    async def work(daemon):
        with daemon.channel() as channel:
            method = UnaryStreamMethod(channel, WATCH, pb.WatchStateRequest, pb.WatchStateResponse)
            async with method.open() as stream:
                await stream.send_message(pb.WatchStateRequest(), end=True)
                assert (await stream.recv_message()).lost == 0
                if how == "cancelled":
                    await stream.cancel()
                else:
                    channel.close()
            await until(lambda: daemon.ended)

    run(tmp_path, work)


@pytest.mark.parametrize(
    "said", [b"GET / HTTP/1.1\r\n\r\n", b"\xff" * 100, b"PRI * HTTP/2.0\r\n\r\n"]
)
def test_what_is_no_http2_is_hung_up_on(tmp_path, said, caplog):
    async def work(daemon):
        reader, writer = await asyncio.open_unix_connection(daemon.path)
        writer.write(said)
        writer.write_eof()
        with contextlib.suppress(ConnectionError):
            await asyncio.wait_for(reader.read(), 10.0)
        writer.close()
        with daemon.channel() as channel:
            assert await get(channel)

    run(tmp_path, work)
    assert "Traceback" not in caplog.text


PINGS = 20_000
SPOKEN = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0\4\0\0\0\0\0"
PING = b"\0\0\x08\6\0\0\0\0\0whatever"


def test_what_one_client_floods_is_taken_in_pieces(tmp_path, monkeypatch):
    sizes, feed = [], connection.HttpConnection.feed

    def spied(self, content):
        sizes.append(len(content))
        return feed(self, content)

    monkeypatch.setattr(connection.HttpConnection, "feed", spied)

    async def work(daemon):
        reader, writer = await asyncio.open_unix_connection(daemon.path)
        writer.write(SPOKEN + PINGS * PING)
        async with asyncio.timeout(10.0):
            for _ in range(PINGS):
                await reader.readuntil(b"whatever")
        writer.close()

    run(tmp_path, work)
    assert sum(sizes) == len(SPOKEN) + PINGS * len(PING)
    assert max(sizes) <= connection.PIECE


def test_one_piece_is_taken_in_each_turn_of_the_event_loop():
    async def work():
        turns, taken = connection.Turns(), []
        for name in "abc":
            turns.later(partial(taken.append, name))
        for count in range(1, 4):
            await asyncio.sleep(0)
            assert taken == [*"abc"][:count]

    asyncio.run(work())


def test_all_clients_take_turns_with_their_pieces(tmp_path, monkeypatch):
    shared, later = [], connection.Turns.later

    def spied(self, take):
        shared.append((self, take))
        later(self, take)

    monkeypatch.setattr(connection.Turns, "later", spied)

    async def work(daemon):
        floods = [await asyncio.open_unix_connection(daemon.path) for _ in range(3)]
        for _, writer in floods:
            writer.write(SPOKEN + PINGS // 10 * PING)
        async with asyncio.timeout(10.0):
            for reader, writer in floods:
                for _ in range(PINGS // 10):
                    await reader.readuntil(b"whatever")
                writer.close()

    run(tmp_path, work)
    assert len({turns for turns, _ in shared}) == 1
    assert len({take.__self__ for _, take in shared}) == 3


class Large:
    """A client whose requests are large; a call of the device "slow" is not answered."""

    def __init__(self, monkeypatch, channel):
        monkeypatch.setattr(connection, "LARGE", 100)
        monkeypatch.setattr(connection, "MOST_HELD", 1000)
        self.call = UnaryUnaryMethod(channel, PATH, pb.GetStateRequest, pb.GetStateResponse)

    def ask(self, device, size):
        # Fields that the daemon does not know are read and left alone.
        content = pb.GetStateRequest(device=device).SerializeToString()
        content += b"\xfa\x07" + bytes([size & 127 | 128, size >> 7]) + bytes(size)
        request = pb.GetStateRequest.FromString(content)
        return asyncio.ensure_future(self.call(request, timeout=10.0))


def test_large_requests_of_a_connection_that_wait_are_bounded(tmp_path, monkeypatch):
    async def work(daemon):
        with daemon.channel() as channel, daemon.channel() as other:
            client = Large(monkeypatch, channel)
            waiting = [client.ask("slow", 600) for _ in range(2)]
            await asyncio.sleep(SOON)
            with pytest.raises(GRPCError, match="requests over one connection wait already"):
                await client.ask("", 600)
            assert await client.ask("", 50)  # a small one, such as a stop
            assert await Large(monkeypatch, other).ask("", 600)
            for one in waiting:
                one.cancel()
            await asyncio.gather(*waiting, return_exceptions=True)
            await asyncio.sleep(SOON)
            for _ in range(3):
                assert await client.ask("", 600)

    run(tmp_path, work)


def test_between_large_messages_there_is_time_for_other_work(tmp_path, monkeypatch):
    monkeypatch.setattr(connection, "_BYTE_TAKES", 1e-4)
    served = []

    async def work(daemon):
        with contextlib.ExitStack() as stack:
            clients = [Large(monkeypatch, stack.enter_context(daemon.channel())) for _ in range(3)]

            async def ask(client, size):
                await client.ask("", size)
                served.append((size, time.monotonic()))

            await asyncio.gather(*(ask(client, 600) for client in clients), ask(clients[0], 50))

    run(tmp_path, work)
    (size, _), *large = served
    assert size < 100
    apart = [later - sooner for (_, sooner), (_, later) in itertools.pairwise(large)]
    assert min(apart) > 0.03


def test_a_client_that_never_reads_is_hung_up_on(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(connection, "MOST_UNREAD", 1 << 16)

    async def work(daemon):
        _, writer = await asyncio.open_unix_connection(daemon.path, limit=1)
        writer.write(SPOKEN + PINGS * PING)
        await until(lambda: "does not read what it asks for" in caplog.text)
        with daemon.channel() as channel:
            assert await get(channel)
        writer.close()

    run(tmp_path, work)
    assert "Traceback" not in caplog.text


def free_port():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return free.getsockname()[1]


def with_a_certificate(tmp_path):
    """Return the settings of a daemon over TCP, and how a pendant with a certificate connects."""
    authority, port = Authority(tmp_path / "ca"), free_port()
    authority.issue("server", hosts="IP:127.0.0.1")
    authority.issue("pendant")
    ca, server, pendant = (tmp_path / "ca" / name for name in ("ca.pem", "server", "pendant"))
    files = {"certificate": f"{server}.pem", "key": f"{server}.key", "ca": str(ca)}
    trust = ssl.create_default_context(cafile=ca)
    trust.load_cert_chain(f"{pendant}.pem", f"{pendant}.key")
    trust.set_alpn_protocols(["h2"])
    tcp = TcpSettings(listen=f"127.0.0.1:{port}", **files)
    return tcp, partial(Channel, "127.0.0.1", port, ssl=trust)


def test_a_reload_changes_the_role_of_an_open_connection(tmp_path):
    tcp, connect = with_a_certificate(tmp_path)
    before, after = (
        AccessSettings(certificates={"pendant": role}) for role in ("operator", "observer")
    )

    async def work(daemon):
        with contextlib.closing(connect()) as channel:
            assert (await get(channel)).devices[0].name == "OPERATOR"
            daemon.listener.change(daemon.listener.read(after, None))
            assert (await get(channel)).devices[0].name == "OBSERVER"

    run(tmp_path, work, tcp=tcp, access=before)


def test_a_certificate_that_expires_on_an_open_connection_counts_no_more(tmp_path, monkeypatch):
    tcp, connect = with_a_certificate(tmp_path)
    access = AccessSettings(certificates={"pendant": "operator"})

    async def work(daemon):
        with contextlib.closing(connect()) as channel:
            (device,) = (await get(channel)).devices
            assert device.fault_text == "certificate:pendant"
            in_ten_years = time.time() + 10.0 * 366 * 86_400
            monkeypatch.setattr(identity.time, "time", lambda: in_ten_years)
            with pytest.raises(GRPCError) as caught:
                await get(channel)
        assert caught.value.status is Status.PERMISSION_DENIED
        assert caught.value.message == "the certificate of pendant has expired"

    run(tmp_path, work, tcp=tcp, access=access)


@pytest.mark.parametrize("said", [b"", b"\x16"])
def test_a_handshake_that_is_not_done_is_given_up(tmp_path, monkeypatch, said):
    monkeypatch.setattr(listener, "HANDSHAKE_TIMEOUT", SOON)
    monkeypatch.setattr(
        listener, "server_context", lambda tcp: ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    )
    port = free_port()
    files = dict.fromkeys(("certificate", "key", "ca"), "/none")
    tcp = TcpSettings(listen=f"127.0.0.1:{port}", **files)

    async def work(daemon):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(said)
        with contextlib.suppress(ConnectionResetError):  # what was said was never read
            assert await asyncio.wait_for(reader.read(), 10.0) == b""
        writer.close()
        assert daemon.audit.refusals() == [f"handshake: not done within {SOON:g} s"]

    run(tmp_path, work, tcp=tcp)


def test_refused_looks_are_in_the_audit_log_and_others_are_not(tmp_path):
    async def work(daemon):
        with daemon.channel() as channel:
            await get(channel)
            assert not daemon.audit.records
            daemon.authorization.most_calls = 0
            with pytest.raises(GRPCError, match="at most 0 calls at the same time"):
                await get(channel)
        (record,) = daemon.audit.records
        assert (record["method"], record["outcome"]) == ("GetState", "RESOURCE_EXHAUSTED")

    run(tmp_path, work)


def test_an_idle_connection_gives_way_to_a_later_one_of_its_user_and_a_busy_one_stays(tmp_path):
    async def work(daemon):
        with daemon.channel() as busy, daemon.channel() as later:
            method = UnaryStreamMethod(busy, WATCH, pb.WatchStateRequest, pb.WatchStateResponse)
            async with method.open() as stream:
                await stream.send_message(pb.WatchStateRequest(), end=True)
                assert (await stream.recv_message()).lost == 0
                reader, writer = await asyncio.open_unix_connection(daemon.path)
                writer.write(SPOKEN)
                assert await reader.read(100)
                await get(later)
                with contextlib.suppress(ConnectionError):
                    while await asyncio.wait_for(reader.read(100), 5.0):
                        pass
                writer.close()
                assert (await stream.recv_message()).lost == 1
                await stream.cancel()
        assert not daemon.audit.refusals()

    run(tmp_path, work, access=AccessSettings(connections=2))


def test_a_handshake_gives_way_once_too_many_are_under_way(tmp_path, monkeypatch):
    monkeypatch.setattr(listener, "MOST_HANDSHAKES", 2)
    tcp, connect = with_a_certificate(tmp_path)
    access = AccessSettings(certificates={"pendant": "operator"})

    async def work(daemon):
        host, _, port = tcp.listen.rpartition(":")
        silent = [await asyncio.open_connection(host, int(port)) for _ in range(3)]
        assert await asyncio.wait_for(silent[0][0].read(), 2.0) == b""
        assert not silent[1][0].at_eof()
        with contextlib.closing(connect()) as channel:
            assert await get(channel)
        for _, writer in silent:
            writer.close()

    run(tmp_path, work, tcp=tcp, access=access)


def test_no_session_of_tls_is_resumed_past_a_newer_revocation_list(tmp_path):
    tcp, connect = with_a_certificate(tmp_path)
    trust = connect.keywords["ssl"]
    host, _, port = tcp.listen.rpartition(":")

    def shake(session=None):
        with (
            socket.create_connection((host, int(port)), timeout=10.0) as plain,
            trust.wrap_socket(plain, server_hostname=host, session=session) as secured,
        ):
            secured.sendall(SPOKEN)
            assert secured.recv(100)  # with it a ticket would have come
            return secured.session, secured.session_reused

    async def work(daemon):
        session, _ = await asyncio.to_thread(shake)
        _, is_resumed = await asyncio.to_thread(shake, session)
        assert not is_resumed

    access = AccessSettings(certificates={"pendant": "operator"})
    run(tmp_path, work, tcp=tcp, access=access)


def test_a_message_that_is_too_large_is_refused_before_it_is_read(tmp_path):
    async def work(daemon):
        with daemon.channel() as channel:
            with pytest.raises(GRPCError, match=r"too large: 200\d\d\d bytes, at most 100000"):
                await get(channel, "x" * 200_000)
            assert await get(channel)

    run(tmp_path, work, access=AccessSettings(message_bytes=100_000))
