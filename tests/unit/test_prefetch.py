"""Reading shared libraries before they are imported."""

import errno
import os
import sys

import pytest

from orientd import prefetch


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Lay a package with libraries, and one beside it, where imports look."""
    for name in ("padded/__init__.py", "padded/deep/a.cpython-311.so", "padded.libs/libb.so.5"):
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(b"#" * (3 << 20))
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    prefetch._read.discard("padded")


def is_in_memory(file):
    """Return whether every block of a file can be read without waiting for the disk."""
    descriptor = os.open(file, os.O_RDONLY)
    try:
        for offset in range(0, file.stat().st_size, 4096):
            if os.preadv(descriptor, [bytearray(4096)], offset, os.RWF_NOWAIT) < 4096:
                return False
    except OSError as error:
        if error.errno != errno.EAGAIN:
            pytest.skip(f"this file system cannot say: {error}")
        return False
    finally:
        os.close(descriptor)
    return True


def put_on_disk(file):
    descriptor = os.open(file, os.O_RDWR)
    os.fsync(descriptor)
    os.posix_fadvise(descriptor, 0, 0, os.POSIX_FADV_DONTNEED)
    os.close(descriptor)
    if is_in_memory(file):
        pytest.skip("this file system keeps everything in memory")


def test_the_libraries_are_those_inside_and_those_beside(package):
    found = {file.relative_to(package).as_posix() for file in prefetch.libraries("padded")}
    assert found == {"padded/deep/a.cpython-311.so", "padded.libs/libb.so.5"}
    assert "padded" not in sys.modules


def test_what_is_not_installed_is_left_out():
    assert list(prefetch.libraries("there_is_no_such_package")) == []
    prefetch.prefetch("there_is_no_such_package")


def test_libraries_are_in_memory_afterwards(package):
    files = list(prefetch.libraries("padded"))
    for file in files:
        put_on_disk(file)
    prefetch.prefetch("padded")
    assert all(map(is_in_memory, files))


def test_a_process_reads_them_once(package, monkeypatch):
    read = []
    monkeypatch.setattr(prefetch, "_read_through", read.append)
    prefetch.prefetch("padded")
    prefetch.prefetch("padded")
    assert len(read) == 2


def test_a_library_that_cannot_be_read_is_left_to_the_import(package):
    (package / "padded.libs/libb.so.5").unlink()
    (package / "padded.libs/libb.so.5").symlink_to("nowhere")
    prefetch.prefetch("padded")
