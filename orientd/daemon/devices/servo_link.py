"""The daemon's end of one servo process: start it, ask it, hear it, see it end.

Nothing here waits for longer than an answer takes, and the servo waits for nothing here.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
import time
from collections import deque
from collections.abc import Mapping
from typing import Any, NamedTuple

from orientd.driver import python_command
from orientd.errors import DaemonError, NotYetError, PendingError, StateError
from orientd.planner import Limits
from orientd.servo import ProcessSettings
from orientd.stream import (
    GIVEN_UP_WORD,
    UNKNOWN,
    Answer,
    Command,
    Cycle,
    Note,
    NoteKind,
    ServoLimits,
    SharedMemory,
    Stop,
    tuning_text,
    unpack_cycle,
    unpack_note,
)

ANSWER_TIMEOUT = 0.5
"""How long an ordinary command may take, s."""

SLOW_ANSWER_TIMEOUT = 0.9
"""How long a command is waited for for which the driver talks to the device at length, s.

Such a command goes on; whoever gives it again later has the answer to the first one.
"""
_LATE_ANSWER = 10.0
"""How long the answer to a slow command is kept for whoever gives it again, s."""

_SLOW = (Command.ENABLE, Command.DISABLE, Command.RESET, Command.FREE)
_STOPPING = (Command.STOP, Command.HALT, Command.SHUTDOWN)
_POLL = 0.0005
_LOOK = 0.05
_LOOK_FOR_END = 0.005
_NO_TERMS = ServoLimits(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class SlowCommand(NamedTuple):
    """A command that the servo may be busy with: its number, what it is, and since when, s."""

    number: int
    command: Command
    begun: float


class ServoLink:
    """One servo process and the memory shared with it.

    Attributes:
        memory: the rings.
        process: the process.
    """

    def __init__(self, settings: ProcessSettings, python: str = "") -> None:
        """Start the process; :meth:`words` will say when it is ready.

        Args:
            settings: what the process is told.
            python: interpreter that it is run with; empty for our own.

        Raises:
            DaemonError: there is no room in shared memory, or too much else runs or is open.
        """
        try:
            self.memory = SharedMemory.create(settings.path_capacity, settings.cycle_capacity)
        except OSError as error:
            raise DaemonError(f"no shared memory for the servo process: {error}") from error
        self.memory.beat(time.monotonic_ns())
        self._lock = threading.Lock()
        self._note_index = self._stop_index = 0
        self._answers: dict[int, Note] = {}
        self._awaited: set[int] = set()
        self._reset = UNKNOWN
        self._slow: SlowCommand | None = None
        self._words: deque[Note] = deque(maxlen=256)
        try:
            self.process = subprocess.Popen(
                python_command(
                    python, "orientd.servo", settings.driver, str(self.memory.descriptor)
                ),
                stdin=subprocess.PIPE,
                pass_fds=[self.memory.descriptor],
                # Out of the reach of a Ctrl-C, yet in the daemon's session: the kernel shares
                # processor time by session (autogroup), and one by itself was kept waiting for 1 s.
                process_group=0,
                cwd="/",
            )
        except OSError as error:
            self.close()
            raise DaemonError(f"the servo process cannot be started: {error}") from error
        if self.process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                self.process.stdin.write(settings.to_json().encode())
                self.process.stdin.close()

    @property
    def is_alive(self) -> bool:
        """Whether the process runs."""
        return self.process.poll() is None

    @property
    def busy_with(self) -> Command | None:
        """The slow command that was given last and whose answer nobody has had."""
        slow = self._slow
        return None if slow is None else slow.command

    @property
    def is_stopped(self) -> bool:
        """Whether a signal or a debugger has stopped the process, which then does nothing."""
        try:
            with open(f"/proc/{self.process.pid}/stat") as stat:  # noqa: PTH123 - no pathlib here
                return stat.read().rpartition(")")[2].split()[0] in "tT"
        except OSError:
            return False

    def beat(self) -> None:
        """Tell the servo that the daemon is alive."""
        self.memory.beat(time.monotonic_ns())

    def ask(
        self,
        command: Command,
        *,
        motion: int = 0,
        path_index: int = 0,
        leave_index: int = UNKNOWN,
        final_index: int = UNKNOWN,
        start_ns: int = 0,
        speed: float = 0.0,
        servo_limits: ServoLimits = _NO_TERMS,
        patience: float = SLOW_ANSWER_TIMEOUT,
    ) -> None:
        """Send a command and wait until the servo has taken it.

        One that this has given up waiting for is not carried out later, unless it stops something,
        or is one for which the driver talks to the device at length: it goes on.  While it does
        nothing moves, and a stop is not waited for.

        Args:
            command: what to do.
            motion, path_index, leave_index, final_index, start_ns, speed, servo_limits: see
                :class:`~orientd.stream.Command`.
            patience: how long to wait for such a command, s.

        Raises:
            PendingError: the servo is still busy with this command, or with another.
            NotYetError: not while the speed is changing.
            StateError: the servo's state does not allow it, or it was refused.
            DaemonError: the servo does not answer, or is not there.
        """
        begun = time.monotonic()
        slow = self._under_way(command, begun)
        index = (
            slow.number
            if slow is not None and slow.command is command
            else self._post(
                command,
                motion,
                path_index,
                leave_index,
                final_index,
                start_ns,
                speed,
                *servo_limits.floats(),
            )
        )
        if command in _STOPPING and (slow is not None or not self.memory.cycles.head):
            self._forget(index)
            return  # it stops what does not move
        is_slow = command in _SLOW
        if is_slow and slow is None:
            slow = self._slow = SlowCommand(index, command, begun)
        timeout = patience if is_slow else ANSWER_TIMEOUT
        end, look = begun + timeout, begun + ANSWER_TIMEOUT
        while True:
            self._hear()
            answer = self._answers.get(index)
            if answer is not None:
                self._forget(index)
                if is_slow:
                    self._slow = None
                break
            if not self.is_alive:
                raise DaemonError(f"the servo process has ended, it cannot {command.name.lower()}")
            now = time.monotonic()
            if now > look:
                look = now + _LOOK
                if self.is_stopped:
                    self._slow = None
                    self._give_up(index)
                    raise DaemonError(
                        f"the servo process {self.process.pid} is stopped (SIGSTOP or a debugger), "
                        f"it cannot {command.name.lower()}"
                    )
            if now > end and slow is not None:
                raise PendingError(_progress(slow))
            if now > end:
                self._give_up(index)
                raise DaemonError(
                    f"the servo did not answer {command.name.lower()} within {timeout:g} s"
                )
            time.sleep(_POLL)
        if answer.code == Answer.NOT_YET:
            raise NotYetError(answer.text)
        if answer.code in (Answer.WRONG_STATE, Answer.REFUSED):
            raise StateError(answer.text)
        if answer.code != Answer.DONE:
            raise DaemonError(f"{command.name.lower()} failed: {answer.text}")

    def _under_way(self, command: Command, now: float) -> SlowCommand | None:
        """Return the slow command that the servo is busy with, if any.

        Raises:
            PendingError: *command* would have to wait for it.
        """
        self._hear()
        slow = self._slow
        if slow is None:
            return None
        is_again = command is slow.command
        if slow.number in self._answers and now - slow.begun > _LATE_ANSWER:
            self._forget(slow.number)
            self._slow = None
            return None
        if slow.number in self._answers and not is_again:
            return None
        if is_again or command in _STOPPING:
            return slow
        raise PendingError(_progress(slow))

    def stop(self) -> None:
        """Have the servo stop on its path as soon as it hears of it; waits for no answer."""
        self._forget(self._post(Command.STOP, 0, 0, UNKNOWN, UNKNOWN, 0, 0.0, *_NO_TERMS.floats()))

    def _give_up(self, index: int) -> None:
        """Wait for a command no longer, which then is not carried out."""
        self.memory.commands.words[GIVEN_UP_WORD] = index + 1
        self._forget(index)

    def _forget(self, index: int) -> None:
        """Keep no answer to a command, whether it has come or not."""
        with self._lock:
            self._awaited.discard(index)
            self._answers.pop(index, None)

    def _post(self, *fields: float) -> int:
        """Put a command where the servo looks for it; return its number."""
        with self._lock:
            index = self.memory.commands.head
            self._awaited.add(index)
            if fields[0] == Command.RESET:
                self._reset = index
            self.memory.commands.publish(*fields)
        return index

    def tune(self, options: Mapping[str, Any]) -> None:
        """Have the driver take *options* for the motions to come.

        Raises:
            StateError: the device does not hold still, or the driver refuses.
            DaemonError: the servo does not answer, or is not there.
        """
        text = tuning_text(options)
        self.memory.tunings.publish(len(text), text)
        self.ask(Command.TUNE)

    def words(self) -> list[Note]:
        """Return what the servo has said, apart from answers, since this was last called."""
        self._hear()
        with self._lock:
            heard = list(self._words)
            self._words.clear()
        return heard

    def stops(self) -> list[Stop]:
        """Return the stops that the servo took by itself since this was last called."""
        with self._lock:
            ring = self.memory.stops
            first, self._stop_index = ring.oldest(self._stop_index), ring.head
            taken = [ring.read(index) for index in range(first, self._stop_index)]
        return [Stop(*fields) for fields in taken if fields is not None]

    def newest(self) -> Cycle | None:
        """Return the newest cycle, or ``None`` before the first."""
        ring = self.memory.cycles
        while ring.head:
            head = ring.head
            record = ring.read_bytes(head - 1)
            if record is not None:
                return unpack_cycle(record)
        return None

    @property
    def next_cycle(self) -> int:
        """Number of the cycle that comes next."""
        return self.memory.cycles.head

    def cycle_records(self, since: int, limit: int) -> list[bytes]:
        """Return the records of cycles ``since, since + 1, ...``, as far as still in the ring."""
        ring = self.memory.cycles
        head = ring.head
        first = max(since, head - ring.capacity + 16, 0)
        found = (ring.read_bytes(index) for index in range(first, min(head, first + limit)))
        return [record for record in found if record is not None]

    def end(self, timeout: float) -> None:
        """Have the process stop on its path and end; kill it when it has not after *timeout* s."""
        if self.is_alive:
            if self.is_stopped:
                # It cannot stop on its path, nor end, unless it goes on.
                self.process.send_signal(signal.SIGCONT)
            with contextlib.suppress(DaemonError, StateError):
                self.ask(Command.SHUTDOWN)
            deadline = time.monotonic() + timeout
            while self.is_alive and time.monotonic() < deadline:
                self.beat()
                time.sleep(_LOOK_FOR_END)
            if self.is_alive:
                self.process.kill()
        self.process.wait()

    def ends_within(self, seconds: float) -> bool:
        """Wait for a process that is on its way out; return whether it has ended."""
        deadline = time.monotonic() + seconds
        while self.is_alive and time.monotonic() < deadline:
            time.sleep(_LOOK_FOR_END)
        return not self.is_alive

    def close(self) -> None:
        """Release the shared memory; the process has ended."""
        self.memory.close()

    def _hear(self) -> None:
        with self._lock:
            ring = self.memory.notes
            while self._note_index < ring.head:
                record = ring.read_bytes(self._note_index)
                if record is None:
                    if self._note_index == (oldest := ring.oldest(self._note_index)):
                        return  # being written
                    self._note_index = oldest
                    continue
                self._note_index += 1
                note = unpack_note(record)
                if note.kind is NoteKind.ANSWER:
                    if note.command in self._awaited:
                        self._answers[note.command] = note
                    if note.command == self._reset and note.code == Answer.DONE:
                        # What was wrong before is over.
                        left = [word for word in self._words if word.kind is not NoteKind.FAULT]
                        self._words = deque(left, self._words.maxlen)
                else:
                    self._words.append(note)


def _progress(slow: SlowCommand) -> str:
    taken = time.monotonic() - slow.begun
    return (
        f"{slow.command.name.lower()} is under way, for {taken:.1f} s so far: the device takes its "
        "time; ask again"
    )


def report_directory() -> str:
    """Return where servo processes write down why they ended (the XDG state directory)."""
    home = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")  # noqa: PTH111
    directory = os.path.join(home, "orientd")  # noqa: PTH118
    os.makedirs(directory, mode=0o700, exist_ok=True)  # noqa: PTH103
    return directory


def servo_limits_of(limits: Limits, brake_rate: float) -> ServoLimits:
    """Return what the servo's guard is to keep."""
    return ServoLimits(
        limits.velocity,
        limits.acceleration,
        limits.jerk,
        limits.linear_velocity,
        limits.linear_acceleration,
        brake_rate,
        limits.axis_velocity,
        limits.axis_acceleration,
        limits.axis_jerk,
    )
