"""Fixtures of the tests that run the daemon."""

import pytest
from access_cell import Cell
from gimbal_bench import EmulatedGimbal
from harness import DaemonProcess

from orientd.protocol import control_pb2 as pb


@pytest.fixture(scope="module")
def daemon(tmp_path_factory):
    """Return a daemon with a loopback device whose lease is free, while a module's tests run."""
    with DaemonProcess(tmp_path_factory.mktemp("daemon")) as process:
        process.stub.ReleaseLease(pb.ReleaseLeaseRequest(token=process.token))
        yield process


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
