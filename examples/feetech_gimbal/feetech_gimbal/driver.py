"""A gimbal on Feetech STS servos, behind orientd's driver contract."""

import math
import os
import select
import termios
import time
import tty

from feetech_gimbal import packets
from feetech_gimbal.packets import ALL, PRESENT, PRESENT_BYTES, TORQUE, value
from orientd.driver import AxisGap, AxisLimits, Driver, Feedback, PartHealth, check_names, number
from orientd.errors import AxisFaultError, LinkError
from orientd.mechanism import Gimbal

TICK, CENTRE = math.tau / 4096, 2048
_ANSWER_S = 1.0
_TOLERANCE = math.radians(1.0)
_LIMITS = {"limit_deg": 170.0, "velocity_deg": 180.0, "acceleration_deg": 2000.0}


class FeetechGimbal(Driver):
    """Two or three servos at 1 Mbps that are sent the planned angles of their axes."""

    name = "feetech"
    default_rate_hz = 100.0
    takes = "joints"

    def __init__(self, options, *, period_ns, clock):
        super().__init__(options, period_ns=period_ns, clock=clock)
        check_names(options, ("port", "order", "axes"))
        self.longest_call = 0.2e-9 * period_ns
        self._port = options.get("port", "/dev/ttyUSB0")
        limits, self._ids = [], []
        for axis in options["axes"]:
            check_names(axis, ("id", "name", *_LIMITS), "axes.")
            self._ids.append(int(number("axes.id", axis["id"], 0, ALL - 1)))
            given = (number(f"axes.{key}", axis.get(key, _LIMITS[key]), 1.0) for key in _LIMITS)
            most, speed, push = map(math.radians, given)
            limits.append(AxisLimits(axis["name"], -most, most, speed, push))
        self._gimbal = Gimbal(limits, order=options.get("order", "ZYX"))
        self._file, self._answers = -1, packets.Answers()
        self._newest, self._sent, self._parts, self._seen = None, (), [], {}
        self._is_enabled, self._is_asked, self._asked_ns = False, False, 0

    def mechanism(self, *, may_ask):  # noqa: ARG002 - the options say enough
        """Return the gimbal, with which motions are planned and stopped."""
        return self._gimbal

    def open(self):
        """Open the port and find every servo."""
        try:
            self._file = os.open(self._port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            tty.setraw(self._file)
            mode = termios.tcgetattr(self._file)
            mode[4] = mode[5] = termios.B1000000
            termios.tcsetattr(self._file, termios.TCSANOW, mode)
        except (OSError, termios.error) as error:
            raise LinkError(f"cannot open {self._port}: {error}") from error
        for servo in self._ids:
            self._ask(servo, packets.PING)

    def enable(self):
        """Switch the torque on where the servos stand."""
        self._asked_ns = self.clock.now_ns()
        for servo in self._ids:
            self._seen[servo] = self._ask(servo, packets.READ, PRESENT, PRESENT_BYTES)
        self._newest = self._report()
        self._goto(self._newest.joints)
        for servo in self._ids:
            self._ask(servo, packets.WRITE, TORQUE, 1)
        self._is_enabled = True
        return self._newest

    def read(self):
        """Take in the answers to the last request; an axis that reports an error is a fault."""
        for status in self._arrived():
            if status.id in self._ids and len(status.content) == PRESENT_BYTES:
                self._seen[status.id] = status
        if self._is_asked and len(self._seen) == len(self._ids):
            self._newest = self._report()
            for one in self._seen.values():
                if one.error and self._is_enabled:
                    raise AxisFaultError(f"servo {one.id}: {one.problem()}")
        if not self._is_enabled:
            self._request()
        return self._newest

    def write(self, setpoint):
        """Send the angles of the axes, then ask where they are."""
        self._goto(setpoint.joints)
        self._request()

    def disable(self):
        """Hold where it was sent last."""
        self._is_enabled = False

    def close(self):
        """Close the port; the servos go on holding."""
        self._is_enabled = False
        if self._file >= 0:
            os.close(self._file)
        self._file, self._is_asked = -1, False

    # What is optional

    def reset(self):
        """Open the port anew; enabling then switches the torque on again."""
        self.close()
        self.open()

    def free(self):
        """Switch the torque off."""
        for servo in self._ids:
            self._ask(servo, packets.WRITE, TORQUE, 0)

    park = free

    def gaps(self):
        """Return how far each axis is from where it was sent."""
        axes = zip(self._gimbal.axes, self._sent, self._newest.joints, strict=True)
        return [AxisGap(axis.name, goal - at, _TOLERANCE) for axis, goal, at in axes]

    def health(self):
        """Return voltage and temperature of each servo."""
        parts = zip(self._gimbal.axes, self._parts, strict=bool(self._parts))
        when = self._newest.time_ns if self._newest else 0
        return [PartHealth(axis.name, when, 0.1 * part[6], part[7]) for axis, part in parts]

    def notices(self):
        """Return nothing."""
        return ()

    # Parts

    def _report(self):
        """Return what all servos have answered as feedback."""
        self._is_asked = False
        self._parts = [self._seen[servo].content for servo in self._ids]
        joints = tuple(TICK * (value(part[0:2]) - CENTRE) for part in self._parts)
        rates = [TICK * value(part[2:4]) for part in self._parts]
        omega = self._gimbal.kinematics.omega_body(joints, rates)
        return Feedback(self._asked_ns, self._gimbal.forward(joints)[0], omega, joints=joints)

    def _goto(self, joints):
        self._sent = joints
        ticks = (CENTRE + round(angle / TICK) for angle in joints)
        self._send(packets.goals(dict(zip(self._ids, ticks, strict=True))))

    def _request(self):
        """Ask all servos where they are, unless they still answer: there is one wire for both."""
        now_ns = self.clock.now_ns()
        if not self._is_asked or now_ns - self._asked_ns > 3 * self.period_ns:
            self._is_asked, self._asked_ns, self._seen = True, now_ns, {}
            self._send(packets.packet(ALL, packets.SYNC_READ, PRESENT, PRESENT_BYTES, *self._ids))

    def _ask(self, servo, instruction, *parameters):
        """Return a servo's answer, for which this waits; not for use in a cycle."""
        size = PRESENT_BYTES if instruction == packets.READ else 0
        for _ in range(3):
            self._send(packets.packet(servo, instruction, *parameters))
            ends = time.monotonic() + _ANSWER_S
            while (left := ends - time.monotonic()) > 0.0:
                select.select([self._file], [], [], left)
                for status in self._arrived():
                    if status.id == servo and len(status.content) == size:
                        return status
        raise LinkError(f"servo {servo} at {self._port} does not answer")

    def _arrived(self):
        try:
            return self._answers.take(os.read(self._file, 4096))
        except BlockingIOError:
            return []
        except OSError as error:
            raise LinkError(f"{self._port} is gone: {error}") from error

    def _send(self, content):
        try:
            os.write(self._file, content)
        except OSError as error:
            raise LinkError(f"{self._port} is gone: {error}") from error
