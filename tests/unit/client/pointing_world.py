"""A session that points, in virtual time: its targets go to a tracker, and the guard judges it."""

import heapq
import itertools
import json
import random
from math import pi
from types import SimpleNamespace
from unittest import mock

from tracking_world import NS, World, angle, servo_limits

from orientd.client.pointing import Pointing
from orientd.driver import IDENTITY, ZERO
from orientd.floats import conjugate, difference, exp, multiply, norm, rotate_back
from orientd.protocol import control_pb2 as pb
from orientd.protocol import quaternion
from orientd.protocol.targets import target_from_message
from orientd.rotation import Quaternion

LIMITS = servo_limits(2.5, 17.0, 8500.0)
GIMBAL = servo_limits(1.5, 8.0, 1500.0)
LATE, JITTER = 0.02, 0.005
FPS = 60


class Session(Pointing):
    """A session whose targets a tracker follows, some milliseconds later."""

    def __init__(self, limits=LIMITS, rate_hz=500, frames=None, transport=0.003, q=IDENTITY):
        stub = SimpleNamespace(GetConfiguration=None)
        content = json.dumps({"devices": {"gimbal": {"frames": frames or {}}}})
        answer = pb.GetConfigurationResponse(json=content)
        super().__init__(SimpleNamespace(stub=stub, ask=lambda *_: answer), "")
        self.world = World(limits, rate_hz, q)
        self.sent, self._order = [], itertools.count()
        self._events, self._late_ns = [], round(transport * NS)

    @property
    def report(self):
        return pb.TrackResponse(q=quaternion(self.world.guard.q))

    @property
    def now_ns(self):
        return self.world.now_ns

    def hand_over(self, message):
        self.sent.append(message)
        self.at(self.now_ns + self._late_ns, lambda: self._follow(message))

    def _follow(self, message):
        q, omega, time_ns, expires_ns, _ = target_from_message(message, self.now_ns)
        problem = self.world.take(q, omega, time_ns, (expires_ns - self.now_ns) / NS)
        assert problem == ""

    def clock(self):
        """Have the session read the time of this world."""
        return mock.patch("orientd.client.pointing.time", monotonic_ns=lambda: self.now_ns)

    def now(self, call):
        """Call something now, and return its result."""
        with self.clock():
            return call()

    def at(self, time_ns, call):
        """Call something at an instant."""
        heapq.heappush(self._events, (time_ns, next(self._order), call))

    def run(self, seconds, look=lambda point: None):
        """Run all calls and cycles of some seconds."""
        end_ns = self.now_ns + round(seconds * NS)
        with self.clock():
            while self.now_ns < end_ns:
                while self._events and self._events[0][0] <= self.now_ns:
                    heapq.heappop(self._events)[2]()
                look(self.world.step())

    def stream(self, seconds, call, *, fps=FPS, late=LATE, jitter=JITTER, loss=0.0, seed=1):
        """Have *call* get samples of t (s) with their stamps, late, for some seconds."""
        rng, start_ns = random.Random(seed), self.now_ns
        for k in range(round(seconds * fps)):
            t = k / fps
            arrives = t + late + rng.uniform(0.0, jitter)
            if rng.random() >= loss:
                stamp_ns = start_ns + round(t * NS)
                self.at(start_ns + round(arrives * NS), lambda t=t, s=stamp_ns: call(t, s))


def amplitude(hz, limits, share=0.6):
    """Return that of a sine whose rates take a share of the limits, rad; 0.7 at most."""
    w = 2.0 * pi * hz
    return min(share * limits.velocity / w, share * limits.acceleration / w**2, 0.7)


def rate_of(q_of, t, d=1e-5):
    """Return the angular velocity of a motion in its own frame, rad/s."""
    return tuple(x / (2.0 * d) for x in difference(q_of(t - d), q_of(t + d)))


def as_user(q):
    w, x, y, z = q
    return Quaternion(w=w, x=x, y=y, z=z)


def axis_of(q, axis=(1.0, 0.0, 0.0)):
    """Return an axis of the tool in the world."""
    return rotate_back(conjugate(q), axis)


def off_line(q, line):
    """Return the angle between the x axis of the tool and a unit vector."""
    x = axis_of(q)
    return norm(tuple(a - b for a, b in zip(x, line, strict=True)))


__all__ = [
    "GIMBAL", "IDENTITY", "LIMITS", "NS", "ZERO", "Session", "amplitude", "angle", "as_user",
    "axis_of", "exp", "multiply", "off_line", "rate_of",
]  # fmt: skip
