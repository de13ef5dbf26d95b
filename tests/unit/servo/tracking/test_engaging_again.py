"""A hand lets go and engages again, a thousand times: the device never moves for that."""

import random
from types import SimpleNamespace

from tracking_world import NS, World, angle, servo_limits

import orientd
from orientd.client.clutch import Anchor, Clutch
from orientd.driver import ZERO
from orientd.floats import exp, multiply, plus
from orientd.protocol import control_pb2 as pb
from orientd.protocol import quaternion, vector
from orientd.servo.tracking.reference import Target

TIMES = 1000
HAND_NS, REPORT_NS = NS // 60, NS // 20
LIVE = 0.1


class Session:
    """A session of a client with a device in virtual time, with reports 20 times a second."""

    def __init__(self, monkeypatch):
        self.world = World(servo_limits(2.5, 17.0, 8500.0), rate_hz=50)
        clock = SimpleNamespace(monotonic=lambda: self.world.now)
        monkeypatch.setattr("orientd.client.clutch.time", clock)
        self.anchor = Anchor(self.report())
        self.moved = 0.0
        self._next_ns = 0

    def report(self):
        guard = self.world.guard
        return pb.TrackResponse(
            q=quaternion(guard.q), position=vector(ZERO), omega_body=vector(guard.omega)
        )

    def aim(self, q, *, angular_velocity, time_to_live, position):
        assert position is None
        self.anchor.lose()
        now_ns = self.world.now_ns
        expires_ns = now_ns + round(time_to_live * NS)
        target = Target((q.w, q.x, q.y, q.z), angular_velocity, now_ns, expires_ns)
        assert self.world.tracker.take(target, now_ns) == ""

    def engage(self):
        return Clutch(self, self.anchor, scale=1.0, frame="world", time_to_live=LIVE)

    def run(self, seconds, clutch=None, hand=None):
        """Let time pass; a *hand*, a function of the time since then, moves the *clutch*."""
        begin_ns, next_ns, begin = self.world.now_ns, self.world.now_ns, self.world.guard.q
        self.moved = 0.0
        while self.world.now_ns < begin_ns + seconds * NS:
            if clutch is not None and self.world.now_ns >= next_ns:
                w, x, y, z = hand((self.world.now_ns - begin_ns) / NS)
                clutch.move(orientd.Quaternion(w=w, x=x, y=y, z=z))
                next_ns += HAND_NS
            self.world.step()
            self.moved = max(self.moved, angle(begin, self.world.guard.q))
            if self.world.now_ns >= self._next_ns:
                self.anchor.note(self.report())
                self._next_ns = self.world.now_ns + REPORT_NS

    def rest(self, goal):
        """Wait until the device rests, at *goal* if there is one, and a report says so."""
        begin = self.world.now
        self.run(LIVE)
        while self.moved > 1e-10 or (goal is not None and angle(self.world.guard.q, goal) > 1e-9):
            assert self.world.now < begin + 5.0
            self.run(0.1)


def anywhere(rng):
    return exp(tuple(rng.gauss(0.0, 1.5) for _ in range(3)))


def test_engaging_again_moves_nothing_wherever_the_hand_is(monkeypatch):
    rng, session = random.Random(1), Session(monkeypatch)
    largest = farthest = 0.0
    for _ in range(TIMES):
        start, turn = anywhere(rng), tuple(rng.gauss(0.0, 1.5) for _ in range(3))
        clutch = session.engage()
        session.run(
            rng.uniform(0.05, 0.2),
            clutch,
            lambda t, start=start, turn=turn: multiply(exp(plus(ZERO, turn, t)), start),
        )
        farthest = max(farthest, session.moved)
        is_released = rng.random() < 0.7
        if is_released:
            clutch.release()
        if rng.random() < 0.3:
            # Before the device rests.
            still = anywhere(rng)
            clutch = session.engage()
            session.run(0.06, clutch, lambda _, still=still: still)
            is_released = clutch.holds
            clutch.release()
        session.rest(clutch.q if is_released else None)
        again, still = session.engage(), anywhere(rng)
        session.run(0.06, again, lambda _, still=still: still)
        assert again.holds
        largest = max(largest, session.moved)
        again.release()
    print(f"moved by {largest:.1e} rad at most, {farthest:.2f} rad with the hand")
    assert farthest > 0.1
    assert largest < 1e-9
