"""The servo process of one device: start it, give it commands, read its notes, restart it.

Commands may be given from any thread.  The device calls everything else with its own lock held.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from orientd.config import DeviceSettings
from orientd.daemon.device.event import EventKind
from orientd.daemon.report_directory import report_directory
from orientd.driver import Explaining, PartHealth, driver_target, python_command, python_version
from orientd.errors import GOING_DOWN, ConfigError, DaemonError, Fault, NotYetError, StateError
from orientd.servo.settings import ProcessSettings
from orientd.stream.memory import (
    GIVEN_UP_WORD,
    LONGEST_READ_WORD,
    LONGEST_WRITE_WORD,
    SharedMemory,
    newest_health,
    tuning_text,
)
from orientd.stream.records import (
    HELD_WORD,
    UNKNOWN,
    Answer,
    Command,
    Cycle,
    Note,
    NoteKind,
    ServoLimits,
    ServoState,
    Stop,
    unpack_cycle,
    unpack_note,
)

if TYPE_CHECKING:
    from orientd.daemon.stops import StopFolder

ANSWER_TIMEOUT = 0.5
"""How long an ordinary command may take, s; at least as long as the device's ``stall_timeout``."""

SLOW_ANSWER_TIMEOUT = 60.0
"""How long a command may take for which the driver talks to the device at length, s."""

_SLOW = (Command.ENABLE, Command.DISABLE, Command.RESET, Command.FREE)
_STOPPING = (Command.STOP, Command.HALT, Command.SHUTDOWN)
_BEGINNING = (Command.ENABLE, Command.START, Command.SPLICE, Command.TRACK)
_POLL, _SLOW_POLL, _LOOK = 0.0005, 0.005, 0.05
_NO_LIMITS = ServoLimits(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

_LONGEST_END = 30.0
"""How long a servo may take to stop on its path and to park its device, s."""

_MOST_RECORDS = 1 << 17

_UNREADY = {
    "streaming": "; stop the current motion first",
    "tracking": "; end the following of targets first",
}

Tell = Callable[[EventKind, str], None]


class _SlowCommand(NamedTuple):
    """The command that the servo is busy with, and since when, monotonic s."""

    number: int
    command: Command
    begun: float

    def describe(self, now: float) -> str:
        """Return in words that it has no answer at *now*, monotonic s."""
        taken = f"{self.command.name.lower()} is under way, for {now - self.begun:.1f} s"
        return f"{taken} so far: the device has not answered yet"


class _BusyError(StateError):
    """The servo is busy with a command for which the driver talks to the device at length."""


class ServoProcess:
    """Manage the servo process of one device, and its faults.

    Attributes:
        fault: why the device is in a fault, if the servo has reported it.
        fault_text: in words.
        failure: why there is no servo; empty while there is one.
        scheduling: what scheduling the process has got.
        memory_locked: whether its memory is locked.
        health: how the device's parts are, as last heard.
        is_aborting: whether commands other than stops fail at once instead of waiting.
        memory: shared with the process, also after its end; ``None`` before the first.
    """

    def __init__(
        self,
        settings: DeviceSettings,
        *,
        read_ahead: int,
        tell: Tell,
        explaining: Explaining | None = None,
        stops: StopFolder | None = None,
    ) -> None:
        """Start nothing yet.

        Args:
            settings: the device's part of the configuration.
            read_ahead: path records that are kept ahead of the servo, a power of two.
            tell: called when the servo is ready, in a fault, or has ended.
            explaining: the driver, if it knows what ends the process.
            stops: folder of the socket at which the servo listens for stops.

        Raises:
            ConfigError: the driver is not installed, or its interpreter cannot be used.
        """
        self._settings = settings
        if settings.python:
            try:
                python_version(settings.python)
            except ConfigError as error:
                raise ConfigError(f"devices.{settings.name}.python: {error}") from error
        self._target = driver_target(settings.driver)
        self._cones = settings.to_keep_out()
        self._read_ahead = read_ahead
        self._tell = tell
        self._explaining, self._stops = explaining, stops
        self._lock = threading.Lock()
        self._ready = threading.Event()
        self._has_ended = self.is_aborting = False
        self._process: subprocess.Popen[bytes] | None = None
        self.memory: SharedMemory | None = None
        self._forget()

    def _forget(self) -> None:
        """Know nothing of a process that has not started yet."""
        self.fault = Fault.NONE
        self.fault_text = ""
        self.failure = ""
        self.scheduling = ""
        self.memory_locked = False
        self.health: tuple[PartHealth, ...] = ()
        self._health_read = 0
        self._last_words, self._last_fault = "", Fault.NONE
        self._note_index = self._stop_index = 0
        self._answers: dict[int, Note] = {}
        self._awaited: set[int] = set()
        self._clearing = UNKNOWN
        self._slow: _SlowCommand | None = None
        self._words: deque[Note] = deque(maxlen=256)

    # Life

    def start(self) -> None:
        """Start the process in the place of the one before, and return at once.

        Raises:
            DaemonError: it cannot be started.
        """
        if self._has_ended:
            raise DaemonError(GOING_DOWN)
        self._ready.clear()
        # A thread that still reads the old memory keeps it alive.
        self._process = self.memory = None
        self._forget()
        settings = self._process_settings()
        try:
            self.memory = SharedMemory.create(settings.path_capacity, settings.cycle_capacity)
            self.memory.beat(time.monotonic_ns())
            self._process = self._begin(settings, self.memory.descriptor)
        except OSError as error:
            missing = "no shared memory for the servo process"
            what = missing if self.memory is None else "the servo process cannot be started"
            self.fail(Fault.SERVO_DIED, f"{what}: {error}")
            raise DaemonError(self.failure) from error

    def _begin(self, settings: ProcessSettings, descriptor: int) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            python_command(
                self._settings.python, "orientd.servo", settings.driver, str(descriptor)
            ),
            stdin=subprocess.PIPE,
            pass_fds=[descriptor],
            # Out of the reach of a Ctrl-C, yet in the daemon's session: the kernel shares
            # processor time by session (autogroup), and one by itself was kept waiting for 1 s.
            process_group=0,
            cwd="/",
        )
        if process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.write(settings.to_json().encode())
                process.stdin.close()
        return process

    def _process_settings(self) -> ProcessSettings:
        settings = self._settings
        return ProcessSettings(
            device=settings.name,
            driver=self._target,
            options=settings.options,
            period_ns=settings.period_ns,
            phase_ns=settings.phase_ns,
            # Twice what is read ahead, and more for motions that take long to stop.
            path_capacity=max(2 * self._read_ahead, min(8 * self._read_ahead, _MOST_RECORDS)),
            cycle_capacity=self._read_ahead,
            heartbeat_timeout_ns=round(settings.heartbeat_timeout * 1e9),
            feedback_timeout_ns=round(settings.feedback_timeout * 1e9),
            stall_timeout_ns=round(settings.stall_timeout * 1e9),
            priority=settings.priority,
            spin_ns=settings.spin_us * 1000,
            daemon_pid=os.getpid(),
            report_path=os.path.join(report_directory(), f"servo-{settings.name}.json"),  # noqa: PTH118
            stop_path="" if self._stops is None else self._stops.path(settings.name),
            admitted={} if self._stops is None else self._stops.admitted,
            keep_out=self._cones,
        )

    @property
    def is_alive(self) -> bool:
        """Whether the process runs."""
        process = self._process
        return process is not None and process.poll() is None

    @property
    def pid(self) -> int | None:
        """The number of the process; ``None`` if none runs."""
        process = self._process
        return process.pid if process is not None and self.is_alive else None

    def wait_ready(self, timeout: float) -> bool:
        """Wait until the servo runs its cycles, or has failed to; return which."""
        self._ready.wait(timeout)
        return self._ready.is_set() and not self.failure

    def running(self) -> SharedMemory:
        """Return the memory shared with the process, which runs.

        Raises:
            DaemonError: it does not.
        """
        memory = self.memory
        if self._has_ended:
            raise DaemonError(GOING_DOWN)
        if memory is None or not self.is_alive:
            why = f": {self.failure}" if self.failure else ""
            raise DaemonError(
                f"device {self._settings.name} has no servo process{why}; reset it first"
            )
        return memory

    def beat(self) -> None:
        """Tell the servo, if there is one, that the daemon is alive."""
        if self.memory is not None:
            self.memory.beat(time.monotonic_ns())

    def end(self) -> None:
        """Stop on the path and end the process; kill it if that takes too long.

        No process starts in its place.  Its memory can still be read.
        """
        process = self._process
        if process is not None and self.is_alive:
            if self._is_stopped(process):
                # A suspended process can neither stop on its path nor end.
                process.send_signal(signal.SIGCONT)
            with contextlib.suppress(DaemonError, StateError):
                self.ask(Command.SHUTDOWN)
            self._has_ended = True
            if not self.ends_within(_LONGEST_END):
                process.kill()
            process.wait()
        self._has_ended = True

    def ends_within(self, seconds: float) -> bool:
        """Wait for the process to end; return whether it has."""
        deadline = time.monotonic() + seconds
        while self.is_alive and time.monotonic() < deadline:
            self.beat()
            time.sleep(_SLOW_POLL)
        return not self.is_alive

    def _is_stopped(self, process: subprocess.Popen[bytes]) -> bool:
        """Whether a signal or a debugger has stopped the process, which then does nothing."""
        try:
            with open(f"/proc/{process.pid}/stat") as stat:  # noqa: PTH123 - no pathlib here
                return stat.read().rpartition(")")[2].split()[0] in "tT"
        except OSError:
            return False

    # Commands

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
        servo_limits: ServoLimits = _NO_LIMITS,
    ) -> float:
        """Send a command and wait until the servo has taken it.

        If the sender has given up waiting, the servo drops the command, unless it is a stop.  While
        the driver talks to the device at length, a stop waits for :data:`ANSWER_TIMEOUT` only.

        Args:
            command: what to do.
            motion, path_index, leave_index, final_index, start_ns, speed, servo_limits: see
                :class:`~orientd.stream.records.Command`.

        Returns:
            When the servo could see the command, monotonic s.

        Raises:
            NotYetError: not while the speed is changing.
            StateError: the servo's state does not allow it, it was refused, or the servo is busy.
            DaemonError: the servo does not answer, is not there, or has been given up.
        """
        memory = self.running()
        if self.failure and command in _BEGINNING:
            raise DaemonError(f"device {self._settings.name}: {self.failure}; reset it first")
        values = (motion, path_index, leave_index, final_index, start_ns, speed)
        index = self._post(memory, command, *values, *servo_limits.floats())
        posted = time.monotonic()
        if command in _STOPPING and not memory.cycles.head:
            self._take(index)
            return posted  # nothing has been sent yet
        answer = self._await(memory, index, command, posted)
        if answer.code == Answer.NOT_YET:
            raise NotYetError(answer.text)
        if answer.code in (Answer.WRONG_STATE, Answer.REFUSED):
            raise StateError(answer.text)
        if answer.code != Answer.DONE:
            raise DaemonError(f"{command.name.lower()} failed: {answer.text}")
        if command in _SLOW:
            self._await_cycle(memory)
        return posted

    def tune(self, options: Mapping[str, Any]) -> None:
        """Set options of the driver for the following motions.

        Raises:
            StateError: the device does not hold still, or the driver refuses.
            DaemonError: the servo does not answer, or is not there.
        """
        text = tuning_text(options)
        self.running().tunings.publish(len(text), text)
        self.ask(Command.TUNE)

    def brake(self) -> None:
        """Tell the servo to stop on its path; do not wait for an answer."""
        with contextlib.suppress(DaemonError):
            memory = self.running()
            values = (0, 0, UNKNOWN, UNKNOWN, 0, 0.0)
            self._take(self._post(memory, Command.STOP, *values, *_NO_LIMITS.floats()))

    def _post(self, memory: SharedMemory, command: Command, *fields: float) -> int:
        """Put a command where the servo looks for it; return its number.

        Raises:
            _BusyError: the servo is busy with another one.
        """
        with self._lock:
            now, slow = time.monotonic(), self._slow
            if slow is not None and command not in _STOPPING:
                raise _BusyError(slow.describe(now))
            index = memory.commands.head
            self._awaited.add(index)
            if command in (Command.ENABLE, Command.RESET):
                self._clearing = index
            if command in _SLOW:
                self._slow = _SlowCommand(index, command, now)
            memory.commands.publish(command, *fields)
        return index

    def _await(self, memory: SharedMemory, index: int, command: Command, begun: float) -> Note:
        """Return the servo's answer to a command.

        Raises:
            DaemonError: there is none in time.
        """
        name, busy = command.name.lower(), self._slow if command in _STOPPING else None
        timeout = ANSWER_TIMEOUT if busy else max(ANSWER_TIMEOUT, self._settings.stall_timeout)
        if command in _SLOW:
            timeout = SLOW_ANSWER_TIMEOUT
        look = begun + ANSWER_TIMEOUT
        while (answer := self._take(index, is_awaited=True)) is None:
            now = time.monotonic()
            problem = ""
            if self.is_aborting and command not in _STOPPING:
                problem = GOING_DOWN
            elif not self.is_alive:
                problem = f"the servo process has ended, it cannot {name}"
            elif now > look:
                look = now + _LOOK
                process = self._process
                if process is not None and self._is_stopped(process):
                    problem = (
                        f"the servo process {process.pid} is stopped (SIGSTOP or a debugger), it "
                        f"cannot {name}"
                    )
                elif now > begun + timeout:
                    silent = f"the servo did not answer {name} within {timeout:g} s"
                    problem = busy.describe(now) if busy else silent
            if problem:
                if command not in _STOPPING:
                    memory.commands.words[GIVEN_UP_WORD] = index + 1
                self._take(index)
                raise DaemonError(problem)
            time.sleep(_POLL if now < begun + ANSWER_TIMEOUT else _SLOW_POLL)
        return answer

    def _await_cycle(self, memory: SharedMemory) -> None:
        """Wait for a cycle that shows what a command has changed: its answer comes before that."""
        head, end = memory.cycles.head, time.monotonic() + ANSWER_TIMEOUT
        while memory.cycles.head == head and self.is_alive and time.monotonic() < end:
            time.sleep(_POLL)

    def _take(self, index: int, *, is_awaited: bool = False) -> Note | None:
        """Return the answer to a command, if it has come.

        Args:
            index: number of the command.
            is_awaited: whether the caller will still wait for a missing answer.
        """
        self._listen()
        with self._lock:
            answer = self._answers.pop(index, None)
            if answer is not None or not is_awaited:
                self._awaited.discard(index)
                if self._slow is not None and self._slow.number == index:
                    self._slow = None
            return answer

    def _listen(self) -> None:
        """Read the notes that the servo has written since this was last called."""
        memory = self.memory
        if memory is None:
            return
        with self._lock:
            ring = memory.notes
            while self._note_index < ring.head:
                record = ring.read_bytes(self._note_index)
                if record is None:
                    if self._note_index == (oldest := ring.oldest(self._note_index)):
                        return  # being written
                    self._note_index = oldest
                    continue
                self._note_index += 1
                note = unpack_note(record)
                if note.kind is not NoteKind.ANSWER:
                    self._words.append(note)
                    continue
                if note.command in self._awaited:
                    self._answers[note.command] = note
                if note.command == self._clearing and note.code == Answer.DONE:
                    # A servo that was reset or enabled has none of the earlier faults.
                    left = [word for word in self._words if word.kind is not NoteKind.FAULT]
                    self._words = deque(left, self._words.maxlen)
                    if not self.failure:
                        self.fault, self.fault_text = Fault.NONE, ""

    def leave_fault(self) -> None:
        """Clear the servo's fault; enable the device if so configured.

        Raises:
            StateError: the driver cannot, or the device is not one to be enabled.
            DaemonError: the servo does not answer, or is not there.
        """
        try:
            self.ask(Command.RESET)
        except StateError:
            cycle, is_known = self.newest(), self.failure or self.fault is not Fault.NONE
            if not is_known or cycle is None or cycle.state is not ServoState.HOLDING:
                raise
            # A servo that holds has no fault: the fault was the daemon's own.
        self.fault, self.fault_text, self.failure = Fault.NONE, "", ""
        if self._settings.auto_enable:
            self.ask(Command.ENABLE)

    # What the process publishes

    def newest(self) -> Cycle | None:
        """Return the newest cycle of a process that runs; ``None`` before the first."""
        return self.last() if self.is_alive else None

    def last(self) -> Cycle | None:
        """Return the newest cycle, also of a process that has ended; ``None`` before the first."""
        memory = self.memory
        while memory is not None and (head := memory.cycles.head):
            record = memory.cycles.read_bytes(head - 1)
            if record is not None:
                return unpack_cycle(record)
        return None

    def commanded(self) -> Cycle:
        """Return a cycle in which the device holds: where a motion from rest begins.

        Raises:
            StateError: the device is not holding.
            DaemonError: there is no servo.
        """
        self.running()
        cycle = self.newest()
        if cycle is not None and cycle.state is ServoState.HOLDING:
            return cycle
        state = "not ready" if cycle is None else cycle.state.name.lower()
        advice, problem = _UNREADY.get(state, ""), self.fault_text
        if state == "idle":
            advice = f": {problem}; then reset it" if problem else "; enable it first"
        elif cycle is not None and cycle.state is ServoState.FAULT:
            # The words of a new fault arrive after its code.
            advice = f": {problem or Fault(cycle.fault).name.lower()}; reset it first"
        raise StateError(f"device {self._settings.name} is {state}, not holding{advice}")

    @property
    def next_cycle(self) -> int:
        """Number of the next cycle; a restarted process begins with 0."""
        memory = self.memory
        return 0 if memory is None else memory.cycles.head

    def cycle_records(self, since: int, limit: int) -> list[bytes]:
        """Return the records of cycles from number *since* on, as far as they are still known."""
        memory = self.memory
        if memory is None:
            return []
        ring = memory.cycles
        first = max(since, ring.head - ring.capacity + 16, 0)
        return ring.records(first, first + limit)

    def stops(self) -> list[Stop]:
        """Return the stops that the servo took by itself since this was last called."""
        memory = self.memory
        if memory is None or memory.stops.head == self._stop_index:
            return []
        with self._lock:
            ring = memory.stops
            first, self._stop_index = ring.oldest(self._stop_index), ring.head
            taken = [ring.read(index) for index in range(first, self._stop_index)]
        return [Stop(*fields) for fields in taken if fields is not None]

    @property
    def longest_calls(self) -> dict[str, float]:
        """How long the driver's longest ``read`` and ``write`` took, s; empty without a servo."""
        memory = self.memory
        words = {"read": LONGEST_READ_WORD, "write": LONGEST_WRITE_WORD}
        return (
            {} if memory is None else {call: memory.pulse[at] * 1e-9 for call, at in words.items()}
        )

    @property
    def held_at(self) -> str:
        """Name of the keep-out cone that keeps the device from its target; empty if none does."""
        memory, cones = self.memory, self._cones
        place = 0 if memory is None else memory.targets.words[HELD_WORD]
        return cones[place - 1].name if 0 < place <= len(cones) else ""

    # What the process says

    def read_notes(self) -> None:
        """Process the servo's notes since the last call."""
        memory = self.memory
        if memory is None:
            return
        self._listen()
        while self._words:
            note = self._words.popleft()
            if note.kind is NoteKind.READY:
                self._last_fault = Fault.NONE
                got = json.loads(note.text)
                self.scheduling, self.memory_locked = got["scheduling"], got["memory_locked"]
                name = f"start {self._settings.name}"
                ready = threading.Thread(
                    target=self._become_ready, args=(memory,), name=name, daemon=True
                )
                ready.start()
            elif note.kind is NoteKind.FAULT:
                self.fault = Fault(note.code)
                name = self.fault.name.lower()
                self.fault_text = note.text or name
                self._tell(EventKind.FAULT, f"{name}: {self.fault_text}")
            elif note.kind is NoteKind.ENDING:
                self._last_words, self._last_fault = note.text, Fault(note.code)
            elif note.kind is NoteKind.NOTICE:
                self._tell(EventKind.WARNING, note.text)
        if memory.health.head != self._health_read:
            self._read_health(memory)

    def _read_health(self, memory: SharedMemory) -> None:
        """Update the health of the device's parts; warn of each new problem."""
        self._health_read = memory.health.head
        known = {part.warning for part in self.health}
        self.health = newest_health(memory.health) or self.health
        for part in self.health:
            if part.warning and part.warning not in known:
                self._tell(EventKind.WARNING, part.warning)

    def _become_ready(self, memory: SharedMemory) -> None:
        """Enable the device if so configured, which may take long; then the servo is ready."""
        problem = ""
        if self._settings.auto_enable:
            try:
                self.ask(Command.ENABLE)
            except _BusyError:
                # A client's command has come first, and decides.
                while self._slow is not None:
                    time.sleep(_SLOW_POLL)
            except (StateError, DaemonError) as error:
                problem = str(error)
        if self.memory is not memory or not self.is_alive:
            return  # it has ended meanwhile
        newest = self.newest()
        if problem and (newest is None or newest.state is ServoState.IDLE):
            # A servo in a fault reports the reason itself, and in other states it is enabled.
            self.fault, self.fault_text = Fault.DEVICE_FAULT, problem
            self._tell(EventKind.FAULT, problem)
        self._tell(EventKind.READY, self.scheduling)
        self._ready.set()

    def lose(self) -> None:
        """Read the last notes of a process that has ended, and why it ended."""
        self.read_notes()
        code = 0 if self._process is None else self._process.returncode
        ended = f"by signal {-code}" if code < 0 else f"with status {code}"
        reason = self._explaining.why_ended(-code) if code < 0 and self._explaining else ""
        died = f"the servo process was ended {ended}" + (f": {reason}" if reason else "")
        self.failure = self._last_words or died
        if self.fault is not Fault.LINK_LOST:
            # A driver whose link is spent takes its process with it; the link is the reason.
            self.fail(self._last_fault or Fault.SERVO_DIED, self.failure)
        self._ready.set()
        self._tell(EventKind.SERVO_DIED, self.failure)

    def fail(self, fault: Fault, failure: str) -> None:
        """Do without a servo from now on."""
        self.fault, self.failure, self.fault_text = fault, failure, failure
