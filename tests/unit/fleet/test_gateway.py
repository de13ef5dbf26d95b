"""The gateway with a stand-in for its daemon: what it publishes, and after which errors."""

import contextlib
import errno
import socket
import threading

import pytest
from harness import until

from orientd import config
from orientd.errors import DaemonError
from orientd.protocol import CellReport
from orientd.protocol import control_pb2 as pb
from orientd_fleet import gateway
from orientd_fleet.client import connect_fleet
from orientd_fleet.settings import MemberSettings

pytest.importorskip("zenoh")


class Robot:
    """A client whose daemon reports one device."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def state(self):
        return CellReport(pb.DaemonReport(pid=7), {"arm": pb.DeviceReport(name="arm")})


@pytest.fixture
def daemon(tmp_path):
    """A socket that accepts connections and says nothing."""
    tmp_path.chmod(0o700)
    path = tmp_path / "control.sock"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        listener.listen(8)
        yield path


def settings(folder, **more):
    fleet = {"cell": "lab", "name": "a", "listen": [f"unixsock-stream/{folder}/a"], **more}
    table = {"fleet": fleet, "devices": {"arm": {"driver": "loopback"}}}
    return config.parse_as(MemberSettings, table, source="test")


@pytest.mark.parametrize("error", [DaemonError("it did not answer in time"), RuntimeError("bug")])
def test_states_are_published_again_after_an_error(daemon, monkeypatch, caplog, error):
    failed = []

    def connect(*_, **__):
        if not failed:
            failed.append(error)
            raise error
        return Robot()

    monkeypatch.setattr(gateway, "connect", connect)
    monkeypatch.setattr(gateway, "_AGAIN", 0.05)
    given, heard = settings(daemon.parent, state_hz=50), []
    with gateway.Gateway(given, daemon), connect_fleet(given.fleet.listen, cell="lab") as fleet:
        fleet.subscribe("state", heard.append)
        until(lambda: len(heard) > 2, "states")
    state = pb.GetStateResponse.FromString(heard[-1].payload.to_bytes())
    assert (state.daemon.pid, [one.name for one in state.devices]) == (7, ["arm"])
    assert failed
    assert str(error) in caplog.text


def test_nothing_is_asked_of_a_daemon_that_is_not_watched(daemon, monkeypatch):
    asked = threading.Event()
    monkeypatch.setattr(gateway, "connect", lambda *_, **__: asked.set())
    given = settings(daemon.parent)
    with gateway.Gateway(given, daemon), connect_fleet(given.fleet.listen, cell="lab") as fleet:
        assert fleet.daemons == ["a"]
        assert fleet.clock("a").measure(3) is not None
        assert not asked.wait(0.5)


def test_a_daemon_that_starts_is_reported_if_it_was_not_there_before(daemon):
    given, started = settings(daemon.parent), threading.Event()
    other = daemon.with_name("other.sock")
    with gateway.Gateway(given, daemon, on_start=started.set):
        assert not started.wait(0.5)
    with gateway.Gateway(given, other, on_start=started.set):
        assert not started.wait(0.5)
        daemon.rename(other)
        assert started.wait(10.0)


@pytest.fixture
def full(daemon):
    """A daemon that hangs, to which as many clients have come as the kernel lets wait."""
    with contextlib.ExitStack() as clients:
        error = None
        while not error:
            client = clients.enter_context(socket.socket(socket.AF_UNIX))
            client.setblocking(False)
            error = client.connect_ex(str(daemon))
        assert error == errno.EAGAIN
        yield daemon


def test_a_daemon_that_accepts_no_more_connections_is_present(full):
    given = settings(full.parent)
    with gateway.Gateway(given, full), connect_fleet(given.fleet.listen, cell="lab") as fleet:
        assert fleet.daemons == ["a"]
