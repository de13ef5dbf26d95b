"""What the control script does that a client uploads: commands in registers, a servo thread.

A program is a generator that yields once a tick, so that it reads as the script on the robot does:
``yield`` stands for ``sync()``.  The main loop reads a command register every tick; the servo
thread latches the last target for as long as one servo command lasts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from orientd_sim.ur import commands
from orientd_sim.ur.arm import TICK
from orientd_sim.ur.commands import RegisterCommand
from orientd_sim.ur.programs import (
    Statement,
    Ticks,
    UnknownStatementError,
    finite,
    perform,
    press,
    push,
)

if TYPE_CHECKING:
    from orientd_sim.ur.controller import Controller

_SHORTEST = 0.1

READY, DONE = 1, 2
SIGNATURE = "def rtde_control():"
"""How the text of the control script begins."""


class ControlScript:
    """The uploaded control script.

    Args:
        robot: the controller it runs on.
        int_offset: number of the first integer register it uses.
        double_offset: number of the first double register it uses.
        path: the motions that were put into its text.
    """

    def __init__(
        self,
        robot: Controller,
        *,
        int_offset: int,
        double_offset: int,
        path: Sequence[Statement],
    ) -> None:
        self.robot = robot
        self._ints = int_offset
        self._doubles = double_offset
        self._servo: tuple[tuple[float, ...], float, float, float] | None = None
        self._speed: tuple[tuple[float, ...], float, bool] | None = None
        self._force: tuple[tuple[float, ...], ...] | None = None
        self._main = self._main_loop()
        self._thread: Ticks | None = None
        self._move: Ticks | None = None
        self._progress_count = self._operation = 0
        self.path = path

    @property
    def command_register(self) -> str:
        """The input register whose writes keep a watchdog quiet."""
        return f"input_int_register_{self._ints}"

    def advance(self) -> bool:
        """Run one tick; return whether the program goes on.

        Raises:
            UnreachableError: a command asks for a pose out of reach.
        """
        if not _goes_on(self._main):
            return False
        if self._thread is not None and not _goes_on(self._thread):
            self._thread = None
        if self._move is not None and not _goes_on(self._move):
            self.end_move()
        return True

    # What a command finds in the registers and leaves there.

    def command_int(self, number: int) -> int:
        """Return input integer register *number*, counted from the script's first."""
        return self.robot.input_ints[self._ints + number]

    def numbers(self, start: int, count: int) -> tuple[float, ...]:
        """Return *count* input double registers from *start*.

        Raises:
            UnknownStatementError: one is no number that a robot could make use of.
        """
        first = self._doubles + start
        return finite(self.robot.input_doubles[first : first + count])

    def answer_int(self, number: int, value: int) -> None:
        """Write output integer register *number*."""
        self.robot.output_ints[self._ints + number] = value

    def answer(self, values: Sequence[float]) -> None:
        """Write the output double registers from the first on."""
        for number, value in enumerate(values):
            self.robot.output_doubles[self._doubles + number] = value

    # What the program does.

    def _main_loop(self) -> Ticks:
        self.tell_progress(-1)
        self.answer_int(0, READY)
        is_executing = False
        while True:
            number = self.command_int(0)
            if number == RegisterCommand.STOP_SCRIPT:
                self.robot.arm.brake(commands.STOP_DECELERATION)
                return
            if number in commands.REAL_TIME:
                # Registers are not cleared: the command is carried out again at every tick.
                commands.execute_now(self, number)
                self.answer_int(0, READY)
            elif number == RegisterCommand.NONE:
                is_executing = False
                self.answer_int(0, READY)
            elif not is_executing:
                yield from commands.execute(self, number)
                is_executing = True
                self.answer_int(0, DONE)
            yield

    def start_servo(self, q: tuple[float, ...], time: float, lookahead: float, gain: float) -> None:
        """Latch a servo target, and start the servo thread where none runs.

        Raises:
            UnknownStatementError: lookahead or gain is not positive.
        """
        if lookahead <= 0.0 or gain <= 0.0:
            raise UnknownStatementError(f"servo: lookahead {lookahead:g} and gain {gain:g}")
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

    def start_force(
        self,
        frame: Sequence[float],
        selection: Sequence[int],
        wrench: Sequence[float],
        limits: Sequence[float],
    ) -> None:
        """Give way to forces from now on; the same order again changes nothing."""
        order = (tuple(frame), tuple(selection), tuple(wrench), tuple(limits))
        if order != self._force:
            self.end_thread()
            self._force = order
            self._thread = press(self.robot, frame, selection, wrench, limits)

    def end_thread(self) -> None:
        """Kill the servo or speed thread; the arm keeps its last order until told otherwise."""
        self._thread = self._servo = self._speed = self._force = None

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
                push(self.robot, rates)
            else:
                self.robot.arm.turn(rates, acceleration=acceleration)
            yield

    # Motions that go on while the main loop does, and what is said of them.

    def tell_progress(self, value: int) -> None:
        """Write how far such a motion is: 0 begins one, -1 ends it."""
        self._progress_count = (self._progress_count + 1) % 128
        if value == 0:
            self._operation = (self._operation + 1) % 128
        told = min(value, 32767) + 32768 if value >= 0 else 0
        self.answer_int(2, (self._progress_count << 16) + (self._operation << 24) + told)

    def start_move(self, motion: Ticks) -> None:
        """Begin a motion that the main loop does not wait for."""
        self.end_move()
        self.tell_progress(0)
        self._move = motion

    def end_move(self) -> None:
        """Drop the motion that the main loop does not wait for; the arm keeps its last order."""
        if self._move is not None:
            self._move = None
            self.tell_progress(-1)

    def start_thread(self, motion: Ticks) -> None:
        """Begin what goes on until another command ends it, as jogging does."""
        self.end_thread()
        self._thread = motion


class StatementProgram:
    """A program of plain statements, one after the other."""

    def __init__(self, robot: Controller, statements: Sequence[Statement]) -> None:
        self._ticks = perform(robot, statements, lambda _value: None)
        # A program lasts at least until its client can see that it plays.
        self._least = _SHORTEST

    def advance(self) -> bool:
        """Run one tick; return whether the program goes on."""
        self._least -= TICK
        return _goes_on(self._ticks) or self._least > 0.0


def _goes_on(ticks: Ticks) -> bool:
    """Run one tick; return whether there is another."""
    return any(True for _ in ticks)
