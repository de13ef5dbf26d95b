"""An emulated device, which outlives the servo processes that drive it, and judges every setpoint.

It differentiates what it is sent from first principles, in plain Python, and shares no code with
the guard or the planner.
"""

from __future__ import annotations

import math

from orientd.errors import DeviceFaultError, LinkError
from orientd_loopback import LoopbackDriver

TOLERANCE = 1.001

GAP_NS = 60_000_000
"""A device that is sent nothing for longer than this, three cycles, has come to rest."""


class EmulatedDevice:
    """The device behind the driver, which says of every setpoint that breaks a limit which it is.

    Attributes:
        q, position: where it stands.
        fault: what is wrong at present: ``link``, ``stale``, ``fault`` or ``write``.
        setpoints: how many were sent.
        digest: of all of them, in order.
    """

    def __init__(self, limits, period, violate):
        self.limits, self.period = limits, period
        self.q, self.position = (1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        self.fault = ""
        self.violate, self.setpoints, self.digest = violate, 0, 0
        self.peaks = dict.fromkeys(limits, 0.0)
        self._led_ns = 0
        self.stand()

    def stand(self):
        """Be at rest."""
        self._omega = self._alpha = self._velocity = (0.0, 0.0, 0.0)

    def is_led(self, now_ns):
        """Return whether a setpoint has come lately."""
        return now_ns - self._led_ns <= GAP_NS

    def is_moving(self, now_ns):
        return self.is_led(now_ns) and any(abs(x) > 1e-9 for x in (*self._omega, *self._velocity))

    def follow(self, now_ns, q, position):
        """Be at a setpoint a period later."""
        if not self.is_led(now_ns):
            self.stand()
        self._led_ns = now_ns
        period = self.period
        omega = tuple(x / period for x in turn(self.q, q))
        alpha = _rate(self._omega, omega, period)
        velocity = _rate(self.position, position, period)
        found = {
            "velocity": omega,
            "acceleration": alpha,
            "jerk": _rate(self._alpha, alpha, period),
            "linear_velocity": velocity,
            "linear_acceleration": _rate(self._velocity, velocity, period),
        }
        for name, vector in found.items():
            size = math.hypot(*vector)
            if not size <= TOLERANCE * self.limits[name]:
                self.violate(f"{name} {size:.6g}, at most {self.limits[name]:g}")
            self.peaks[name] = max(self.peaks[name], size / self.limits[name])
        self.q, self.position = q, position
        self._omega, self._alpha, self._velocity = omega, alpha, velocity
        self.setpoints += 1
        self.digest = hash((self.digest, q, position))


def _rate(before, after, period):
    return tuple((b - a) / period for a, b in zip(before, after, strict=True))


def turn(p, q):
    """Return the rotation vector from *p* to *q*, of either sign, in the frame of *p*."""
    w, x, y, z = p
    a, b, c, d = q
    scalar = w * a + x * b + y * c + z * d
    vector = (
        w * b - x * a - y * d + z * c,
        w * c - y * a - z * b + x * d,
        w * d - z * a - x * c + y * b,
    )
    if scalar < 0.0:
        scalar, vector = -scalar, tuple(-v for v in vector)
    sine = math.hypot(*vector)
    share = 2.0 * math.atan2(sine, scalar) / sine if sine > 0.0 else 2.0
    return tuple(share * v for v in vector)


class EmulatedDriver(LoopbackDriver):
    """The loopback driver, of the device that the running system says."""

    device: EmulatedDevice = None

    def _reach(self):
        if self.device.fault == "link":
            raise LinkError("injected: the link is lost")
        if self.device.fault == "fault":
            raise DeviceFaultError("injected: the device has a fault")

    def open(self):
        self._reach()
        super().open()
        self._q, self._position = self.device.q, self.device.position

    def enable(self):
        self._reach()
        self.device.stand()
        return super().enable()

    def read(self):
        self._reach()
        if self.device.fault == "stale":
            return self._newest
        return super().read()

    def write(self, setpoint):
        if self.device.fault == "write":
            raise LinkError("injected: a setpoint is not taken")
        self._reach()
        self.device.follow(self.clock.now_ns(), setpoint.q, setpoint.position)
        super().write(setpoint)
