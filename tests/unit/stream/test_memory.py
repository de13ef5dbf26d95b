"""The memory that two processes share."""

import os
from pathlib import Path

import pytest

from orientd.stream.memory import SharedMemory


def test_memory_that_is_not_to_be_had_is_refused_at_once():
    """Rather than kill, later on, whoever touches a page that is not there."""
    with pytest.raises(OSError, match="MB are needed"):
        SharedMemory.create(1 << 40, 64)


def test_nobody_can_cut_it_short():
    memory = SharedMemory.create(64, 64)
    size = os.fstat(memory.descriptor).st_size
    for length in (0, size - 1, size + 1):
        # As another program of the same user would open it.
        with (
            Path(f"/proc/self/fd/{memory.descriptor}").open("r+b") as file,
            pytest.raises(PermissionError),
        ):
            file.truncate(length)
    assert os.fstat(memory.descriptor).st_size == size
    memory.close()
