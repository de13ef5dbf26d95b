"""Files that are written whole or not at all, on a disk that has no room for them."""

import os
import resource
import threading

import pytest

from orientd.errors import OrientdError
from orientd.files import written
from orientd.structured_text import write_structured

MAPPING = {"keyframes": [{"name": "pose" * 2000}]}


@pytest.fixture
def no_room():
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_what_was_there_stays_where_there_is_no_room_for_what_takes_its_place(tmp_path, no_room):
    file = tmp_path / "taught.yaml"
    file.write_text("before")
    with pytest.raises(OrientdError, match=r"cannot write .*: File too large"):
        write_structured(file, MAPPING)
    assert file.read_text() == "before"
    assert list(tmp_path.iterdir()) == [file]


def test_a_link_still_leads_to_the_file_that_is_written(tmp_path):
    file, link = tmp_path / "file.yaml", tmp_path / "link.yaml"
    link.symlink_to(file)
    write_structured(link, MAPPING)
    assert link.is_symlink()
    assert file.read_text() == link.read_text() != ""


def test_a_pipe_is_written_to(tmp_path):
    pipe, heard = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: heard.append(pipe.read_text()))
    reader.start()
    with written(pipe) as file:
        file.write_text("said")
    reader.join()
    assert heard == ["said"]
    assert pipe.is_fifo()
