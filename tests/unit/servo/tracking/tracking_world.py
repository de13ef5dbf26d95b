"""A tracker with the guard behind it, in virtual time, and streams of targets for it."""

from orientd.driver import ZERO
from orientd.floats import difference, exp, multiply, norm, normalize, plus
from orientd.servo.guard import Guard
from orientd.servo.keep_out_cones import KeepOutCones
from orientd.servo.tracking.law import Law
from orientd.servo.tracking.reference import Target
from orientd.servo.tracking.tracker import Tracker
from orientd.stream.records import ServoLimits

NS = 1_000_000_000
IDENTITY = (1.0, 0.0, 0.0, 0.0)


def servo_limits(velocity, acceleration, jerk):
    return ServoLimits(velocity, acceleration, jerk, 1.0, 1.0, 1.0)


def quickest_stop(q, omega, alpha, limits, period):
    """Yield setpoints that come to rest as soon as the limits allow, wherever that is."""
    law = Law(period)
    law.limit_turn(limits)
    while norm(omega) > 1e-12 or norm(alpha) * period > 1e-12:
        alpha = law.halt(omega, alpha)
        x, y, z = omega = plus(omega, alpha, period)
        q = normalize(multiply(q, exp((x * period, y * period, z * period))))
        yield q


class World:
    """Steps a tracker and lets the guard judge every setpoint."""

    def __init__(self, limits, rate_hz=500, q=IDENTITY, cones=()):
        self.period_ns = NS // rate_hz
        self.period = self.period_ns * 1e-9
        self.limits = limits
        self.now_ns = NS
        self.cones = KeepOutCones(cones, self.period, lambda: self.now_ns) if cones else None
        self.tracker = Tracker(self.period, self.cones)
        self.guard = Guard(self.period, self.cones)
        self.guard.anchor(q, ZERO)
        self.tracker.begin(q, ZERO, ZERO, limits)
        self.track = []

    @property
    def now(self):
        return self.now_ns * 1e-9

    def take(self, q, omega=None, time_ns=None, live=0.2):
        at = self.now_ns if time_ns is None else time_ns
        return self.tracker.take(Target(q, omega, at, self.now_ns + round(live * NS)), self.now_ns)

    def step(self):
        self.now_ns += self.period_ns
        point = self.tracker.step(self.now_ns)
        assert self.guard.admit(point.q, ZERO, self.limits) == ""
        return point

    def run(self, seconds):
        return [self.step() for _ in range(round(seconds / self.period))]


def angle(p, q):
    return norm(difference(p, q))
