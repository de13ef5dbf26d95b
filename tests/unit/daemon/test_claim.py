"""One daemon for each socket."""

import contextlib
import socket
import stat

import pytest

from orientd.daemon.access.claim import claimed
from orientd.errors import DaemonError


@pytest.fixture
def path(tmp_path):
    return tmp_path / "runtime" / "control.sock"


def left_behind(path):
    """Make a socket that nobody listens at, as a killed daemon leaves it."""
    path.parent.mkdir(exist_ok=True)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))


def test_the_directory_is_for_its_owner_only(path):
    with claimed(path):
        assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700


def test_a_directory_that_everybody_can_write_is_refused(path):
    path.parent.mkdir()
    path.parent.chmod(0o777)
    with pytest.raises(DaemonError, match=r"^others can write .*: chmod o-w"), claimed(path):
        pass
    assert list(path.parent.iterdir()) == []


def test_a_stale_socket_is_removed(path):
    left_behind(path)
    with claimed(path):
        assert not path.exists()


def test_a_socket_that_somebody_else_listens_at_is_left_alone(path):
    path.parent.mkdir()
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))
        server.listen()
        with pytest.raises(DaemonError, match="another program listens there"), claimed(path):
            pass
        assert path.exists()


def test_a_socket_with_a_full_backlog_is_left_alone(path):
    path.parent.mkdir()
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(socket.socket(socket.AF_UNIX))
        server.bind(str(path))
        server.listen(0)
        with contextlib.suppress(BlockingIOError):
            while True:
                waiting = stack.enter_context(socket.socket(socket.AF_UNIX))
                waiting.setblocking(False)
                waiting.connect(str(path))
        with pytest.raises(DaemonError, match="another program listens there"), claimed(path):
            pass
        assert path.exists()


@pytest.mark.parametrize("content", ["precious", "content-hash = 12\n"])
def test_a_file_that_is_no_lock_is_left_alone(path, content):
    path.parent.mkdir()
    mine = path.with_name("control.sock.lock")
    mine.write_text(content)
    with pytest.raises(DaemonError, match="is no lock of a daemon: move it away"), claimed(path):
        pass
    assert mine.read_text() == content


def test_a_directory_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with (
        pytest.raises(DaemonError, match=r"cannot make .*: (Not a directory|File exists)"),
        claimed(tmp_path / "file" / "control.sock"),
    ):
        pass
