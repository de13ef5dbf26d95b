"""The arm of the emulated robot: six joints that follow the controller's commands.

Two simple models in series.  They are not measurements of a real arm:

- *Servo.*  The requested speed of a joint would bring it to the target in the lookahead time.
  The joint reaches that speed with the time constant ``1 / gain``.  It follows a ramp with a lag
  of the lookahead time, at any gain.
- *Drive.*  The measured joint follows the commanded one with a lag of 4 ms.

A command beyond the speed limit of a joint is a breach, which the controller answers with a
protective stop.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from emulated_ur.arm.kinematics import Joints, Kinematics
from emulated_ur.arm.models import MODELS, Model

TICK = 0.002
"""The controller's cycle, s."""

DRIVE_LAG = 0.004
HOME: Joints = (0.0, -1.5707963267948966, 1.3962634015954636, -1.3962634015954636,
                -1.5707963267948966, 0.0)  # fmt: skip
"""Elbow up, tool pointing down: away from every singularity."""

_STILL = 1e-9


class Mode(Enum):
    """The source of the commanded joint motion."""

    HOLD = "hold"
    SERVO = "servo"
    SPEED = "speed"
    BRAKE = "brake"
    FOLLOW = "follow"
    FREE = "free"


@dataclass(frozen=True, slots=True)
class Breach:
    """A command that a joint leave its range or exceed its speed."""

    joint: int
    quantity: str
    value: float
    limit: float

    def __str__(self) -> str:
        return f"joint {self.joint + 1} {self.quantity} {self.value:.4f} is over {self.limit:.4f}"


class Arm:
    """Six joints, advanced once a tick.

    Args:
        q: initial joints, rad.
        model: model of the arm.
        smooths_servo: whether lookahead and gain of a servo command count; otherwise the arm goes
            to its goal in one cycle.

    Attributes:
        model: model of the arm.
        kinematics: of the model.
        target_q, target_qd, target_qdd: commanded joints; rad, rad/s, rad/s^2.
        actual_q, actual_qd: measured joints.
        speed_limits: rad/s for each joint; a test may lower them.
        blocked: angles at which joints are held, whatever is commanded, by joint, counted from 0.
    """

    def __init__(
        self,
        q: Sequence[float] = HOME,
        model: Model = MODELS["ur5e"],
        *,
        smooths_servo: bool = True,
    ) -> None:
        self.model = model
        self.kinematics = Kinematics(model)
        self._smooths_servo = smooths_servo
        self.target_q: Joints = tuple(q)
        self.target_qd: Joints = (0.0,) * 6
        self.target_qdd: Joints = (0.0,) * 6
        self.actual_q: Joints = tuple(q)
        self.actual_qd: Joints = (0.0,) * 6
        self.speed_limits: list[float] = list(model.speeds)
        self.blocked: dict[int, float] = {}
        self.mode = Mode.HOLD
        self._goal: Joints = tuple(q)
        self._lookahead = 0.1
        self._gain = 300.0
        self._rate = 10.0
        self._pushed_ticks = 0

    @property
    def servoing(self) -> tuple[float, float]:
        """Lookahead (s) and gain of the last servo command."""
        return self._lookahead, self._gain

    @property
    def is_still(self) -> bool:
        """Whether no joint is commanded to move."""
        return max(abs(rate) for rate in self.target_qd) < _STILL

    def servo(self, goal: Joints, *, lookahead: float, gain: float) -> None:
        """Follow *goal* until another command."""
        self.mode = Mode.SERVO
        self._goal, self._lookahead, self._gain = goal, lookahead, gain

    def turn(self, qd: Joints, *, acceleration: float) -> None:
        """Accelerate to the joint speeds *qd*, rad/s, at *acceleration*, rad/s^2."""
        self.mode = Mode.SPEED
        self._goal, self._rate = qd, acceleration

    def brake(self, deceleration: float) -> None:
        """Come to rest, all joints at the same moment."""
        self.mode = Mode.BRAKE
        self._rate = max(deceleration, 0.1)

    def follow(self, q: Joints) -> None:
        """Move to *q* at the next tick: the caller determines path and timing."""
        self.mode = Mode.FOLLOW
        self._goal = q

    def free(self) -> None:
        """Let the arm be pushed by hand."""
        self.mode = Mode.FREE
        self._pushed_ticks = 0

    def push(self, q: Joints, seconds: float) -> None:
        """Move by hand to *q* in a number of seconds."""
        self.mode = Mode.FREE
        self._goal, self._pushed_ticks = q, max(1, round(seconds / TICK))

    def hold(self) -> None:
        """Hold the commanded position; only valid at rest."""
        self.mode = Mode.HOLD

    def step(self, scaling: float) -> Breach | None:
        """Advance by one tick, in which the program's time runs by *scaling* of a tick.

        Returns:
            The first breach of a limit, or ``None``.  The joints are clamped to their speed limits
            in any case.
        """
        wanted = self._wanted_speeds(scaling)
        breach: Breach | None = None
        speeds: list[float] = []
        for joint, (rate, limit) in enumerate(zip(wanted, self.speed_limits, strict=True)):
            if abs(rate) > limit * 1.000001:
                breach = breach or Breach(joint, "speed", abs(rate), limit)
                speeds.append(math.copysign(limit, rate))
            else:
                speeds.append(rate)
        before = self.target_qd
        self.target_qd = tuple(speeds)
        self.target_qdd = tuple((b - a) / TICK for a, b in zip(before, speeds, strict=True))
        self.target_q = tuple(
            q + rate * TICK for q, rate in zip(self.target_q, speeds, strict=True)
        )
        for joint, (q, most) in enumerate(zip(self.target_q, self.model.ranges, strict=True)):
            if abs(q) > most:
                breach = breach or Breach(joint, "angle", abs(q), most)
        if self.mode is Mode.BRAKE and self.is_still:
            self.mode = Mode.HOLD
            self.target_qd = (0.0,) * 6
        self._drive()
        return breach

    def _wanted_speeds(self, scaling: float) -> list[float]:
        here, rates = self.target_q, self.target_qd
        if self.mode is Mode.SERVO:
            dt = TICK * scaling
            if dt <= 0.0:
                return [0.0] * 6
            if not self._smooths_servo:
                return [(b - a) / TICK for a, b in zip(here, self._goal, strict=True)]
            keep = math.exp(-self._gain * dt)
            wanted = [(b - a) / self._lookahead for a, b in zip(here, self._goal, strict=True)]
            # Speeds are in real time; the servo works in the program's time.
            return [
                scaling * (w + (r / scaling - w) * keep) for w, r in zip(wanted, rates, strict=True)
            ]
        if self.mode is Mode.SPEED:
            step = self._rate * TICK
            return [
                r + max(-step, min(step, g * scaling - r))
                for r, g in zip(rates, self._goal, strict=True)
            ]
        if self.mode is Mode.BRAKE:
            fastest = max(abs(r) for r in rates)
            if fastest <= self._rate * TICK:
                return [0.0] * 6
            left = 1.0 - self._rate * TICK / fastest
            return [r * left for r in rates]
        if self.mode is Mode.FREE and self._pushed_ticks:
            ticks, self._pushed_ticks = self._pushed_ticks, self._pushed_ticks - 1
            return [(b - a) / (ticks * TICK) for a, b in zip(here, self._goal, strict=True)]
        if self.mode is Mode.FOLLOW:
            return [(b - a) / TICK for a, b in zip(here, self._goal, strict=True)]
        return [0.0] * 6

    def _drive(self) -> None:
        share = 1.0 - math.exp(-TICK / DRIVE_LAG)
        q: list[float] = []
        qd: list[float] = []
        for joint, (actual, target) in enumerate(zip(self.actual_q, self.target_q, strict=True)):
            left = self.blocked.get(joint, target) - actual
            moved = left * share if abs(left) > 1e-12 else left
            q.append(actual + moved)
            qd.append(moved / TICK)
        self.actual_q, self.actual_qd = tuple(q), tuple(qd)
