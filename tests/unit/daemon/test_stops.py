"""The folder of the stop sockets: what the daemon removes there, and what it leaves alone."""

import contextlib
import json
import os
import socket

import pytest

from orientd.config import AccessSettings
from orientd.daemon.access.identity import RolePolicy
from orientd.daemon.stops import StopFolder
from orientd.errors import DaemonError
from orientd.stream.records import Stop


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "robot.stop"


def made(folder):
    control = folder.with_suffix("")
    return StopFolder(control, RolePolicy(AccessSettings()), record=lambda **_: None)


def left_behind(path):
    """Make a stop socket that nobody listens at, as a killed servo leaves it."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as servo:
        servo.bind(str(path))


def test_repeated_stops_of_one_process_are_one_line_with_their_number(folder, caplog):
    caplog.set_level("INFO")
    records = []
    stop_folder = StopFolder(
        folder.with_suffix(""),
        RolePolicy(AccessSettings()),
        record=lambda **one: records.append(one),
    )
    stops = [Stop(index, False, 7, os.getuid(), os.getgid()) for index in range(3)]
    who = stop_folder.log_stops("arm", stops)
    assert [(one["devices"], one["kind"], one["times"]) for one in records] == [
        (["arm"], "stop", 3)
    ]
    assert caplog.messages[-1] == f"arm: stop by {who}, 3 times"


@pytest.mark.parametrize("name", ["thesis.txt", "papers/thesis.txt"])
def test_a_folder_of_the_user_is_left_alone(folder, name):
    thesis = folder / name
    thesis.parent.mkdir(parents=True)
    thesis.write_text("precious")
    left_behind(folder / "arm")
    what = name.partition("/")[0]
    reason = rf"{folder} holds '{what}', which is no stop socket: move it away, or choose another"
    with pytest.raises(DaemonError, match=reason):
        made(folder)
    assert thesis.read_text() == "precious"
    assert (folder / "arm").exists()


def test_a_file_of_the_user_is_left_alone(folder):
    folder.write_text("precious")
    with pytest.raises(DaemonError, match=rf"{folder} is no folder of stop sockets: move it away"):
        made(folder)
    assert folder.read_text() == "precious"


def test_a_link_to_a_folder_of_the_user_is_left_alone(folder, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    folder.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(DaemonError, match="is no folder of stop sockets"):
        made(folder)
    assert folder.is_symlink()
    assert (tmp_path / "elsewhere").is_dir()


def test_a_servo_that_does_not_take_the_news_of_who_may_stop_is_named(folder, caplog):
    stops = made(folder)
    left_behind(folder / "ended")
    with (
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as servo,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sending,
    ):
        servo.bind(str(folder / "arm"))
        stops.admit(RolePolicy(AccessSettings()))
        assert servo.recv(16_384).startswith(b"admit ")
        assert not caplog.messages
        sending.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while True:
                sending.sendto(b"hello", str(folder / "arm"))
        stops.admit(RolePolicy(AccessSettings()))
    (warning,) = caplog.messages
    assert warning.startswith("arm: the servo does not take the news")


def test_a_reload_tells_every_servo_who_may_stop_and_opens_the_folder_to_them(folder):
    stops = made(folder)
    other = os.getuid() + 1
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as servo:
        servo.bind(stops.path("arm"))
        servo.settimeout(10.0)
        assert str(other) not in json.dumps(stops.admitted)
        for role, mode in (("operator", 0o755), (None, 0o700)):
            users = {str(other): role} if role else {}
            stops.admit(RolePolicy(AccessSettings(users=users)))
            word, _, tables = servo.recv(10_000).partition(b" ")
            assert (word, json.loads(tables)) == (b"admit", stops.admitted)
            assert (str(other) in tables.decode()) == bool(role)
            assert folder.stat().st_mode & 0o777 == mode
    stops.close()
