"""An emulated device behind a link with faults; it outlives the servo processes that drive it."""

from __future__ import annotations

from judge import Judge

from orientd.errors import DeviceFaultError, LinkError
from orientd_loopback import LoopbackDriver


class EmulatedDevice:
    """The device behind the driver; a judge looks at every setpoint.

    Attributes:
        q, position: where it stands.
        judge: of its setpoints.
        fault: what is wrong at present: ``link``, ``stale``, ``fault``, ``write``, ``loss`` of half
            of the feedback, or ``reset``, once.
        delay_ns: of feedback on the link.

    Args:
        limits, period, violate: of the judge.
        chance: decides which feedback is lost.
        note: takes every setpoint.
    """

    def __init__(self, limits, period, violate, chance, note):
        self.judge, self.chance, self._note = Judge(limits, period, violate), chance, note
        self.q, self.position = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        self.fault, self.delay_ns = "", 0

    def follow(self, now_ns, q, position):
        """Be at a setpoint a period later."""
        self.judge.take(now_ns, q, position)
        self.q, self.position = q, position
        self._note("setpoint", q, position)


class EmulatedDriver(LoopbackDriver):
    """The loopback driver, of the device that the running system says."""

    device: EmulatedDevice = None

    def _reach(self):
        fault = self.device.fault
        if fault in ("link", "reset", "fault"):
            self.device.judge.fail(self.clock.now_ns())
        if fault == "link":
            raise LinkError("injected: the link is lost")
        if fault == "reset":
            self.device.fault = ""
            raise LinkError("injected: connection reset by peer")
        if fault == "fault":
            raise DeviceFaultError("injected: the device has a fault")

    def open(self):
        self._reach()
        super().open()
        self._q, self._position = self.device.q, self.device.position
        self._on_the_way = []

    def enable(self):
        self._reach()
        self.device.judge.anchor(self.device.q, self.device.position)
        return super().enable()

    def disable(self):
        self.device.judge.let_go(self.clock.now_ns())
        super().disable()

    def read(self):
        """Return the newest feedback that the link has passed on."""
        self._reach()
        before = self._newest
        if self.device.fault == "stale":
            return before
        if self.device.fault == "loss" and self.device.chance.random() < 0.5:
            return before
        feedback = super().read()
        if not self.device.delay_ns:
            self._on_the_way.clear()
            return feedback
        self._on_the_way.append((self.clock.now_ns() + self.device.delay_ns, feedback))
        arrived = before
        while self._on_the_way and self._on_the_way[0][0] <= self.clock.now_ns():
            arrived = self._on_the_way.pop(0)[1]
        return arrived

    def write(self, setpoint):
        if self.device.fault == "write":
            self.device.judge.fail(self.clock.now_ns())
            raise LinkError("injected: a setpoint is not taken")
        self._reach()
        self.device.follow(self.clock.now_ns(), setpoint.q, setpoint.position)
        super().write(setpoint)
