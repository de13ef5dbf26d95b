"""A driver of one's own, with its test, in one file: python -m pytest own_driver.py.

The device is a text file.  For the daemon to find it: docs/how-to/write-a-driver.md.
"""

from typing import ClassVar

from orientd.driver import IDENTITY, ZERO, Driver, Feedback, check_names
from orientd.errors import LinkError
from orientd.testing import DriverConformance


class LinesDriver(Driver):
    """Write each setpoint as a line, and report it as reached."""

    name: ClassVar[str] = "lines"

    def __init__(self, options, *, period_ns, clock):
        super().__init__(options, period_ns=period_ns, clock=clock)
        check_names(options, ("path",))
        self._file = self._newest = None

    def open(self):
        """Open the file."""
        try:
            self._file = open(self.options["path"], "a", buffering=1)
        except OSError as error:
            raise LinkError(f"cannot write to {self.options['path']}: {error}") from error

    def enable(self):
        """Hold the last pose."""
        before = self._newest or Feedback(0, IDENTITY, ZERO, ZERO)
        self._newest = Feedback(self.clock.now_ns(), before.q, ZERO, before.position)
        return self._newest

    def read(self):
        """Return what was written last."""
        return self._newest

    def write(self, setpoint):
        """Write a line: w, x, y, z."""
        self._file.write(" ".join(f"{part:.9f}" for part in setpoint.q) + "\n")
        now = self.clock.now_ns()
        self._newest = Feedback(now, setpoint.q, setpoint.omega_body, setpoint.position)

    def disable(self):
        """Hold the pose."""

    def close(self):
        """Close the file, if it is open."""
        if self._file is not None:
            self._file.close()


class TestLinesDriver(DriverConformance):
    """What the servo relies on."""

    def make_driver(self):  # noqa: D102
        return LinesDriver({"path": "/dev/null"}, period_ns=2_000_000, clock=self.clock)
