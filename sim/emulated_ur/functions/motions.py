"""Functions of URScript that move the arm; each yields once a cycle while it lasts.

They are models: trapezoids of speed, corners without blending, and no forces except those of the
control channel's ``contact``.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from emulated_ur.arm import TICK, Mode, from_pose, moved, rotated, rotation_between, to_pose
from emulated_ur.urscript import Array, Datum, Pose, ScriptError, written

if TYPE_CHECKING:
    from emulated_ur.arm.transforms import Transform
    from emulated_ur.controller import Controller
    from emulated_ur.urscript import Program, Ticks

_Path = tuple[float, Callable[[float], tuple[float, ...]]]

_LARGEST = 1e6
_STRAIGHT = 1e-12
"""Squared sine of the angle at a position below which three positions are on a line."""

_YIELDING = (0.01, 0.01, 0.01, 0.5, 0.5, 0.5)
"""Speed of the tool per force in force mode: m/s for each N, rad/s for each Nm."""

_SECONDARY = "SECONDARY_PROGRAM_EXCEPTION_XXX: a secondary program must not move the arm or wait"
_TAKEN = "another thread is already controlling the robot"


def finite(values: Iterable[float], count: int = 6) -> tuple[float, ...]:
    """Return *values* unchanged.

    Raises:
        ValueError: one is not finite, or larger than any quantity of a robot.
    """
    numbers = tuple(values)
    if len(numbers) != count or not all(abs(number) < _LARGEST for number in numbers):
        raise ValueError(f"expected {count} numbers for a robot, got {written(Array(numbers))}")
    return numbers


def _cross(a: Sequence[float], b: Sequence[float]) -> list[float]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


class Motions:
    """Functions that move the arm."""

    robot: Controller
    program: Program
    _holder: int | None = None
    _force: tuple[tuple[float, ...], ...] | None = None
    _is_aborted: bool

    def movej(
        self, q: Datum, a: float = 1.4, v: float = 1.05, t: float = 0.0, r: float = 0.0
    ) -> Ticks:
        goal = self._joints(q)
        is_interrupted = True
        while is_interrupted:
            path = self._turn(self.robot.arm.target_q, goal)
            is_interrupted = yield from self._follow(*path, (a, v, t, r))

    def movel(
        self, pose: Datum, a: float = 1.2, v: float = 0.25, t: float = 0.0, r: float = 0.0
    ) -> Ticks:
        tool = self.robot.tool
        end = self._place(pose)
        tool.joints_at(to_pose(end))  # refused before it moves
        is_interrupted = True
        while is_interrupted:
            path = self._line(tool.at(self.robot.arm.target_q), end)
            is_interrupted = yield from self._follow(*path, (a, v, t, r))

    def movep(self, pose: Datum, a: float = 1.2, v: float = 0.25, r: float = 0.0) -> Ticks:
        yield from self.movel(pose, a, v, 0.0, r)

    def movec(
        self, pose_via: Datum, pose_to: Datum, a: float = 1.2, v: float = 0.25, r: float = 0.0,
        mode: int = 0,
    ) -> Ticks:  # fmt: skip
        begin = self.robot.tool.at(self.robot.arm.target_q)
        path = self._arc(begin, self._place(pose_via)[3::4], self._place(pose_to), int(mode))
        is_interrupted = yield from self._follow(*path, (a, v, 0.0, r))
        if is_interrupted:  # the rest of an arc that a pause has cut is a line
            yield from self.movel(pose_to, a, v, 0.0, r)

    def servoj(
        self, q: Datum, a: float = 0.0, v: float = 0.0, t: float = TICK,
        lookahead_time: float = 0.1, gain: float = 300.0,
    ) -> Ticks:  # fmt: skip
        goal = self._joints(q)
        finite((t, lookahead_time, gain, a, v), 5)
        if lookahead_time <= 0.0 or gain <= 0.0:
            raise ValueError(f"servoj: lookahead {lookahead_time:g} and gain {gain:g}")
        with self._arm():
            left = t
            while True:
                self.robot.arm.servo(goal, lookahead=lookahead_time, gain=gain)
                left -= TICK * self.robot.speed_scaling
                yield
                if left <= 0.5 * TICK:
                    return

    def servoc(self, pose: Datum, a: float = 1.2, v: float = 0.25, r: float = 0.0) -> Ticks:
        yield from self.movel(pose, a, v)
        yield

    def speedj(self, qd: Datum, a: float = 1.4, t: float = 0.0) -> Ticks:
        rates = finite(qd)
        finite((a, t), 2)

        def turn() -> bool:
            self.robot.arm.turn(rates, acceleration=max(a, 1e-3))
            scaling = self.robot.speed_scaling
            return all(
                abs(one * scaling - other) < 1e-9
                for one, other in zip(rates, self.robot.arm.target_qd, strict=True)
            )

        yield from self._at_speed(turn, t)

    def speedl(self, xd: Datum, a: float = 1.2, t: float = 0.0, aRot: float | None = None) -> Ticks:
        wanted = finite(xd)
        change = (*(a,) * 3, *(a if aRot is None else aRot,) * 3)
        finite(change)

        def push() -> bool:
            scaling = self.robot.speed_scaling or 1.0
            rates = [rate / scaling for rate in self.robot.tool.pose("target_TCP_speed")]
            rates = [
                rate + max(-most * TICK, min(most * TICK, goal - rate))
                for rate, goal, most in zip(rates, wanted, change, strict=True)
            ]
            self._push(rates)
            return all(abs(one - other) < 1e-9 for one, other in zip(rates, wanted, strict=True))

        yield from self._at_speed(push, t)

    def stopj(self, a: float = 2.0) -> Ticks:
        finite((a,), 1)
        with self._arm():
            self.robot.arm.brake(a)
            while not self.robot.arm.is_still:
                yield

    def stopl(self, a: float = 10.0, aRot: float | None = None) -> Ticks:
        yield from self.stopj(a)

    def sleep(self, t: float) -> Ticks:
        yield from self._wait(round(finite((t,), 1)[0] / TICK))

    def sync(self) -> Ticks:
        yield from self._wait(self.robot.behaviour.cycle_ticks)

    def force_mode(
        self, task_frame: Datum, selection_vector: Datum, wrench: Datum, type: int, limits: Datum
    ) -> None:
        given = (task_frame, selection_vector, wrench, limits)
        self._force = tuple(finite(one) for one in given)

    def end_force_mode(self) -> None:
        if self._force is not None:
            self._force = None
            self.robot.arm.brake(10.0)

    def freedrive_mode(self, freeAxes: Datum = (), feature: Datum = ()) -> None:
        self.robot.arm.free()

    def end_freedrive_mode(self) -> None:
        if self.robot.arm.mode is Mode.FREE:
            self.robot.arm.brake(10.0)

    def teach_mode(self) -> None:
        self.robot.arm.free()

    def end_teach_mode(self) -> None:
        self.end_freedrive_mode()

    def tool_contact(self, direction: Datum = ()) -> int:
        return int(self.robot.is_touching)

    # Helpers of these functions.

    def _wait(self, ticks: int) -> Ticks:
        if self.program.script.is_secondary:
            raise ScriptError(_SECONDARY)
        for _ in range(ticks):
            yield

    def let_go(self, handle: int) -> None:
        """Release the arm of a thread that has ended."""
        if self._holder == handle:
            self._holder = None

    def press(self) -> None:
        """Yield to the forces of force mode for a cycle, until a contact."""
        arm = self.robot.arm
        if self._force is None or self._holder is not None:
            return
        frame, selection, wrench, limits = self._force
        if self.robot.is_touching:
            arm.follow(arm.target_q)
            return
        speeds = [
            max(-limit, min(limit, force * give)) if chosen else 0.0
            for chosen, force, limit, give in zip(selection, wrench, limits, _YIELDING, strict=True)
        ]
        speeds = [*rotated(speeds[:3], frame[3:]), *rotated(speeds[3:], frame[3:])]
        ahead = self.robot.tool.pose_ahead(speeds, TICK * self.robot.speed_scaling)
        arm.follow(self.robot.tool.joints_at(ahead))

    def _push(self, speeds: Sequence[float]) -> None:
        """Move the tool at *speeds* until another command."""
        arm = self.robot.arm
        goal = self.robot.tool.joints_at(self.robot.tool.pose_ahead(speeds, TICK))
        rates = tuple((b - a) / TICK for a, b in zip(arm.target_q, goal, strict=True))
        arm.turn(rates, acceleration=math.inf)

    def _joints(self, target: Datum) -> tuple[float, ...]:
        numbers = finite(target)
        return self.robot.tool.joints_at(numbers) if isinstance(target, Pose) else numbers

    def _place(self, target: Datum) -> Transform:
        """Return the tool at a pose or at joint angles."""
        numbers = finite(target)
        return from_pose(numbers) if isinstance(target, Pose) else self.robot.tool.at(numbers)

    def _at_speed(self, step: Callable[[], bool], seconds: float) -> Ticks:
        """Call *step* each cycle, for some time or until it reports that the speed is reached."""
        with self._arm():
            left = seconds
            while True:
                is_reached = step()
                yield
                left -= TICK
                if left <= 0.5 * TICK if seconds > 0.0 else is_reached:
                    return

    def _turn(self, start: tuple[float, ...], goal: tuple[float, ...]) -> _Path:
        """Return the path of joints that arrive together, with the angle of the leading one."""
        length = max(abs(one - other) for one, other in zip(start, goal, strict=True))
        return length, lambda s: tuple(
            one + (other - one) * s / length for one, other in zip(start, goal, strict=True)
        )

    def _line(self, begin: Transform, end: Transform) -> _Path:
        """Return the path of a tool along a line, with its length in m or rad."""
        turn = rotation_between(begin, end)
        shift = [b - a for a, b in zip(begin[3::4], end[3::4], strict=True)]
        length = max(math.hypot(*shift), math.hypot(*turn))

        def along(s: float) -> tuple[float, ...]:
            share = s / length
            at = moved(begin, [share * one for one in shift], [share * one for one in turn])
            return self.robot.tool.joints_at(to_pose(at))

        return length, along

    def _arc(self, begin: Transform, via: Sequence[float], end: Transform, mode: int) -> _Path:
        """Return the path of a tool along the circle through *via*, with its length in m."""
        a, b = ([q - p for p, q in zip(begin[3::4], to, strict=True)] for to in (via, end[3::4]))
        normal = _cross(a, b)
        square = math.hypot(*normal) ** 2
        if square <= _STRAIGHT * math.hypot(*a) ** 2 * math.hypot(*b) ** 2:
            raise ValueError("movec: the three positions are on a line")
        # From the first position to the centre, and the angle to the last one through the middle
        # one.
        ends = [
            math.hypot(*a) ** 2 * q - math.hypot(*b) ** 2 * p for p, q in zip(a, b, strict=True)
        ]
        centre = [one / (2.0 * square) for one in _cross(ends, normal)]
        axis = [one / math.sqrt(square) for one in normal]
        first, last = [-one for one in centre], [q - c for q, c in zip(b, centre, strict=True)]
        sine = sum(map(operator.mul, axis, _cross(first, last)))
        angle = math.atan2(sine, sum(map(operator.mul, first, last))) % math.tau
        turn = rotation_between(begin, end)
        length = angle * math.hypot(*centre)

        def along(s: float) -> tuple[float, ...]:
            swing = [s / length * angle * one for one in axis]
            spoke = rotated(first, swing)
            shift = [c + r for c, r in zip(centre, spoke, strict=True)]
            how = swing if mode else [s / length * one for one in turn]
            return self.robot.tool.joints_at(to_pose(moved(begin, shift, how)))

        return length, along

    def _follow(
        self, length: float, at: Callable[[float], tuple[float, ...]], how: Sequence[float]
    ) -> Ticks:
        """Follow *at* with a trapezoid of speed; return whether a pause interrupted it."""
        acceleration, speed, seconds, _ = finite(how, 4)
        if seconds > 0.0:  # takes the place of both
            speed, acceleration = 1.5 * length / seconds, 4.5 * length / seconds**2
        speed, acceleration = max(speed, 1e-3), max(acceleration, 1e-3)
        along = rate = 0.0
        self._is_aborted = False
        with self._arm():
            while along < length:
                dt = TICK * self.robot.speed_scaling
                brakes = math.sqrt(2.0 * acceleration * max(length - along, 0.0))
                rate = min(speed, rate + acceleration * dt, max(brakes, acceleration * dt))
                along = min(length, along + rate * dt)
                self.robot.arm.follow(at(along))
                yield
                if self._is_aborted:
                    yield from self.stopj(acceleration)
                    return False
                if self.robot.arm.mode is not Mode.FOLLOW:
                    return True
            self.robot.arm.hold()
        return False

    @contextmanager
    def _arm(self) -> Iterator[None]:
        """Assign the arm to the running thread."""
        if self.program.script.is_secondary:
            raise ScriptError(_SECONDARY)
        handle = self.program.current
        if self._holder not in (None, handle):
            raise ScriptError(_TAKEN)
        self._holder = handle
        try:
            yield
        finally:
            self.let_go(handle)
