"""A running program: its threads run in turn once a cycle until they wait."""

from __future__ import annotations

from collections.abc import Generator
from types import GeneratorType, TracebackType
from typing import TYPE_CHECKING, Any

from emulated_ur.arm import UnreachableError
from emulated_ur.urscript.compiler import FILE, Script, compile_script
from emulated_ur.urscript.lexer import ScriptError
from emulated_ur.urscript.values import Array, pose_of, replaced

if TYPE_CHECKING:
    from emulated_ur.functions import Functions

Ticks = Generator[None, None, Any]

_TURN = 300
"""Most rounds of loops of a thread without waiting before other threads run."""

_FAILURES = (
    ArithmeticError, AttributeError, LookupError, NameError, OSError, RecursionError, ScriptError,
    TypeError, UnreachableError, ValueError,
)  # fmt: skip


class HaltError(Exception):
    """The program ends itself."""


class ThreadEndError(Exception):
    """The running thread has killed itself."""


class Program:
    """One program.

    Args:
        script: the compiled program.
        functions: the controller's functions, for this program.

    Attributes:
        script: the compiled program.
        functions: the controller's functions, for this program.
        current: the running thread; 0 is the main one.
    """

    def __init__(self, script: Script, functions: Functions) -> None:
        self.script = script
        self.current = 0
        self.functions = functions
        self._rounds = 0
        self._started = 0
        self._known = dict(script.defines)
        self._names: dict[str, Any] = {
            "h_array": Array, "h_pose": pose_of, "h_replaced": replaced, "h_run": self._run,
            "h_kill": self._kill, "h_join": self._join, "h_halt": self._halt,
            "h_tired": self._is_tired, **functions.table(),
        }  # fmt: skip
        try:
            exec(script.code, self._names)
        except _FAILURES as error:  # of a parameter's default
            raise _placed(error) from error
        self._threads: dict[int, Ticks] = {0: self._names["main"]()}
        functions.program = self

    def advance(self) -> bool:
        """Run every thread until it waits; return whether the program continues.

        Raises:
            ScriptError: it ended with an exception, which has the line.
        """
        order = list(self._threads)
        for self.current in order:  # grows while threads start others
            thread = self._threads.get(self.current)
            if thread is None:
                continue
            self._rounds = 0
            try:
                next(thread)
            except (StopIteration, ThreadEndError):
                self._forget(self.current)
            except HaltError:
                return False
            except _FAILURES as error:
                raise _placed(error) from error
            order += [one for one in self._threads if one > order[-1]]
        if 0 in self._threads:
            self.functions.press()
        return 0 in self._threads

    def compile(self, statement: str) -> Script:
        """Return a statement, or more of them, to be added to the program.

        Raises:
            ScriptError: it does not compile.
        """
        script = compile_script(statement + "\n", self.functions.table(), self._known)
        self._known |= script.defines
        return script

    def run_more(self, script: Script) -> Ticks:
        """Run the added statements, in the calling thread."""
        exec(script.code, self._names)
        yield from self._names["main"]()

    def end(self) -> None:
        """Release the program's threads and sockets."""
        self._threads.clear()
        self.functions.end()

    @property
    def line(self) -> int:
        """The line at which the main thread waits, or 0."""
        inner: Any = self._threads.get(0)
        found = 0
        while isinstance(inner, GeneratorType):
            if inner.gi_frame is not None and inner.gi_code.co_filename == FILE:
                found = inner.gi_frame.f_lineno
            inner = inner.gi_yieldfrom
        return found

    def _forget(self, handle: int) -> None:
        self._threads.pop(handle, None)
        self.functions.let_go(handle)

    def _is_tired(self) -> bool:
        self._rounds += 1
        return self._rounds > _TURN

    def _run(self, thread: object) -> int:
        if not isinstance(thread, GeneratorType):
            raise TypeError("run needs a thread")
        self._started += 1
        self._threads[self._started] = thread
        return self._started

    def _kill(self, handle: int) -> None:
        if not handle:  # what a variable holds before it holds a thread
            return
        self._forget(handle)
        if handle == self.current:
            raise ThreadEndError

    def _join(self, handle: int) -> Ticks:
        while handle and handle in self._threads:
            yield

    def _halt(self) -> None:
        raise HaltError


def _placed(error: Exception) -> ScriptError:
    """Return *error* with the line of the script at which it occurred."""
    line = 0
    trace: TracebackType | None = error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == FILE:
            line = trace.tb_lineno
        trace = trace.tb_next
    text = str(error).replace("v_", "").replace("f_", "")
    if isinstance(error, KeyError):
        text = f"no such name: {text}"
    return ScriptError(text, line)
