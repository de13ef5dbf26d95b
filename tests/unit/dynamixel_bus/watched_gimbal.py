"""The servo loop on an emulated gimbal whose shafts are watched in every cycle."""

from __future__ import annotations

import numpy as np
from rig import PERIOD

from orientd.floats import exp, multiply
from orientd.stream.records import ServoState

TURN = 4096
DEGREE = TURN / 360
SLACK = 3 * DEGREE
"""How far a servo may move after it was braked: what it still lags, and its play."""


def turning(driver, axis, angle, seconds=1.0):
    """Return the path records of one axis that turns by *angle* from where the gimbal holds."""
    gimbal = driver.mechanism(may_ask=False)
    angles = [servo.angle(servo.goal) for servo in driver._servos]
    rates = [float(k == axis) for k in range(3)]
    body = gimbal.kinematics.omega_body(angles, rates)
    q0 = gimbal.orientation(angles)
    u = np.linspace(0, 1, round(seconds / PERIOD) + 1)
    at = angle * u**3 * (10 - 15 * u + 6 * u**2)
    rate = angle * 30 * u**2 * (1 - u) ** 2 / seconds
    change = angle * 60 * u * (1 - u) * (1 - 2 * u) / seconds**2
    q = np.array([multiply(q0, exp(tuple(a * x for x in body))) for a in at])
    return q, rate[:, None] * np.array(body), change[:, None] * np.array(body)


class Watched:
    """A loop on an emulated gimbal, with the shafts watched in every cycle."""

    def __init__(self, rig, gimbal_loop, places, **options):
        self.gimbal = rig(rate_hz=500, is_paced=False, latency_ms=4.0, **options)
        for servo, place in zip(self.gimbal.bus.servos, places, strict=True):
            servo.write(64, b"\0", self.gimbal.clock.now_ns())
            servo.shaft.position = float(place)
            servo.shaft.settle()
        self.low, self.high = self.positions(), self.positions()
        self.start = gimbal_loop

    def open(self):
        self.loop = self.start(self.gimbal)

    def positions(self):
        self.gimbal.bus.advance(self.gimbal.clock.now_ns())
        return np.array([servo.shaft.position for servo in self.gimbal.bus.servos])

    def stand(self):
        """From now on nothing may move."""
        self.low, self.high = self.positions(), self.positions()

    def check(self):
        at = self.positions()
        assert (at > self.low - SLACK).all(), (at - self.low) / DEGREE
        assert (at < self.high + SLACK).all(), (at - self.high) / DEGREE

    def run(self, cycles):
        for _ in range(cycles):
            before = self.loop.servo.state
            self.loop.run(1)
            self.check()
            if self.loop.servo.state is ServoState.FAULT is not before:
                self.stand()

    def ask(self, command):
        answer = self.loop.ask(command)
        self.check()
        return answer

    @property
    def state(self):
        return self.loop.servo.state
