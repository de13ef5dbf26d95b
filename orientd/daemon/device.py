"""One device of the daemon: its servo process, its path and what has become of its motions.

A thread of its own beats the heart, feeds the ring, hears the servo and reports events; commands
may come from any thread.
"""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from orientd import rotation
from orientd.clock import MonotonicClock
from orientd.config import DeviceSettings
from orientd.daemon.device_report import DeviceEvent, DeviceSnapshot, EventKind
from orientd.daemon.feeder import BLOCK, Feeder
from orientd.daemon.fitting import plan_to_fit
from orientd.daemon.meter import MotionMeter, MotionStatistics
from orientd.daemon.servo_link import ServoLink, report_directory
from orientd.driver.registry import driver_target, load_driver
from orientd.errors import ConfigError, DaemonError, Fault, StateError
from orientd.planner import Limits, Motion, MotionRequest
from orientd.planner import State as PlannedState
from orientd.servo.process import ProcessSettings
from orientd.stream import Command, Cycle, CycleFlag, NoteKind, State, Terms, unpack_cycle

TICK = 0.01
"""How often the thread looks at the servo, s."""

_READ_AHEAD = 8.0
"""Path time that the ring can hold, s."""

_EXAMINED_EVERY = 0.008
"""How far apart in path time the poses are that a driver looks at, s."""

_SAME_BRANCH = 0.5
"""How far axis angles as measured may be from those planned to be on the same branch, rad."""

_LONGEST_END = 30.0
"""How long a servo may take to stop on its path and to park its device, s."""

_ENDING = 0.3
"""How long a servo may take to end that has lost its device, s."""

_METER_BLOCK = 256


class Device:
    """A device and its servo process.

    Attributes:
        name: the device's name.
        driver: the registry's name of its driver.
        rate_hz: cycle rate.
        period_ns: cycle period.
        limits: what no motion of it may exceed.
    """

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
        self.limits: Limits = settings.limits.to_limits()
        self._lead_cycles = round(settings.lead * settings.rate_hz)
        self._settings = settings
        self._on_event = on_event
        driver = load_driver(settings.driver)
        try:
            self._examiner = driver(
                settings.options, period_ns=settings.period_ns, clock=MonotonicClock()
            )
        except ValueError as error:
            raise ConfigError(f"devices.{self.name}.options: {error}") from error
        self._target = driver_target(settings.driver)
        self._lock = threading.RLock()
        self._link: ServoLink | None = None
        self._thread: threading.Thread | None = None
        self._closing = threading.Event()
        self._ready = threading.Event()
        self._forget()

    def _forget(self) -> None:
        """Know nothing of a servo that is not there yet."""
        self._feeder: Feeder | None = None
        self._meter: MotionMeter | None = None
        self._motion: Motion | None = None
        self._active = False
        self._fault = Fault.NONE
        self._fault_text = ""
        self._failure = ""
        self._last_words = ""
        self._scheduling = ""
        self._memory_locked = False
        self._speed = 1.0
        self._is_paused = False
        self._metered = 0
        self._number = getattr(self, "_number", 0)

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
        capacity = 1 << round(_READ_AHEAD * self.rate_hz - 1).bit_length()
        self._ready.clear()
        self._forget()
        self._link = ServoLink(
            ProcessSettings(
                device=self.name,
                driver=self._target,
                options=settings.options,
                period_ns=self.period_ns,
                path_capacity=capacity,
                cycle_capacity=capacity,
                heartbeat_timeout_ns=round(settings.heartbeat_timeout * 1e9),
                feedback_timeout_ns=round(settings.feedback_timeout * 1e9),
                priority=settings.priority,
                spin_ns=settings.spin_us * 1000,
                daemon_pid=os.getpid(),
                report_path=str(Path(report_directory()) / f"servo-{self.name}.json"),
            )
        )

    def shutdown(self) -> None:
        """Stop on the path, have the servo end, release everything."""
        with self._lock:
            self._closing.set()
            link, self._link = self._link, None
            if link is not None:
                link.end(timeout=_LONGEST_END)
        if self._thread is not None:
            self._thread.join()
        if link is not None:
            link.close()

    # Commands

    def commanded(self) -> PlannedState:
        """Return the state a new motion must begin in: where the device is commanded to be.

        Raises:
            StateError: the device is not holding.
        """
        cycle = self._servo().newest()
        if cycle is None or cycle.state is not State.HOLDING:
            state = "not ready" if cycle is None else cycle.state.name.lower()
            advice = {
                "idle": "; enable it first",
                "streaming": "; stop the present motion first",
                "fault": f": {self._fault_text}; reset it first",
            }.get(state, "")
            raise StateError(f"device {self.name} is {state}, not holding{advice}")
        return PlannedState.at_rest(cycle.q, cycle.position)

    def next_start(self) -> PlannedState:
        """Return the state in which the next motion will begin, if the present one reaches its end.

        Raises:
            StateError: the device is neither holding nor moving.
        """
        with self._lock:
            if self._active and self._motion is not None:
                motion = self._motion
                end = motion.sample([(motion.record_count - 1) * motion.period])
                return PlannedState.at_rest(end.q[0], end.position[0])
        return self.commanded()

    def plan(self, request: MotionRequest, *, is_next: bool = False) -> Motion:
        """Plan a motion from where the device is commanded to be, as its axes can follow it.

        Args:
            request: what to do.
            is_next: begin where the device will be once its present motion has ended.

        Raises:
            RequestError: the request is not one that its method or the device allows.
            StateError: the device is not at rest, ready to move.
            PlanError: it cannot be planned, the device cannot follow, or it would break a limit.
        """
        start = self.next_start() if is_next else self.commanded()
        joints = self._joints(is_next=is_next)
        period = self.period_ns * 1e-9
        motion = plan_to_fit(
            self._examiner, request, start=start, joints=joints, limits=self.limits, period=period
        )
        self._examine(motion)
        return motion

    def _joints(self, *, is_next: bool) -> tuple[float, ...]:
        with self._lock:
            if is_next and self._active and self._motion is not None and self._motion.last_joints:
                return self._motion.last_joints
        cycle = self._servo().newest()
        return () if cycle is None else cycle.joints

    def is_at(self, joints: tuple[float, ...]) -> bool:
        """Whether the device's axes are at *joints*, on the same branch and turn."""
        here = self._joints(is_next=False)
        return len(here) != len(joints) or all(
            abs(a - b) < _SAME_BRANCH for a, b in zip(here, joints, strict=True)
        )

    def _examine(self, motion: Motion) -> None:
        """Have the driver look at a motion that keeps the limits."""
        step = max(1, round(_EXAMINED_EVERY / motion.period))
        times = motion.period * np.arange(0, motion.record_count, step)
        samples = motion.sample(times)
        poses = zip(samples.q.tolist(), samples.position.tolist(), strict=True)
        self._examiner.examine(times.tolist(), list(poses))

    def start(self, motion: Motion) -> int:
        """Begin to stream *motion* and return its number, once the servo has taken it up.

        Raises:
            StateError: the device is not holding, or not where the motion begins.
        """
        with self._lock:
            link = self._servo()
            self.commanded()
            self._number += 1
            certificate = motion.certificate
            feeder = Feeder(link.memory.path, motion, self._number)
            needed = 1.0 / (certificate.brake_rate * motion.period) + BLOCK
            while not feeder.is_done and link.memory.path.head - feeder.first_index < needed:
                if not feeder.feed(BLOCK):
                    break
            limits = motion.limits
            terms = Terms(
                limits.velocity,
                limits.acceleration,
                limits.jerk,
                limits.linear_velocity,
                limits.linear_acceleration,
                certificate.brake_rate,
            )
            self._metered = link.memory.cycles.head
            link.beat()
            link.ask(
                Command.START,
                motion=self._number,
                path_index=feeder.first_index,
                speed=self._speed,
                terms=terms,
            )
            self._meter = MotionMeter(
                motion, self._number, feeder.first_index, lead=self._settings.lead
            )
            self._motion, self._feeder = motion, feeder
            self._is_paused, self._active = False, True
            self._tell(EventKind.MOTION_STARTED, f"{motion.duration:.3f} s")
            return self._number

    def enable(self) -> None:
        """Make the device follow; it holds where it is."""
        self._servo().ask(Command.ENABLE)

    def disable(self) -> None:
        """Let the device no longer follow; it must be holding."""
        self._servo().ask(Command.DISABLE)

    def stop(self) -> None:
        """Stop on the path; nothing happens to a device at rest."""
        self._servo().ask(Command.STOP)

    def pause(self) -> None:
        """Come to rest on the path, to be resumed."""
        self._servo().ask(Command.SPEED, speed=0.0)
        self._is_paused = True

    def resume(self) -> None:
        """Go on after :meth:`pause`, at the speed that was set."""
        self._servo().ask(Command.SPEED, speed=self._speed)
        self._is_paused = False

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
            if cycle is not None and cycle.state is State.STREAMING and not self._is_paused:
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
            link.ask(Command.RESET)
            self._fault, self._fault_text = Fault.NONE, ""
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
        feeder = self._feeder
        due = self._due(link, cycle) if link is not None and cycle is not None else cycle
        if cycle is not None and due is not None and cycle.flags & CycleFlag.FEEDBACK:
            error = float(rotation.angle(due.q, cycle.feedback_q))
        # A motion begins before its start returns; until then the feeder is that of the last one.
        if due is not None and feeder is not None and due.motion == feeder.number:
            records = due.path_index - feeder.first_index + due.path_fraction
            path_time = max(0.0, records * feeder.motion.period)
        state = cycle.state if cycle is not None else State.IDLE
        return DeviceSnapshot(
            cycle=cycle,
            state=State.FAULT if fault is not Fault.NONE else state,
            fault=fault,
            fault_text=self._fault_text,
            is_paused=self._is_paused and state is State.STREAMING,
            speed=self._speed,
            motion=self._motion,
            motion_number=self._number,
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
        link = self._link
        if link is None:
            return []
        return [unpack_cycle(record) for record in link.cycle_records(since, limit)]

    def statistics(self, motion_number: int) -> MotionStatistics | None:
        """Return what was measured of a motion; ``None`` unless it is the newest."""
        meter = self._meter
        if meter is None or meter.number != motion_number:
            return None
        with self._lock:
            if self._active:
                self._measure()
            return meter.statistics()

    # The thread

    def _watch(self) -> None:
        while not self._closing.wait(TICK):
            with self._lock:
                link = self._link
                if link is None or self._closing.is_set():
                    continue
                if not self._failure:
                    self._tick(link)

    def _tick(self, link: ServoLink) -> None:
        link.beat()
        is_alive = link.is_alive
        self._hear(link)
        if not is_alive:
            self._lose(link)
            return
        if self._feeder is not None and not self._feeder.is_done:
            while self._active and self._feeder.feed(BLOCK) == BLOCK:
                link.beat()
        if not self._active:
            return
        cycle = link.newest()
        self._measure()
        if (
            cycle is not None
            and cycle.motion == self._number
            and cycle.state not in (State.STREAMING, State.STOPPING)
        ):
            self._conclude(cycle)

    def _hear(self, link: ServoLink) -> None:
        for note in link.words():
            if note.kind is NoteKind.READY:
                self._become_ready(link, note.text)
            elif note.kind is NoteKind.FAULT:
                self._fault, self._fault_text = Fault(note.code), note.text
                self._tell(EventKind.FAULT, f"{self._fault.name.lower()}: {note.text}")
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
                self._tell(EventKind.FAULT, str(error))
        self._tell(EventKind.READY, self._scheduling)
        self._ready.set()

    def _conclude(self, cycle: Cycle) -> None:
        self._active = False
        self._is_paused = False
        if self._feeder is not None and cycle.path_index == self._feeder.final_index:
            self._tell(EventKind.MOTION_DONE, "")
        elif cycle.state is State.FAULT:
            self._tell(EventKind.MOTION_STOPPED, self._fault_text)
        else:
            self._tell(EventKind.MOTION_STOPPED, "stopped on its path")

    def _lose(self, link: ServoLink) -> None:
        """Say that the servo has ended, whatever ended it."""
        code = link.process.returncode
        ended = f"by signal {-code}" if code < 0 else f"with status {code}"
        self._failure = self._last_words or f"the servo process was ended {ended}"
        if self._fault is not Fault.LINK_LOST:
            # A driver whose link is spent takes its process with it; the link is the reason.
            self._fault, self._fault_text = Fault.SERVO_DIED, self._failure
        was_active, self._active = self._active, False
        self._ready.set()
        self._tell(EventKind.SERVO_DIED, self._failure)
        if was_active:
            self._tell(EventKind.MOTION_STOPPED, self._failure)

    def _measure(self) -> None:
        """Add the cycles since the last look to the motion's measurements."""
        meter, link = self._meter, self._link
        if meter is None or link is None:
            return
        while records := link.cycle_records(self._metered, _METER_BLOCK):
            meter.add(records)
            self._metered = int.from_bytes(records[-1][:8], "little") + 1

    def _tell(self, kind: EventKind, text: str) -> None:
        number = self._number if kind.value.startswith("motion") or self._active else 0
        self._on_event(DeviceEvent(self.name, kind, number, text, time.monotonic_ns()))

    def _servo(self) -> ServoLink:
        link = self._link
        if link is None or not link.is_alive:
            raise DaemonError(
                f"device {self.name} has no servo process"
                + (f": {self._failure}" if self._failure else "")
                + "; reset it first"
            )
        return link
