"""Fixtures of the tests that run the daemon."""

import pytest
from gimbal_bench import EmulatedGimbal


@pytest.fixture
def bus(tmp_path):
    """Return an emulated bus with the three servos of a gimbal."""
    it = EmulatedGimbal(tmp_path / "bus")
    yield it
    it.end()
