"""A device whose servo process is kept going, and whose motions are seen to.

A thread of its own beats the heart, feeds the ring, hears the servo and reports events.
"""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

from orientd.config import DeviceSettings
from orientd.daemon.devices import (
    CycleMemory,
    DeviceEvent,
    DeviceSnapshot,
    EventKind,
    ServoLink,
    ServoSupervisor,
)
from orientd.daemon.motions import Motions
from orientd.driver import Explaining
from orientd.errors import DaemonError, Fault, PendingError, StateError
from orientd.floats import difference, norm
from orientd.stream import Cycle, CycleFlag, ServoState, unpack_cycle

if TYPE_CHECKING:
    from orientd.daemon.stops import StopFolder

_log = logging.getLogger(__name__)

TICK = 0.01
"""How often the thread looks at the servo, s."""

_READ_AHEAD = 8.0
"""Path time that the ring holds ahead of the servo, s, and more where a stop takes longer; it has
room for as much again at the least."""

_RESTART = 0.8
"""How long a reset, or a servo that it starts again, is waited for before it is pending, s."""

_ENDING = 0.3
"""How long a servo may take to end that has lost its device, s."""


class SupervisedDevice:
    """A device, its servo process and what that runs.

    Attributes:
        name: the device's name.
        driver: the registry's name of its driver.
        rate_hz: cycle rate.
        period_ns: cycle period.
        lead: how long before its time each setpoint is sent, s.
        phase: where in a period its cycles begin, as a share of it.
        memory: keeps the newest cycles for the flight recorder; ``None`` where there is none.
    """

    memory: CycleMemory | None = None

    def __init__(
        self,
        settings: DeviceSettings,
        *,
        on_event: Callable[[DeviceEvent], None],
        explaining: Explaining | None = None,
        stops: StopFolder | None = None,
    ) -> None:
        """Start nothing yet.

        Args:
            settings: the device's part of the configuration.
            on_event: called from the device's thread, or from a command.
            explaining: the driver, if it knows what ends the servo process.
            stops: where the servo listens for stops, and who records them.

        Raises:
            ConfigError: the driver is not installed.
        """
        self.name = settings.name
        self.driver = settings.driver
        self.rate_hz = settings.rate_hz
        self.period_ns = settings.period_ns
        self.lead = settings.lead
        self.phase = settings.phase
        self._on_event = on_event
        # In path records, a power of two.
        self._read_ahead = 1 << round(_READ_AHEAD * settings.rate_hz - 1).bit_length()
        self._servo = ServoSupervisor(
            settings,
            read_ahead=self._read_ahead,
            tell=self._tell_of_servo,
            explaining=explaining,
            stops=stops,
        )
        self._stops = stops
        self._lock = threading.RLock()
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._motions: Motions | None = None
        self._number = self._tracked = 0
        self._speed = 1.0
        self._lead_cycles = round(settings.lead * settings.rate_hz)
        self._is_restarting = False

    def launch(self) -> None:
        """Start the servo process and return at once; see :meth:`wait_ready`."""
        with self._lock:
            self._start_servo()
            if self._thread is None:
                self._thread = threading.Thread(
                    target=self._watch, name=f"device {self.name}", daemon=True
                )
                self._thread.start()

    def wait_ready(self, timeout: float) -> bool:
        """Wait until the servo runs its cycles, or has failed to; return which."""
        return self._servo.wait_ready(timeout)

    @property
    def stops_beside(self) -> int:
        """How many stops this servo process has taken by itself."""
        link = self._servo.link
        with contextlib.suppress(ValueError):  # closed meanwhile
            return 0 if link is None else link.memory.stops.head
        return 0

    @property
    def failure(self) -> str:
        """Why there is no servo; empty while there is one."""
        return self._servo.failure

    def _start_servo(self) -> None:
        self._motions = None
        self._tracked = 0
        self._servo.start()

    def shutdown(self) -> None:
        """Stop on the path, have the servo end, release everything."""
        with self._lock:
            self._closing.set()
            link = self._servo.end()
            if link is not None and self._motions is not None:
                self._motions.close()
        if self._thread is not None:
            self._thread.join()
        if link is not None:
            link.close()

    def reset(self) -> None:
        """Leave a fault; start the servo again where it has died; enable if so configured.

        Raises:
            PendingError: it goes on, but takes its time; give it again for its outcome.
            DaemonError: the servo cannot be started.
        """
        ends = time.monotonic() + _RESTART
        with self._lock:
            if not self._is_restarting or (self.failure and not self._servo.has_just_failed):
                if self._leave_fault(ends):
                    return
                self._start_servo()
                self._is_restarting = True
        if not self.wait_ready(_RESTART) and not self.failure:
            raise PendingError(f"the servo process of {self.name} is being started; ask again")
        self._is_restarting = False
        if self.failure:
            raise DaemonError(self.failure)
        if self._servo.fault is Fault.DEVICE_FAULT:
            # The new servo found the device as stopped as the old one left it.
            with self._lock:
                self._leave_fault(ends)

    def try_again(self) -> None:
        """Start the servo again where the device did not answer; it may take its time, or fail."""
        with contextlib.suppress(DaemonError, PendingError, StateError):
            self.reset()

    def _leave_fault(self, ends: float) -> bool:
        """Have the servo leave its fault by *ends*; return whether there was a servo to do it."""
        link = self._servo.link
        if link is None or not link.is_alive:
            return False
        try:
            self._servo.hear()  # or it would be taken for what goes wrong after the reset
            self._tend()
            self._servo.leave_fault(link, ends)
        except DaemonError:
            # A servo whose device is lost may be on its way out when it is asked.
            if link.ends_within(_ENDING):
                return False
            raise
        return True

    def _learn_why(self) -> None:
        """Hear what the servo has said of its fault, where the device's thread has not yet."""
        if self._servo.fault is Fault.NONE and self._lock.acquire(timeout=TICK):
            try:
                self._servo.hear()
            finally:
                self._lock.release()

    # What there is to see

    def snapshot(self) -> DeviceSnapshot:
        """Return the device as it is now."""
        servo, cycle = self._servo, self._servo.newest()
        if cycle is not None and cycle.state is ServoState.FAULT:
            self._learn_why()
        fault, motions = servo.fault, self._motions
        if cycle is not None and cycle.state is ServoState.FAULT and fault is Fault.NONE:
            fault = Fault(cycle.fault)
        due = None if cycle is None else self._due(cycle)
        error = None
        if cycle is not None and due is not None and cycle.flags & CycleFlag.FEEDBACK:
            error = norm(difference(due.q, cycle.feedback_q))
        queued = None if motions is None else motions.queued_of(due)
        path_time = 0.0
        if due is not None and queued is not None and queued.feeder is not None:
            facts = queued.motion.facts
            records = due.path_index - queued.feeder.first_index + due.path_fraction
            # The last record may lie up to a period beyond the motion's end.
            path_time = min(max(0.0, records * facts.period), facts.duration)
        state = ServoState.IDLE if cycle is None else cycle.state
        is_paused = motions is not None and motions.is_paused
        return DeviceSnapshot(
            cycle=cycle,
            # With the reason known already, it may still be coming to rest.
            state=ServoState.FAULT
            if fault is not Fault.NONE and state is not ServoState.STOPPING
            else state,
            fault=fault,
            fault_text=servo.fault_text,
            is_paused=is_paused and state is ServoState.STREAMING,
            speed=self._speed,
            motion=None if queued is None else queued.motion,
            motion_number=self._number if queued is None else queued.number,
            path_time=path_time,
            tracking_error=error,
            servo_pid=servo.pid,
            scheduling=servo.scheduling,
            memory_locked=servo.memory_locked,
            health=servo.health,
            longest_calls=servo.longest_calls,
        )

    def _due(self, cycle: Cycle) -> Cycle:
        """Return the cycle whose setpoint the device is to be at now: a lead before the newest."""
        if not self._lead_cycles:
            return cycle
        records = self._servo.cycle_records(max(0, cycle.index - self._lead_cycles), 1)
        return unpack_cycle(records[0]) if records else cycle

    # The thread

    def _watch(self) -> None:
        while not self._closing.wait(TICK):
            while not self._lock.acquire(timeout=TICK):
                self._servo.beat()  # a command waits for the servo's answer
            try:
                link = self._servo.link
                if link is None or self._closing.is_set() or self._servo.failure:
                    continue
                try:
                    self._tick(link)
                except Exception as error:  # noqa: BLE001 - or it would go on unwatched
                    if link.is_alive:
                        self._give_up(link, error)
                    else:
                        self._lose(link)
            finally:
                self._lock.release()

    def _give_up(self, link: ServoLink, error: Exception) -> None:
        """Have the servo stop, since it cannot be watched any more."""
        # It stops by itself once it hears nothing more; this is sooner.
        with contextlib.suppress(ValueError):
            link.stop()
        is_known = isinstance(error, DaemonError)
        what = "%s: watching the servo failed: %s"
        _log.error(what, self.name, error, exc_info=not is_known)
        self._servo.give_up(error)
        self._drop_all(self._servo.failure)

    def _lose(self, link: ServoLink) -> None:
        """Hear the last of a servo that has ended, and say so of it and of its motions."""
        self._servo.hear()
        self._servo.lose(link)
        self._drop_all(self._servo.failure)

    def _tick(self, link: ServoLink) -> None:
        link.beat()
        is_alive = link.is_alive
        if self.memory is not None:
            self.memory.take(link.memory.cycles, is_last=not is_alive)
        if not is_alive:
            self._lose(link)
            return
        self._servo.hear()
        self._hear_stops()
        if self._tracked:
            self._look_at_tracking(link)
        self._tend()

    def _hear_stops(self) -> None:
        """Say who has stopped the device without the daemon."""
        link = self._servo.link
        taken = [] if link is None else link.stops()
        if taken and self._stops is not None:
            self._tell(EventKind.STOP, 0, f"stopped by {self._stops.hear(self.name, taken)}")

    def _tend(self) -> None:
        if self._motions is not None:
            self._motions.tend(self._servo.fault_text, speed=self._speed)

    def _look_at_tracking(self, link: ServoLink) -> None:
        """Say so when the device has come to rest after following targets."""
        cycle, number = link.newest(), self._tracked
        if cycle is not None and cycle.motion == number:
            if cycle.state in (ServoState.TRACKING, ServoState.STOPPING):
                return
            self._tracked = 0
            is_fault = cycle.state is ServoState.FAULT
            text = self._servo.fault_text if is_fault else "the targets have ended"
            self._tell(EventKind.MOTION_STOPPED, number, text)

    def _drop_all(self, text: str) -> None:
        """Say of every motion that it has been stopped."""
        if self._tracked:
            number, self._tracked = self._tracked, 0
            self._tell(EventKind.MOTION_STOPPED, number, text)
        if self._motions is not None:
            self._motions.drop(text)

    def _tell(self, kind: EventKind, number: int, text: str) -> None:
        if kind is EventKind.MOTION_STOPPED:
            self._hear_stops()  # the reason comes first
        event = DeviceEvent(self.name, kind, number, text, time.monotonic_ns())
        if kind is EventKind.MOTION_STARTED and self._motions is not None:
            queued = self._motions.queued(number)
            if queued is not None:
                first = None if queued.feeder is None else queued.feeder.first_index
                event = replace(event, motion=queued.motion, path_index=first)
        self._on_event(event)

    def _tell_of_servo(self, kind: EventKind, text: str) -> None:
        number = 0
        if kind is EventKind.FAULT:
            number = (self._motions.present if self._motions is not None else 0) or self._tracked
        self._tell(kind, number, text)
