"""A screen without a monitor, and the widgets of the programs on it, by their names.

Widgets are found and pressed over AT-SPI, the interface of screen readers.  So a test needs no
coordinates, no fonts and no window manager.
"""

import contextlib
import shutil
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from harness import until
from jeepney import DBusAddress, DBusErrorResponse, Properties, new_method_call
from jeepney.io.blocking import open_dbus_connection
from jeepney.wrappers import unwrap_msg

PROGRAMS = ("Xvfb", "dbus-daemon", "xdotool")
SERVICE = Path("/usr/share/dbus-1/services/org.a11y.Bus.service")
"""Of the package at-spi2-core."""
ROOT = ("org.a11y.atspi.Registry", "/org/a11y/atspi/accessible/root")


def missing(*programs):
    """Return what of a desktop, and of the programs on it, is not installed."""
    found = [name for name in (*programs, *PROGRAMS) if shutil.which(name) is None]
    return found if SERVICE.exists() else [*found, "at-spi2-core"]


class Desktop:
    """An X server and a message bus for programs with windows; a context manager.

    Attributes:
        environment: of the programs that run on it.
    """

    def __init__(self, home):
        """*home* is an empty folder, the home of the programs."""
        self.environment = {"HOME": str(home), "XDG_RUNTIME_DIR": str(home), "LANG": "C.UTF-8",
                            "PATH": "/usr/bin:/bin", "GDK_BACKEND": "x11"}  # fmt: skip
        self._begun, self._opened = [], contextlib.ExitStack()

    def __enter__(self):
        try:
            number = self._begin("Xvfb", "-displayfd", "1", "-screen", "0", "1000x900x24",
                                 "-nolisten", "tcp", "-noreset")  # fmt: skip
            self.environment["DISPLAY"] = f":{number}"
            bus = self._begin("dbus-daemon", "--session", "--nofork", "--print-address")
            self.environment["DBUS_SESSION_BUS_ADDRESS"] = bus
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        self._opened.close()
        for process in reversed(self._begun):
            process.terminate()
            process.communicate()

    def _begin(self, *command):
        """Start a server and return the line that tells where it serves."""
        process = subprocess.Popen(command, env=self.environment, text=True,
                                   stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)  # fmt: skip
        self._begun.append(process)
        line = process.stdout.readline().strip()
        assert line, f"{command[0]} did not start"
        return line

    def picture(self, path):
        """Save a picture of the screen, if ImageMagick is there."""
        if shutil.which("import"):
            subprocess.run(["import", "-window", "root", path], env=self.environment, check=True)

    def click(self, widget):
        """Press a widget with the mouse."""
        place = map(str, widget.middle())
        subprocess.run(["xdotool", "mousemove", "--sync", *place, "click", "1"],
                       env=self.environment, check=True)  # fmt: skip

    def widgets(self):
        """Return the widgets of all programs, as a screen reader reaches them."""
        with open_dbus_connection(self.environment["DBUS_SESSION_BUS_ADDRESS"]) as session:
            ask = DBusAddress("/org/a11y/bus", "org.a11y.Bus", "org.a11y.Bus")
            (bus,) = unwrap_msg(session.send_and_get_reply(new_method_call(ask, "GetAddress")))
        return Widget(self._opened.enter_context(open_dbus_connection(bus)), *ROOT)


@dataclass(frozen=True)
class Widget:
    """A widget of a program, and those inside it."""

    connection: object
    program: str
    path: str

    def _ask(self, interface, method, *arguments):
        address = DBusAddress(self.path, self.program, f"org.a11y.atspi.{interface}")
        call = new_method_call(address, method, *arguments)
        return unwrap_msg(self.connection.send_and_get_reply(call, timeout=30.0))

    def name(self):
        """Return its label."""
        address = DBusAddress(self.path, self.program, "org.a11y.atspi.Accessible")
        call = Properties(address).get("Name")
        return unwrap_msg(self.connection.send_and_get_reply(call, timeout=30.0))[0][1]

    def role(self):
        """Return what it is: ``"push button"``."""
        return self._ask("Accessible", "GetRoleName")[0]

    def inside(self) -> Iterator["Widget"]:
        """Yield this widget and all inside it, from the top of the screen to its bottom."""
        yield self
        for program, path in self._ask("Accessible", "GetChildren")[0]:
            yield from Widget(self.connection, program, path).inside()

    def find(self, role, name=""):
        """Return the first widget inside of a role and a name; wait for it."""

        def found():
            try:
                return next(
                    one for one in self.inside() if (one.role(), one.name()) == (role, name)
                )
            except (DBusErrorResponse, StopIteration):  # a widget can go while it is looked at
                time.sleep(0.1)

        return until(found, f"{role} {name!r}")

    def middle(self):
        """Return the place of its middle on the screen, pixels."""
        ((left, top, width, height),) = self._ask("Component", "GetExtents", "u", (0,))
        return left + width // 2, top + height // 2
