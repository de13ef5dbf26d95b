"""The life of a device's servo process: started, heard, lost, started again."""

from __future__ import annotations

import contextlib
import json
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from orientd.config import DeviceSettings
from orientd.daemon.devices.device_report import EventKind
from orientd.daemon.devices.servo_link import (
    SLOW_ANSWER_TIMEOUT,
    ServoLink,
    report_directory,
)
from orientd.driver import Explaining, PartHealth, driver_target, python_version
from orientd.errors import GOING_DOWN, ConfigError, DaemonError, Fault, PendingError, StateError
from orientd.servo import ProcessSettings
from orientd.stream import (
    LONGEST_READ_WORD,
    LONGEST_WRITE_WORD,
    Command,
    Cycle,
    NoteKind,
    ServoState,
    newest_health,
)

_LONGEST_END = 30.0
"""How long a servo may take to stop on its path and to park its device, s."""

_JUST_NOW = 0.5

if TYPE_CHECKING:
    from orientd.daemon.stops import StopFolder

Tell = Callable[[EventKind, str], None]


_MOST_RECORDS = 1 << 17


def path_capacity(read_ahead: int) -> int:
    """Return how many path records a ring has room for.

    That is twice what is read ahead, and more for motions that take long to stop, unless this is a
    great many records.
    """
    return max(2 * read_ahead, min(8 * read_ahead, _MOST_RECORDS))


class ServoSupervisor:
    """The servo process of one device, and what is wrong with it.

    Not locked: the device calls it with its own lock held.  What only looks needs no lock.

    Attributes:
        link: to the process, which may have ended; ``None`` where there is none.
        fault: why the device is in a fault, as far as that was heard.
        fault_text: in words.
        failure: why there is no servo; empty while there is one.
        scheduling: what scheduling the process has got.
        memory_locked: whether its memory is locked.
        health: how the device's parts are, as last heard.
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
            tell: is told of a servo that is ready, in a fault, or has ended.
            explaining: the driver, if it knows what ends the process.
            stops: where the servo listens for stops that the daemon has no part in.

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
        self._read_ahead = read_ahead
        self._tell = tell
        self._explaining = explaining
        self._stops = stops
        self._ready = threading.Event()
        self._has_ended = False
        self._failed = 0.0
        self.link: ServoLink | None = None
        self._forget()

    def _forget(self) -> None:
        """Know nothing of a servo that is not there yet."""
        self.fault = Fault.NONE
        self.fault_text = ""
        self.failure = ""
        self._last_words, self._last_fault = "", Fault.NONE
        self.scheduling = ""
        self.memory_locked = False
        self.health: tuple[PartHealth, ...] = ()
        self._health_heard = 0
        self._is_starting = False

    # The process

    def start(self) -> None:
        """Start the process in the place of the one before, and return at once.

        Raises:
            DaemonError: it cannot be started.
        """
        if self._has_ended:
            raise DaemonError(GOING_DOWN)
        if self.link is not None:
            self.link.close()
        self._ready.clear()
        self._forget()
        try:
            self.link = ServoLink(self._process_settings(), self._settings.python)
        except DaemonError as error:
            self.link = None
            self._fail(Fault.SERVO_DIED, str(error))
            raise

    def _process_settings(self) -> ProcessSettings:
        settings = self._settings
        return ProcessSettings(
            device=settings.name,
            driver=self._target,
            options=settings.options,
            period_ns=settings.period_ns,
            phase_ns=settings.phase_ns,
            path_capacity=path_capacity(self._read_ahead),
            cycle_capacity=self._read_ahead,
            heartbeat_timeout_ns=round(settings.heartbeat_timeout * 1e9),
            feedback_timeout_ns=round(settings.feedback_timeout * 1e9),
            stall_timeout_ns=round(settings.stall_timeout * 1e9),
            priority=settings.priority,
            spin_ns=settings.spin_us * 1000,
            daemon_pid=os.getpid(),
            report_path=str(Path(report_directory()) / f"servo-{settings.name}.json"),
            stop_path="" if self._stops is None else self._stops.path(settings.name),
            admitted={} if self._stops is None else self._stops.admitted,
        )

    def beat(self) -> None:
        """Tell the servo, if there is one, that the daemon is alive."""
        link = self.link
        if link is not None:
            with contextlib.suppress(ValueError):  # closed meanwhile
                link.beat()

    def wait_ready(self, timeout: float) -> bool:
        """Wait until the servo runs its cycles, or has failed to; return which."""
        self._ready.wait(timeout)
        return self._ready.is_set() and not self.failure

    def running(self) -> ServoLink:
        """Return the link to the process, which runs.

        Raises:
            DaemonError: it does not.
        """
        link = self.link
        if self._has_ended:
            raise DaemonError(GOING_DOWN)
        if link is None or not link.is_alive:
            raise DaemonError(
                f"device {self._settings.name} has no servo process"
                + (f": {self.failure}" if self.failure else "")
                + "; reset it first"
            )
        return link

    def end(self) -> ServoLink | None:
        """Have the process stop on its path and end; return the link to it, which is to be closed.

        Until then its memory can be read.
        """
        self._has_ended = True
        link, self.link = self.link, None
        if link is not None:
            link.end(timeout=_LONGEST_END)
        return link

    # What it publishes

    @property
    def pid(self) -> int | None:
        """The number of the process; ``None`` where none runs."""
        link = self.link
        return link.process.pid if link is not None and link.is_alive else None

    def newest(self) -> Cycle | None:
        """Return the newest cycle of a process that runs; ``None`` before the first."""
        link = self.link
        return link.newest() if link is not None and link.is_alive else None

    @property
    def longest_calls(self) -> dict[str, float]:
        """How long the driver's longest ``read`` and ``write`` took, s; empty without a servo."""
        link = self.link
        with contextlib.suppress(ValueError):  # closed meanwhile
            if link is not None:
                pulse = link.memory.pulse
                words = {"read": LONGEST_READ_WORD, "write": LONGEST_WRITE_WORD}
                return {call: pulse[word] * 1e-9 for call, word in words.items()}
        return {}

    @property
    def next_cycle(self) -> int:
        """Number of the cycle that comes next; a process that is started anew begins with 0."""
        link = self.link
        return 0 if link is None else link.next_cycle

    def cycle_records(self, since: int, limit: int) -> list[bytes]:
        """Return the records of cycles from number *since* on, as far as they are still known."""
        link = self.link
        return [] if link is None else link.cycle_records(since, limit)

    # What it says

    def hear(self) -> None:
        """Take note of what the servo has said since this was last called."""
        link = self.link
        if link is None:
            return
        for note in link.words():
            if note.kind is NoteKind.READY:
                self._become_ready(link, note.text)
            elif note.kind is NoteKind.FAULT:
                self.fault = Fault(note.code)
                name = self.fault.name.lower()
                self.fault_text = note.text or name
                self._tell(EventKind.FAULT, f"{name}: {self.fault_text}")
            elif note.kind is NoteKind.ENDING:
                self._last_words, self._last_fault = note.text, Fault(note.code)
            elif note.kind is NoteKind.NOTICE:
                self._tell(EventKind.WARNING, note.text)
        if link.memory.health.head != self._health_heard:
            self._hear_health(link)
        if self._is_starting:
            self._enable_at_start(link, patience=0.0)

    def _hear_health(self, link: ServoLink) -> None:
        """Take note of how the device's parts are; warn of what was well before."""
        self._health_heard = link.memory.health.head
        known = {part.warning for part in self.health}
        self.health = newest_health(link.memory.health) or self.health
        for part in self.health:
            if part.warning and part.warning not in known:
                self._tell(EventKind.WARNING, part.warning)

    def _become_ready(self, link: ServoLink, text: str) -> None:
        self._last_fault = Fault.NONE
        got = json.loads(text)
        self.scheduling, self.memory_locked = got["scheduling"], got["memory_locked"]
        self._enable_at_start(link)

    def _enable_at_start(self, link: ServoLink, patience: float = SLOW_ANSWER_TIMEOUT) -> None:
        """Enable the device if so configured, and be ready once that is done."""
        self._is_starting = False
        if self._settings.auto_enable:
            try:
                link.ask(Command.ENABLE, patience=patience)
            except PendingError:
                self._is_starting = True
                return
            except (StateError, DaemonError) as error:
                self.fault, self.fault_text = Fault.DEVICE_FAULT, str(error)
                self._tell(EventKind.FAULT, self.fault_text)
        self._tell(EventKind.READY, self.scheduling)
        self._ready.set()

    # What is wrong with it

    def lose(self, link: ServoLink) -> None:
        """Say that the process has ended, whatever ended it."""
        code = link.process.returncode
        ended = f"by signal {-code}" if code < 0 else f"with status {code}"
        reason = self._explaining.why_ended(-code) if code < 0 and self._explaining else ""
        died = f"the servo process was ended {ended}" + (f": {reason}" if reason else "")
        self.failure = self._last_words or died
        if self.fault is not Fault.LINK_LOST:
            # A driver whose link is spent takes its process with it; the link is the reason.
            self._fail(self._last_fault or Fault.SERVO_DIED, self.failure)
        self._ready.set()
        self._tell(EventKind.SERVO_DIED, self.failure)

    def give_up(self, error: Exception) -> None:
        """Do without a servo that could not be watched because of *error*."""
        self._fail(Fault.INTERNAL, f"{type(error).__name__}: {error}")

    @property
    def has_just_failed(self) -> bool:
        """Whether it is a moment ago that the servo was lost."""
        return bool(self.failure) and time.monotonic() - self._failed < _JUST_NOW

    def _fail(self, fault: Fault, failure: str) -> None:
        self._failed = time.monotonic()
        self.failure = self.fault_text = failure
        self.fault = fault

    def leave_fault(self, link: ServoLink, ends: float) -> None:
        """Have the servo leave its fault; enable the device if so configured.

        Args:
            link: to the servo.
            ends: until when to wait for it, s of the monotonic clock.

        Raises:
            PendingError: the device takes its time; to be called again.
            StateError: the driver cannot, or the device is not one to be enabled.
            DaemonError: the servo does not answer, or is not there.
        """
        cycle = link.newest()
        if self._settings.auto_enable and link.busy_with is Command.ENABLE:
            # What is left of a reset that took its time.
            link.ask(Command.ENABLE, patience=max(ends - time.monotonic(), 0.05))
            return
        if not (self.failure and cycle is not None and cycle.state is ServoState.HOLDING):
            # Else the failure was the daemon's own.
            link.ask(Command.RESET, patience=max(ends - time.monotonic(), 0.05))
        self.fault, self.fault_text, self.failure = Fault.NONE, "", ""
        if self._settings.auto_enable:
            link.ask(Command.ENABLE, patience=max(ends - time.monotonic(), 0.05))
