"""One device of the daemon: its servo process, its path and what has become of its motions.

A thread of its own beats the heart, feeds the ring, hears the servo and reports events; commands
may come from any thread.
"""

from __future__ import annotations

import contextlib
import functools
import json
import logging
import os
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from orientd.config import DeviceSettings
from orientd.daemon.device_report import DeviceEvent, DeviceSnapshot, EventKind
from orientd.daemon.examiner import examiner_of
from orientd.daemon.manner import AT_ONCE, Manner, Prepared
from orientd.daemon.servo_link import ServoLink, report_directory, terms_of
from orientd.driver import Driver, Quaternion, Vector3
from orientd.driver.floats import difference, norm
from orientd.driver.registry import driver_target
from orientd.errors import DaemonError, Fault, StateError
from orientd.servo.process import ProcessSettings
from orientd.servo.pursuit import LEFT_OUT_WORD
from orientd.stream import Command, Cycle, CycleFlag, NoteKind, State, unpack_cycle

if TYPE_CHECKING:
    # Loaded with the first motion: until then the daemon stays small.
    from orientd.daemon.cycle_memory import CycleMemory
    from orientd.daemon.meter import MotionStatistics
    from orientd.daemon.motion_planner import MotionPlanner
    from orientd.daemon.motions import Motions
    from orientd.planner import Limits, Motion, MotionRequest
    from orientd.planner import State as PlannedState

_log = logging.getLogger(__name__)

TICK = 0.01
"""How often the thread looks at the servo, s."""

_READ_AHEAD = 8.0
"""Path time that the ring holds ahead of the servo, s; it has room for as much again."""

_SAME_BRANCH = 0.5
"""How far axis angles as measured may be from those planned to be on the same branch, rad."""

_LONGEST_END = 30.0
"""How long a servo may take to stop on its path and to park its device, s."""

_ENDING = 0.3
"""How long a servo may take to end that has lost its device, s."""


class Device:
    """A device and its servo process.

    Attributes:
        name: the device's name.
        driver: the registry's name of its driver.
        rate_hz: cycle rate.
        period_ns: cycle period.
        lead: how long before its time each setpoint is sent, s.
        memory: keeps the newest cycles for the flight recorder; ``None`` where there is none.
    """

    memory: CycleMemory | None = None

    def __init__(
        self, settings: DeviceSettings, *, on_event: Callable[[DeviceEvent], None]
    ) -> None:
        """Check the driver and its options; start nothing.

        Args:
            settings: the device's part of the configuration.
            on_event: called from the device's thread.

        Raises:
            ConfigError: the driver is not installed, or refuses its options.
        """
        self.name = settings.name
        self.driver = settings.driver
        self.rate_hz = settings.rate_hz
        self.period_ns = settings.period_ns
        self.lead = settings.lead
        self._lead_cycles = round(settings.lead * settings.rate_hz)
        self._settings = settings
        self._on_event = on_event
        self._examiner = examiner_of(settings)
        self._target = driver_target(settings.driver)
        self._lock = threading.RLock()
        self._link: ServoLink | None = None
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._ready = threading.Event()
        self._number = 0
        self._speed = 1.0
        self._has_no_outline = False
        self._forget()

    def _forget(self) -> None:
        """Know nothing of a servo that is not there yet."""
        self._motions: Motions | None = None
        self._tracked = 0
        self._fault = Fault.NONE
        self._fault_text = ""
        self._failure = ""
        self._last_words = ""
        self._scheduling = ""
        self._memory_locked = False

    @functools.cached_property
    def limits(self) -> Limits:
        """What no motion of it may exceed."""
        return self._settings.limits.to_limits()

    @functools.cached_property
    def _planner(self) -> MotionPlanner:
        from orientd.daemon.motion_planner import MotionPlanner

        period = self.period_ns * 1e-9
        return MotionPlanner(self._examiner, limits=self.limits, period=period)

    # Life

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
        self._ready.wait(timeout)
        return self._ready.is_set() and not self._failure

    @property
    def failure(self) -> str:
        """Why there is no servo; empty while there is one."""
        return self._failure

    def _start_servo(self) -> None:
        settings = self._settings
        capacity = self._read_ahead
        self._ready.clear()
        self._forget()
        process = ProcessSettings(
            device=self.name,
            driver=self._target,
            options=settings.options,
            period_ns=self.period_ns,
            path_capacity=2 * capacity,
            cycle_capacity=capacity,
            heartbeat_timeout_ns=round(settings.heartbeat_timeout * 1e9),
            feedback_timeout_ns=round(settings.feedback_timeout * 1e9),
            stall_timeout_ns=round(settings.stall_timeout * 1e9),
            priority=settings.priority,
            spin_ns=settings.spin_us * 1000,
            daemon_pid=os.getpid(),
            report_path=str(Path(report_directory()) / f"servo-{self.name}.json"),
        )
        try:
            self._link = ServoLink(process)
        except DaemonError as error:
            self._link, self._failure = None, str(error)
            self._fault, self._fault_text = Fault.SERVO_DIED, self._failure
            raise

    @property
    def _read_ahead(self) -> int:
        """Path records ahead of the servo, a power of two."""
        return 1 << round(_READ_AHEAD * self.rate_hz - 1).bit_length()

    def shutdown(self) -> None:
        """Stop on the path, have the servo end, release everything."""
        with self._lock:
            self._closing.set()
            link, self._link = self._link, None
            if link is not None:
                link.end(timeout=_LONGEST_END)
                if self._motions is not None:
                    self._motions.close()
        if self._thread is not None:
            self._thread.join()
        if link is not None:
            link.close()

    # Motions

    def commanded(self) -> PlannedState:
        """Return the state a new motion must begin in: where the device is commanded to be.

        Raises:
            StateError: the device is not holding.
        """
        from orientd.planner import State as PlannedState

        cycle = self._servo().newest()
        if cycle is None or cycle.state is not State.HOLDING:
            state = "not ready" if cycle is None else cycle.state.name.lower()
            advice = {
                "idle": "; enable it first",
                "streaming": "; stop the present motion first",
                "tracking": "; end the following of targets first",
                "fault": f": {self._fault_text}; reset it first",
            }.get(state, "")
            raise StateError(f"device {self.name} is {state}, not holding{advice}")
        return PlannedState.at_rest(cycle.q, cycle.position)

    def plan(self, request: MotionRequest) -> Motion:
        """Plan a motion that begins where the device will be once it has come to rest.

        Raises:
            RequestError: the request is not one that its method or the device allows.
            StateError: the device is neither holding nor moving.
            PlanError: it cannot be planned, the device cannot follow, or it would break a limit.
        """
        self._check_able()
        return self._loaded().plan(request)

    def prepare(
        self, request: MotionRequest, manner: Manner = AT_ONCE, *, attempt: int = 0
    ) -> Prepared:
        """Plan a motion for :meth:`start`: from rest, or from a point of the path a little ahead.

        Args:
            request: what to do.
            manner: how to begin and to end.
            attempt: how often :meth:`start` has said already that it was too late.

        Raises:
            RequestError: the request is not one that its method or the device allows.
            LateError: what it was to follow has ended.
            StateError: the device cannot move.
            PlanError: it cannot be planned, the device cannot follow, or it would break a limit.
        """
        self._check_able()
        return self._loaded().prepare(request, manner, attempt=attempt)

    def start(self, prepared: Prepared) -> int:
        """Begin to stream a motion and return its number, once the servo has taken it up.

        A motion that is to follow others is taken up when its turn has come.

        Raises:
            LateError: the device has passed the point at which it was to begin.
            StateError: the device is not holding, or not where the motion begins.
        """
        with self._lock:
            motions = self._loaded()
            if prepared.leave is None:
                motions.tend(self._fault_text, speed=self._speed)
                self.commanded()
            self._number += 1
            motions.start(prepared, self._number, speed=self._speed)
            return self._number

    def _check_able(self) -> None:
        """Refuse what a device cannot do that is neither holding nor moving.

        Raises:
            StateError: why not.
        """
        cycle = self._servo().newest()
        if cycle is None or cycle.state not in (State.STREAMING, State.STOPPING):
            self.commanded()

    def _loaded(self) -> Motions:
        """Return the motions of the present servo; the first time loads what plans."""
        with self._lock:
            if self._motions is None:
                from orientd.daemon.motions import Motions

                self._motions = Motions(
                    self._servo(),
                    self._planner,
                    period=self.period_ns * 1e-9,
                    lead=self._settings.lead,
                    read_ahead=self._read_ahead,
                    tell=self._tell,
                )
            return self._motions

    def is_at(self, joints: tuple[float, ...]) -> bool:
        """Whether the device's axes are at *joints*, on the same branch and turn."""
        cycle = self._servo().newest()
        here = () if cycle is None else cycle.joints
        return len(here) != len(joints) or all(
            abs(a - b) < _SAME_BRANCH for a, b in zip(here, joints, strict=True)
        )

    # Following targets

    def track(self, limits: Limits) -> int:
        """Follow targets from now on, whatever moves at present; return the number of that.

        Args:
            limits: narrower than the device's own; infinite ones are left to it.

        Raises:
            RequestError: a limit is above the device's.
            StateError: the device is neither holding nor moving, or cannot follow targets.
        """
        terms = terms_of(self.limits.narrowed(limits), brake_rate=1.0)
        if type(self._examiner).shape is not Driver.shape:
            raise StateError(
                f"device {self.name} plans whole paths for its axes: it cannot follow targets"
            )
        with self._lock:
            number = self._number + 1
            self._servo().ask(Command.TRACK, motion=number, terms=terms)
            self._number = self._tracked = number
            if self._motions is not None:
                self._motions.is_paused = False
                kind = EventKind.MOTION_REPLACED
                self._motions.drop("by targets to follow", kind=kind)
            self._tell(EventKind.MOTION_STARTED, number, "following targets")
        return number

    def aim(self, q: Quaternion, omega_body: Vector3, time_ns: int, expires_ns: int) -> None:
        """Hand the servo a target; waits for nothing.  To be called by one thread at a time."""
        self._servo().memory.targets.publish(time_ns, expires_ns, *q, *omega_body)

    @property
    def targets(self) -> tuple[int, int]:
        """How many targets the servo process was given so far, and how many it left out."""
        ring = self._servo().memory.targets
        return ring.head, ring.word(LEFT_OUT_WORD)

    # Commands

    def enable(self) -> None:
        """Make the device follow; it holds where it is."""
        self._servo().ask(Command.ENABLE)

    def disable(self) -> None:
        """Let the device no longer follow; it must be holding."""
        self._servo().ask(Command.DISABLE)

    def stop(self) -> None:
        """Stop on the path; nothing happens to a device at rest."""
        self._servo().ask(Command.STOP)

    def halt(self) -> None:
        """Stop as quickly as the limits allow, off the path if need be."""
        self._servo().ask(Command.HALT)

    def pause(self) -> None:
        """Come to rest on the path, to be resumed."""
        with self._lock:
            self._servo().ask(Command.SPEED, speed=0.0)
            if self._motions is not None:
                self._motions.is_paused = True

    def resume(self) -> None:
        """Go on after :meth:`pause`, at the speed that was set."""
        with self._lock:
            self._servo().ask(Command.SPEED, speed=self._speed)
            if self._motions is not None:
                self._motions.is_paused = False

    @property
    def is_paused(self) -> bool:
        """Whether a motion stands on its path, to be resumed."""
        return self._motions is not None and self._motions.is_paused

    def set_speed(self, speed: float) -> None:
        """Run at *speed* times as fast as planned, now and from now on.

        Raises:
            ValueError: *speed* is not in (0, 1].
        """
        if not 0.0 < speed <= 1.0:
            raise ValueError(f"speed must be above 0 and at most 1, got {speed!r}")
        with self._lock:
            link = self._servo()
            cycle = link.newest()
            if cycle is not None and cycle.state is State.STREAMING and not self.is_paused:
                link.ask(Command.SPEED, speed=speed)
            self._speed = speed

    def reset(self) -> None:
        """Leave a fault; start the servo again where it has died; enable if so configured.

        Raises:
            DaemonError: the servo cannot be started.
        """
        with self._lock:
            if self._link is not None and self._reset_servo(self._link):
                return
            if self._link is not None:
                self._link.close()
            self._start_servo()
        if not self.wait_ready(10.0):
            raise DaemonError(self._failure or "the servo did not become ready within 10 s")
        link = self._link
        if self._fault is Fault.DEVICE_FAULT and link is not None:
            # The new servo found the device as stopped as the old one left it.
            with self._lock:
                self._reset_servo(link)

    def _reset_servo(self, link: ServoLink) -> bool:
        """Have the servo leave its fault; return whether there was a servo to do it."""
        try:
            if not link.is_alive:
                return False
            self._hear(link)  # or it would be taken for what goes wrong after the reset
            if self._motions is not None:
                self._motions.tend(self._fault_text, speed=self._speed)
            cycle = link.newest()
            if not (self._failure and cycle is not None and cycle.state is State.HOLDING):
                link.ask(Command.RESET)  # else the failure was the daemon's own
            self._fault, self._fault_text, self._failure = Fault.NONE, "", ""
            if self._settings.auto_enable:
                link.ask(Command.ENABLE)
        except DaemonError:
            # A servo whose device is lost may be on its way out when it is asked.
            end = time.monotonic() + _ENDING
            while link.is_alive:
                if time.monotonic() > end:
                    raise
                time.sleep(0.005)
            return False
        return True

    # What there is to see

    def snapshot(self) -> DeviceSnapshot:
        """Return the device as it is now."""
        link = self._link
        is_alive = link is not None and link.is_alive
        cycle = link.newest() if link is not None and is_alive else None
        if link is not None and cycle is not None and cycle.state is State.FAULT:
            self._learn_why(link)
        fault = self._fault
        if cycle is not None and cycle.state is State.FAULT and fault is Fault.NONE:
            fault = Fault(cycle.fault)
        path_time, error = 0.0, None
        due = self._due(link, cycle) if link is not None and cycle is not None else cycle
        if cycle is not None and due is not None and cycle.flags & CycleFlag.FEEDBACK:
            error = norm(difference(due.q, cycle.feedback_q))
        stage = self._motions.stage_of(due) if self._motions is not None else None
        if due is not None and stage is not None and stage.feeder is not None:
            records = due.path_index - stage.feeder.first_index + due.path_fraction
            path_time = max(0.0, records * stage.motion.period)
        state = cycle.state if cycle is not None else State.IDLE
        return DeviceSnapshot(
            cycle=cycle,
            # With the reason known already, it may still be coming to rest.
            state=State.FAULT if fault is not Fault.NONE and state is not State.STOPPING else state,
            fault=fault,
            fault_text=self._fault_text,
            is_paused=self.is_paused and state is State.STREAMING,
            speed=self._speed,
            motion=stage.motion if stage is not None else None,
            motion_number=stage.number if stage is not None else self._number,
            path_time=path_time,
            tracking_error=error,
            servo_pid=link.process.pid if link is not None and is_alive else None,
            scheduling=self._scheduling,
            memory_locked=self._memory_locked,
        )

    def _due(self, link: ServoLink, cycle: Cycle) -> Cycle:
        """Return the cycle whose setpoint the device is to be at now: a lead before the newest."""
        if not self._lead_cycles:
            return cycle
        records = link.cycle_records(max(0, cycle.index - self._lead_cycles), 1)
        return unpack_cycle(records[0]) if records else cycle

    def cycles(self, since: int, limit: int = 4096) -> list[Cycle]:
        """Return cycles from number *since* on, oldest first, as far as they are still known."""
        return [unpack_cycle(record) for record in self.cycle_records(since, limit)]

    def cycle_records(self, since: int, limit: int = 4096) -> list[bytes]:
        """Return the records of cycles from number *since* on, as far as they are still known."""
        link = self._link
        return [] if link is None else link.cycle_records(since, limit)

    def outline(self) -> Sequence[Sequence[Vector3]]:
        """Return the device's shape as it stands: lines, m; none where it has no axes."""
        link = self._link
        cycle = link.newest() if link is not None else None
        if cycle is None or not cycle.joints or self._has_no_outline:
            return ()
        try:
            return self._examiner.outline(cycle.joints)
        except Exception:  # noqa: BLE001 - a picture is worth no trouble
            _log.exception("%s: the driver cannot draw its device", self.name)
            self._has_no_outline = True
            return ()

    def statistics(self, motion_number: int) -> MotionStatistics | None:
        """Return what was measured of a motion; ``None`` unless it is one of the newest."""
        with self._lock:
            return None if self._motions is None else self._motions.statistics(motion_number)

    def settled_after(self, motion_number: int) -> float | None:
        """Return how long after its last setpoint a motion was on target, s, if that is known."""
        return None if self._motions is None else self._motions.settled_after(motion_number)

    def began_ns(self, motion_number: int) -> int | None:
        """Return when a motion began to move, monotonic clock, where that is known."""
        with self._lock:
            return None if self._motions is None else self._motions.began_ns(motion_number)

    # The thread

    def _watch(self) -> None:
        while not self._closing.wait(TICK):
            with self._lock:
                link = self._link
                if link is None or self._closing.is_set() or self._failure:
                    continue
                try:
                    self._tick(link)
                except Exception as error:  # noqa: BLE001 - or it would go on unwatched
                    if link.is_alive:
                        self._give_up(link, error)
                    else:
                        self._hear(link)
                        self._lose(link)

    def _give_up(self, link: ServoLink, error: Exception) -> None:
        """Have the servo stop, since it cannot be watched any more."""
        # It stops by itself once it hears nothing more; this is sooner.
        with contextlib.suppress(ValueError):
            link.stop()
        is_known = isinstance(error, DaemonError)
        what = "%s: watching the servo failed: %s"
        _log.error(what, self.name, error, exc_info=not is_known)
        self._failure = f"{type(error).__name__}: {error}"
        self._fault, self._fault_text = Fault.INTERNAL, self._failure
        self._drop_all(self._failure)

    def _tick(self, link: ServoLink) -> None:
        link.beat()
        is_alive = link.is_alive
        if self.memory is not None:
            self.memory.take(link.memory.cycles, is_last=not is_alive)
        self._hear(link)
        if not is_alive:
            self._lose(link)
            return
        if self._tracked:
            self._look_at_tracking(link)
        if self._motions is not None:
            self._motions.tend(self._fault_text, speed=self._speed)

    def _look_at_tracking(self, link: ServoLink) -> None:
        """Say so when the device has come to rest after following targets."""
        cycle, number = link.newest(), self._tracked
        if cycle is not None and cycle.motion == number:
            if cycle.state in (State.TRACKING, State.STOPPING):
                return
            self._tracked = 0
            is_fault = cycle.state is State.FAULT
            text = self._fault_text if is_fault else "the targets have ended"
            self._tell(EventKind.MOTION_STOPPED, number, text)

    def _hear(self, link: ServoLink) -> None:
        for note in link.words():
            if note.kind is NoteKind.READY:
                self._become_ready(link, note.text)
            elif note.kind is NoteKind.FAULT:
                self._fault = Fault(note.code)
                self._fault_text = note.text or self._fault.name.lower()
                self._tell_fault(f"{self._fault.name.lower()}: {self._fault_text}")
            elif note.kind is NoteKind.ENDING:
                self._last_words = note.text

    def _learn_why(self, link: ServoLink) -> None:
        """Hear what the servo has said of its fault, where the device's thread has not yet."""
        if self._fault is Fault.NONE and self._lock.acquire(timeout=TICK):
            try:
                self._hear(link)
            finally:
                self._lock.release()

    def _become_ready(self, link: ServoLink, text: str) -> None:
        got = json.loads(text)
        self._scheduling, self._memory_locked = got["scheduling"], got["memory_locked"]
        if self._settings.auto_enable:
            try:
                link.ask(Command.ENABLE)
            except (StateError, DaemonError) as error:
                self._fault, self._fault_text = Fault.DEVICE_FAULT, str(error)
                self._tell_fault(str(error))
        self._tell(EventKind.READY, 0, self._scheduling)
        self._ready.set()

    def _lose(self, link: ServoLink) -> None:
        """Say that the servo has ended, whatever ended it."""
        code = link.process.returncode
        ended = f"by signal {-code}" if code < 0 else f"with status {code}"
        self._failure = self._last_words or f"the servo process was ended {ended}"
        if self._fault is not Fault.LINK_LOST:
            # A driver whose link is spent takes its process with it; the link is the reason.
            self._fault, self._fault_text = Fault.SERVO_DIED, self._failure
        self._ready.set()
        self._tell(EventKind.SERVO_DIED, 0, self._failure)
        self._drop_all(self._failure)

    def _drop_all(self, text: str) -> None:
        """Say of every motion that it has been stopped."""
        if self._tracked:
            number, self._tracked = self._tracked, 0
            self._tell(EventKind.MOTION_STOPPED, number, text)
        if self._motions is not None:
            self._motions.drop(text)

    def _tell(self, kind: EventKind, number: int, text: str) -> None:
        event = DeviceEvent(self.name, kind, number, text, time.monotonic_ns())
        if kind is EventKind.MOTION_STARTED and self._motions is not None:
            stage = self._motions.stage(number)
            if stage is not None:
                first = None if stage.feeder is None else stage.feeder.first_index
                event = replace(event, motion=stage.motion, path_index=first)
        self._on_event(event)

    def _tell_fault(self, text: str) -> None:
        number = self._motions.present if self._motions is not None else 0
        self._tell(EventKind.FAULT, number or self._tracked, text)

    def _servo(self) -> ServoLink:
        link = self._link
        if link is None or not link.is_alive:
            raise DaemonError(
                f"device {self.name} has no servo process"
                + (f": {self._failure}" if self._failure else "")
                + "; reset it first"
            )
        return link
