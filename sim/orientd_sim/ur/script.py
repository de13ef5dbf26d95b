"""What the control script does that a client uploads: commands in registers, a servo thread.

A program is a generator that yields once a tick, so that it reads as the script on the robot does:
``yield`` stands for ``sync()``.  The main loop reads a command register every tick; the servo
thread latches the last target for as long as one servo command lasts.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from typing import TYPE_CHECKING

from orientd_sim.ur import commands
from orientd_sim.ur.arm import TICK
from orientd_sim.ur.commands import Command

if TYPE_CHECKING:
    from orientd_sim.ur.controller import Controller

Ticks = Generator[None, None, None]

READY, DONE = 1, 2
SIGNATURE = "def rtde_control():"
"""How the text of the control script begins."""


class ControlScript:
    """The uploaded control script.

    Args:
        robot: the controller it runs on.
        int_offset: number of the first integer register it uses.
        double_offset: number of the first double register it uses.
    """

    def __init__(self, robot: Controller, *, int_offset: int = 0, double_offset: int = 0) -> None:
        self.robot = robot
        self._ints = int_offset
        self._doubles = double_offset
        self._servo: tuple[tuple[float, ...], float, float, float] | None = None
        self._speed: tuple[tuple[float, ...], float, bool] | None = None
        self._main = self._main_loop()
        self._thread: Ticks | None = None

    @property
    def command_register(self) -> str:
        """The input register whose writes keep a watchdog quiet."""
        return f"input_int_register_{self._ints}"

    def advance(self) -> bool:
        """Run one tick; return whether the program goes on.

        Raises:
            UnreachableError: a command asks for a pose out of reach.
        """
        for _ in self._main:
            break
        else:
            return False
        if self._thread is not None:
            for _ in self._thread:
                break
            else:
                self._thread = None
        return True

    # What a command finds in the registers and leaves there.

    def command_int(self, number: int) -> int:
        """Return input integer register *number*, counted from the script's first."""
        return self.robot.input_ints[self._ints + number]

    def numbers(self, start: int, count: int) -> tuple[float, ...]:
        """Return *count* input double registers from *start*."""
        first = self._doubles + start
        return tuple(self.robot.input_doubles[first : first + count])

    def answer_int(self, number: int, value: int) -> None:
        """Write output integer register *number*."""
        self.robot.output_ints[self._ints + number] = value

    def answer(self, values: Sequence[float]) -> None:
        """Write the output double registers from the first on."""
        for number, value in enumerate(values):
            self.robot.output_doubles[self._doubles + number] = value

    # What the program does.

    def _main_loop(self) -> Ticks:
        self.answer_int(2, 0)
        self.answer_int(0, READY)
        is_executing = False
        while True:
            number = self.command_int(0)
            if number == Command.STOP_SCRIPT:
                self.robot.arm.brake(commands.STOP_DECELERATION)
                return
            if number in commands.REAL_TIME:
                # Registers are not cleared: the command is carried out again at every tick.
                commands.execute_now(self, number)
                self.answer_int(0, READY)
            elif number == Command.NONE:
                is_executing = False
                self.answer_int(0, READY)
            elif not is_executing:
                yield from commands.execute(self, number)
                is_executing = True
                self.answer_int(0, DONE)
            yield

    def start_servo(self, q: tuple[float, ...], time: float, lookahead: float, gain: float) -> None:
        """Latch a servo target, and start the servo thread where none runs."""
        is_running = self._servo is not None and self._thread is not None
        self._servo = (q, time, lookahead, gain)
        if not is_running:
            self._speed = None
            self._thread = self._servo_thread()

    def start_speed(self, rates: tuple[float, ...], acceleration: float, is_tool: bool) -> None:
        """Latch joint or tool speeds, and start the speed thread where none runs."""
        is_running = self._speed is not None and self._thread is not None
        self._speed = (rates, acceleration, is_tool)
        if not is_running:
            self._servo = None
            self._thread = self._speed_thread()

    def end_thread(self) -> None:
        """Kill the servo or speed thread; the arm keeps its last order until told otherwise."""
        self._thread = self._servo = self._speed = None

    def _servo_thread(self) -> Ticks:
        while self._servo is not None:
            q, time, lookahead, gain = self._servo
            left = time
            while True:
                self.robot.arm.servo(q, lookahead=lookahead, gain=gain)
                left -= TICK * self.robot.speed_scaling
                yield
                if left <= 0.5 * TICK:
                    break

    def _speed_thread(self) -> Ticks:
        while self._speed is not None:
            rates, acceleration, is_tool = self._speed
            if is_tool:
                ahead = self.robot.tool.pose_ahead(rates, TICK * self.robot.speed_scaling)
                self.robot.arm.follow(self.robot.tool.joints_at(ahead))
            else:
                self.robot.arm.turn(rates, acceleration=acceleration)
            yield

    def move(self, length: float, at: commands.Path, speed: float, acceleration: float) -> Ticks:
        """Follow *at* over ``0..length`` with a trapezoid of speed, one tick after another."""
        along = rate = 0.0
        speed, acceleration = max(speed, 1e-3), max(acceleration, 1e-3)
        while along < length:
            dt = TICK * self.robot.speed_scaling
            brakes = math.sqrt(2.0 * acceleration * max(length - along, 0.0))
            rate = min(speed, rate + acceleration * dt, max(brakes, acceleration * dt))
            along = min(length, along + rate * dt)
            self.robot.arm.follow(at(along))
            yield
        self.robot.arm.hold()


class PlainProgram:
    """Any other program: plays for a while, moves nothing, then ends."""

    command_register = ""

    def __init__(self, duration: float) -> None:
        self._left = duration

    def advance(self) -> bool:
        """Run one tick; return whether the program goes on."""
        self._left -= TICK
        return self._left > 0.0
