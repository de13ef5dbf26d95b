"""Interpreter mode: a program that runs statements as they arrive at port 30020."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

from emulated_ur.urscript import ScriptError

if TYPE_CHECKING:
    from emulated_ur.controller import Controller
    from emulated_ur.urscript import Program, Script, Ticks


class Interpreter:
    """The queue of statements."""

    robot: Controller
    program: Program

    def __init__(self) -> None:
        self._is_interpreting = False
        self._is_aborted = False
        self._waiting: deque[tuple[int, Script]] = deque()
        self._accepted = self._executed = self._cleared = 0

    def interpreter_mode(self, clearQueueOnEnter: bool = True, clearOnEnd: bool = True) -> Ticks:
        if clearQueueOnEnter:
            self._waiting.clear()
        self._is_interpreting = True
        while self._is_interpreting:
            if self._waiting:
                self._executed, script = self._waiting.popleft()
                yield from self.program.run_more(script)
            else:
                yield
        if clearOnEnd:
            self.clear_interpreter()

    def end_interpreter(self) -> None:
        self._is_interpreting = False

    def clear_interpreter(self) -> None:
        self._cleared = self._executed

    def interpret(self, statement: str) -> str:
        """Receive a line from port 30020; return the answer."""
        numbers = {
            "statelastexecuted": self._executed, "statelastinterpreted": self._accepted,
            "statelastcleared": self._cleared, "stateunexecuted": len(self._waiting),
        }  # fmt: skip
        if statement in numbers:
            return f"state: {numbers[statement]}: {statement}"
        if statement == "skipbuffer":
            self._waiting.clear()
        elif statement == "abort":
            self._is_aborted = True
        elif not self._is_interpreting:
            return f"discard: the program is not in interpreter mode: {statement}"
        else:
            try:
                script = self.program.compile(statement)
            except ScriptError as error:
                return f"discard: {error}: {statement}"
            self._accepted += 1
            self._waiting.append((self._accepted, script))
        return f"ack: {self._accepted}: {statement}"
