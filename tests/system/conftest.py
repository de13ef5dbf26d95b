"""Fixtures of the tests that run the daemon."""

import pytest
from access_cell import Cell
from gimbal_bench import EmulatedGimbal


@pytest.fixture(scope="module")
def cell(open_folder):
    """Return a daemon with roles for users and certificates, while a module's tests run."""
    it = Cell(open_folder)
    with it.daemon:
        yield it


@pytest.fixture
def bus(tmp_path):
    """Return an emulated bus with the three servos of a gimbal."""
    it = EmulatedGimbal(tmp_path / "bus")
    yield it
    it.end()
