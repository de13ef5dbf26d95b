"""Files that are none, or have no end: refused at once and with little memory."""

import contextlib
import os
import threading

import pytest

from orientd import files
from orientd.files import read_bounded


def test_a_device_without_end_is_refused(tmp_path):
    link = tmp_path / "motion.yaml"
    link.symlink_to("/dev/zero")
    with pytest.raises(OSError, match="not a regular file"):
        read_bounded(link, 1000)


def test_a_file_may_be_as_large_as_is_said_and_no_larger(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"x" * 1000)
    assert len(read_bounded(path, 1000)) == 1000
    with pytest.raises(OSError, match="expected at most"):
        read_bounded(path, 999)


def test_a_pipe_that_nobody_writes_to_is_given_up(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "SILENCE", 0.05)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(OSError, match="nothing came through"):
        read_bounded(tmp_path / "pipe", 1000)


@pytest.mark.parametrize(("count", "is_read"), [(200_000, True), (200_001, False)])
def test_a_pipe_is_read_to_its_end_or_to_the_most_that_is_taken(tmp_path, count, is_read):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)

    def write():
        with contextlib.suppress(BrokenPipeError):
            pipe.write_bytes(b"x" * count)

    thread = threading.Thread(target=write)
    thread.start()
    if is_read:
        assert read_bounded(pipe, 200_000) == b"x" * count
    else:
        with pytest.raises(OSError, match="got more"):
            read_bounded(pipe, 200_000)
    thread.join()
