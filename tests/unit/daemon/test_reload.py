"""A reload separates settings that can change in a running daemon from those that cannot."""

import asyncio
import contextlib
import logging
import socket
import threading

import pytest

from orientd import config
from orientd.daemon.server import _Daemon, changes

TCP = {"listen": "a:1", "certificate": "/c", "key": "/k", "ca": "/a"}


def settings(**tables):
    return config.parse({"devices": {"arm": {"driver": "loopback"}}, **tables}, source="test")


def test_nothing_differs_from_itself():
    assert changes(settings(), settings()) == ([], [])


def test_roles_rates_metrics_and_the_log_change_on_the_way():
    after = settings(
        access={"users": {"0": "observer"}, "streams": 5},
        daemon={"log_level": "debug"},
        metrics={"port": 0},
    )
    can, cannot = changes(settings(), after)
    assert can == ["access.streams", "access.users.0", "daemon.log_level", "metrics"]
    assert cannot == []


def test_devices_and_addresses_need_a_restart():
    after = settings(
        devices={"arm": {"driver": "loopback", "rate_hz": 100, "limits": {"velocity": 1}}},
        daemon={"lease_seconds": 9},
        tcp=TCP,
    )
    can, cannot = changes(settings(), after)
    assert can == []
    assert cannot == [
        "daemon.lease_seconds",
        "devices.arm.limits.velocity",
        "devices.arm.rate_hz",
        "tcp",
    ]


@pytest.fixture
def daemon_of(tmp_path):
    """Make a daemon that starts nothing, of what it reads at a reload."""
    with contextlib.ExitStack() as ending:
        tmp_path.chmod(0o700)
        yield lambda reread: _Daemon(
            settings(access={"audit": str(tmp_path / "audit")}), tmp_path / "x", "", reread,
            on_ready=None, needs_devices=False, ending=ending,
        )  # fmt: skip


def test_a_reload_reads_off_the_event_loop_and_applies_all_or_nothing(daemon_of, caplog):
    """Settings whose last part fails change nothing, and the loop runs while they are read."""
    pytest.importorskip("prometheus_client")
    reading, served = threading.Event(), threading.Event()
    taken = socket.create_server(("127.0.0.1", 0))
    tables = {"access": {"keyframes": 7}, "metrics": {"port": taken.getsockname()[1]}}

    def slow():
        reading.set()
        assert served.wait(30.0), "the event loop waits for the settings"
        return settings(**tables)

    daemon = daemon_of(slow)
    before = daemon._service.keyframes

    async def test():
        reload = asyncio.create_task(daemon._apply_settings())
        while not reading.is_set():
            await asyncio.sleep(0.001)
        served.set()
        await reload

    with taken, caplog.at_level(logging.ERROR):
        asyncio.run(test())
    assert "nothing changed" in caplog.text
    assert daemon._service.keyframes == before
    asyncio.run(daemon._apply_settings())
    assert daemon._service.keyframes == 7
    daemon._telemetry.close()


def test_a_reload_applies_everything_although_its_sockets_were_removed(daemon_of, tmp_path, caplog):
    """Such as by a cleaner of old files in /tmp."""
    daemon = daemon_of(lambda: settings(access={"keyframes": 7}, daemon={"log_level": "debug"}))

    async def test():
        await daemon._listener.open(tmp_path / "x")
        (tmp_path / "x").unlink()
        (tmp_path / "x.stop").rmdir()
        await daemon._apply_settings()
        await daemon._listener.close()

    before = logging.getLogger().level
    try:
        with caplog.at_level(logging.WARNING):
            asyncio.run(test())
    finally:
        logging.getLogger().setLevel(before)
    assert daemon._service.keyframes == 7
    assert [one for one in caplog.messages if not one.startswith("reload: ")] == [
        f"{tmp_path}/x: cannot change who reaches it: No such file or directory",
        f"{tmp_path}/x.stop: the servos do not take the news of who may stop: "
        "No such file or directory",
    ]
