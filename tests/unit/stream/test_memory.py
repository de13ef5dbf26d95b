"""The memory that two processes share."""

import pytest

from orientd.stream import SharedMemory


def test_memory_that_is_not_to_be_had_is_refused_at_once():
    """Rather than kill, later on, whoever touches a page that is not there."""
    with pytest.raises(OSError, match="MB are needed"):
        SharedMemory.create(1 << 40, 64)
