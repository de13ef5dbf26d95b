"""A daemon beside whose device everything hangs: eight slow devices, and the name service."""

import pwd
import sys

from harness import DaemonProcess, install_driver, until

from orientd.daemon.access import identity
from orientd.daemon.workers import Threads
from orientd.protocol import control_pb2 as pb

SLOW = tuple(f"slow{number}" for number in range(8))

_DRIVER = '''
import os, pathlib, time
from orientd_loopback import LoopbackDriver

HERE = pathlib.Path(__file__).parent

class SlowDriver(LoopbackDriver):
    """A device that takes until ``hang`` is gone to be enabled, and writes down that it does."""

    def enable(self):
        if (HERE / "hang").exists():
            (HERE / f"enabling-{os.getpid()}").touch()
        while (HERE / "hang").exists():
            time.sleep(0.01)
        super().enable()
'''

_NAME_SERVICE = """
import pwd, threading
def hang(uid):
    from orientd.daemon.access.identity import look_up
    look_up(uid + 1)  # every thread that looks names up hangs
    threading.Event().wait()

pwd.getpwuid = hang
"""


class HangingDaemon(DaemonProcess):
    """A daemon with a device that moves, eight that can be made to hang, and no name service.

    Attributes:
        hung: the commands of the slow devices that have not been answered.
    """

    def __init__(self, folder, **more):
        super().__init__(folder, **more)
        self.site = folder / "site"
        install_driver(self.site, "slow", "SlowDriver", _DRIVER)
        (self.site / "sitecustomize.py").write_text(_NAME_SERVICE)
        self.import_from(self.site)
        slow = (
            f'[devices.{name}]\ndriver = "slow"\nrate_hz = 50\nauto_enable = false\n'
            "stall_timeout = 60.0\nheartbeat_timeout = 60.0\nfeedback_timeout = 60.0\n"
            for name in SLOW
        )
        self.config.write_text(self.config.read_text() + "".join(slow))
        self.hung = []

    def share(self, monkeypatch):
        """Have the same hang in this process, to which a daemon in virtual time belongs."""
        monkeypatch.syspath_prepend(self.site)
        monkeypatch.delitem(sys.modules, "slow", raising=False)
        monkeypatch.setattr(identity, "_names", {})
        monkeypatch.setattr(identity, "LOOK_UPS", Threads(2, "look-up"))
        monkeypatch.setattr(pwd, "getpwuid", pwd.getpwuid)
        exec((self.site / "sitecustomize.py").read_text(), {})

    def hang(self):
        """Have every slow device hang in a command, once it has had a cycle."""
        until(self._have_begun, "cycles of the slow devices")
        (self.site / "hang").touch()
        for name in SLOW:
            request = pb.CommandRequest(device=name, lease_token=self.token)
            self.hung.append(self.stub.Enable.future(request))
        until(lambda: len(list(self.site.glob("enabling-*"))) == len(SLOW), "eight slow commands")

    def _have_begun(self):
        devices = self.stub.GetState(pb.GetStateRequest()).devices
        return all(device.HasField("cycle") for device in devices)

    def assert_hangs(self):
        """Check that what was begun before has not been answered."""
        assert len(self.hung) == len(SLOW)
        assert not any(one.done() for one in self.hung)

    def end(self):
        (self.site / "hang").unlink(missing_ok=True)
        return super().end()
