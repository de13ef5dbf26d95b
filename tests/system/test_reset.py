"""A reset of a device that has lost its link, or that was moved by hand before its fault."""

import sys

import pytest
from harness import DaemonProcess, install_driver, until

from orientd.protocol import control_pb2 as pb

pytestmark = pytest.mark.world

_DRIVER = '''
import pathlib, time
from orientd.errors import DeviceFaultError, SpentLinkError
from orientd_loopback import LoopbackDriver

HERE = pathlib.Path(__file__).parent

class FragileDriver(LoopbackDriver):
    """A device that loses its link, or is in a fault, while a file says so; it ends slowly."""

    def read(self):
        if (HERE / "link").exists():
            raise SpentLinkError("the link is gone for good")
        if (HERE / "fault").exists():
            raise DeviceFaultError("a button was pressed")
        return super().read()

    def free(self):
        """Let it be moved by hand."""

    def close(self):
        time.sleep(0.15)
        super().close()
'''


@pytest.fixture
def site(tmp_path, monkeypatch):
    """Return a folder with the driver, from which a daemon in this process imports as well."""
    folder = tmp_path / "site"
    install_driver(folder, "fragile", "FragileDriver", _DRIVER)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.delitem(sys.modules, "fragile", raising=False)
    return folder


@pytest.fixture
def daemon(tmp_path, site):
    it = DaemonProcess(tmp_path)
    driver = 'driver = "fragile"\nauto_enable = false'
    text = it.config.read_text().replace('driver = "loopback"', driver)
    it.config.write_text(text)
    it.import_from(site)
    with it:
        yield it


def reset(daemon):
    return daemon.stub.Reset(pb.CommandRequest(lease_token=daemon.token)).device


def until_fault(daemon, fault):
    until(lambda: daemon.device().fault == fault, "the fault")


def test_a_reset_that_meets_a_servo_on_its_way_out_starts_another_one(daemon, site):
    servo = daemon.device().servo_pid
    (site / "link").touch()
    until_fault(daemon, pb.FAULT_LINK_LOST)
    (site / "link").unlink()
    assert reset(daemon).state == pb.STATE_IDLE
    assert daemon.device().servo_pid != servo


def test_a_device_that_was_reset_is_not_moved_by_hand_any_more(daemon, site):
    request = pb.DisableRequest(lease_token=daemon.token, by_hand=True)
    assert daemon.stub.Disable(request).device.is_free
    (site / "fault").touch()
    until_fault(daemon, pb.FAULT_DEVICE_FAULT)
    (site / "fault").unlink()
    assert reset(daemon).state == pb.STATE_IDLE
    assert not daemon.device().is_free
