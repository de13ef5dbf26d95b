"""Control one device of the daemon: its commands, its motions, and its state.

A thread of its own beats the heart, feeds the path ring, hears the servo and reports events.
Another one measures what runs, which may take its time.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from orientd.config import DeviceSettings
from orientd.daemon.device.cycle_memory import CycleMemory
from orientd.daemon.device.event import DeviceEvent, EventKind
from orientd.daemon.device.queue import STOPPED, MotionQueue
from orientd.daemon.device.queued_motion import AT_ONCE, Ended, MoveOptions, QueuedMotion
from orientd.daemon.device.retarget import Retargeting
from orientd.daemon.device.servo_process import ServoProcess
from orientd.daemon.device.snapshot import DeviceSnapshot, take_snapshot
from orientd.daemon.device.target_writer import DeviceAxes, TargetWriter
from orientd.daemon.leases import Lease, Leases
from orientd.daemon.planners.messages import PlanRequest
from orientd.daemon.planners.planned_motion import PlannedMotion
from orientd.daemon.planners.pool import Planners
from orientd.daemon.workers import DeviceWorkers, LoopErrors
from orientd.driver import Explaining, Vector3
from orientd.errors import GOING_DOWN, DaemonError, Fault, StateError
from orientd.protocol import control_pb2 as pb
from orientd.stream.records import UNKNOWN, Command, Cycle, ServoLimits, ServoState, unpack_cycle

if TYPE_CHECKING:
    from orientd.daemon.stops import StopFolder

_log = logging.getLogger(__name__)

TICK = 0.01
"""How often the thread looks at the servo, s."""

_MEASURE = 0.1
"""How often what runs is measured, s."""

GONE = "its caller has gone away"

_WITHDRAWING = 0.5
"""How long the end of a motion that waits may itself wait for a command of the device, s."""

_READ_AHEAD = 8.0
"""Path time that the ring holds ahead of the servo, s, and more if a stop takes longer.

The ring has at least twice that capacity.
"""

_RESTART = 60.0
"""How long a servo may take that a reset has started again, s."""

_ENDING = 0.3
"""How long a servo may take to end that has lost its device, s."""

_TIMED = 16
"""Motions with a start time of which the device remembers when they began."""

_OUTCOMES = {
    EventKind.MOTION_DONE: pb.OUTCOME_DONE,
    EventKind.MOTION_PASSED: pb.OUTCOME_PASSED,
    EventKind.MOTION_REPLACED: pb.OUTCOME_REPLACED,
    EventKind.MOTION_UNSETTLED: pb.OUTCOME_UNSETTLED,
    EventKind.MOTION_STOPPED: pb.OUTCOME_STOPPED,
}


class Device:
    """A device, its servo process and its motions.  Commands may come from any thread.

    Attributes:
        name: the device's name.
        driver: the registry's name of its driver.
        rate_hz: cycle rate.
        period_ns: cycle period.
        lead: how long before its time each setpoint is sent, s.
        phase: where in a period its cycles begin, as a share of it.
        limits: what no motion of it may exceed.
        keep_out: cones that every motion stays out of.
        targets: hands targets and chunks of poses to the servo while it follows them.
        is_free: whether it was disabled for hand guiding.
        last_ended: the motion that has ended last; ``None`` before the first has.
        workers: threads for its commands and its stops.
    """

    def __init__(
        self,
        settings: DeviceSettings,
        *,
        planners: Planners,
        on_event: Callable[[DeviceEvent], None],
        leases: Leases | None = None,
        cycle_memory: CycleMemory | None = None,
        stops: StopFolder | None = None,
    ) -> None:
        """Check the driver and its options; start nothing.

        Args:
            settings: the device's part of the configuration.
            planners: plan for it.
            on_event: called from the device's thread, or from a command.
            leases: leases of the device; ``None`` if this process alone uses it.
            cycle_memory: keeps the newest cycles for the flight recorder, if there is one.
            stops: where the servo listens for stops, and who records them.

        Raises:
            ConfigError: the driver is not installed, or refuses its options.
        """
        self.name = settings.name
        self.driver = settings.driver
        self.rate_hz = settings.rate_hz
        self.period_ns = settings.period_ns
        self.lead = settings.lead
        self.phase = settings.phase
        self.limits = settings.limits.to_limits()
        self.keep_out = settings.to_keep_out()
        self.is_free = self._was_following = False
        self.last_ended: QueuedMotion | None = None
        self.workers = DeviceWorkers(self.name)
        driver = settings.make_driver()
        self._axes = DeviceAxes(driver, self.name)
        self._leases, self._cycle_memory = leases, cycle_memory
        self._on_event, self._stops = on_event, stops
        # In path records, a power of two.
        read_ahead = 1 << round(_READ_AHEAD * settings.rate_hz - 1).bit_length()
        self._servo = ServoProcess(
            settings,
            read_ahead=read_ahead,
            tell=self.tell,
            explaining=driver if isinstance(driver, Explaining) else None,
            stops=stops,
        )
        self._queue = MotionQueue(
            self._servo, self._tell, lead=settings.lead, read_ahead=read_ahead
        )
        self._retargeting = Retargeting(
            self._servo,
            self._queue,
            planners,
            name=self.name,
            period=self.period_ns * 1e-9,
            workers=self.workers,
        )
        self.targets = TargetWriter(self._servo, self._axes)
        self._lock, self._stops_lock = threading.RLock(), threading.Lock()
        self._resetting = threading.Lock()
        self._threads: list[threading.Thread] = []
        self._closing = threading.Event()
        # Motions come and go in one step each, in any thread; they keep their order.
        self._unfinished: dict[QueuedMotion, None] = {}
        self._timed: deque[QueuedMotion] = deque(maxlen=_TIMED)
        self._number = 0
        self._lead_cycles = round(settings.lead * settings.rate_hz)

    # Life

    def launch(self) -> None:
        """Start the servo process and return at once; see :meth:`wait_ready`."""
        with self._lock:
            self._start_servo()
            if not self._threads:
                self._threads = [
                    threading.Thread(target=work, name=f"{what} {self.name}", daemon=True)
                    for work, what in ((self._watch, "device"), (self._measure, "meter"))
                ]
                for thread in self._threads:
                    thread.start()

    def wait_ready(self, timeout: float) -> bool:
        """Wait until the servo runs its cycles, or has failed to; return which."""
        return self._servo.wait_ready(timeout)

    @property
    def failure(self) -> str:
        """Why there is no servo; empty while there is one."""
        return self._servo.failure

    def shutdown(self) -> None:
        """Stop on the path, have the servo end, release everything."""
        self._servo.is_aborting = True  # a reset that hangs holds the lock
        with self._lock:
            self._closing.set()
            self._servo.end()
        for thread in self._threads:
            thread.join()
        for queued in self.unfinished():
            self._conclude(queued, (pb.OUTCOME_STOPPED, GOING_DOWN))

    def _start_servo(self) -> None:
        if self._servo.memory is not None and not self._servo.failure:
            self._tick()  # The servo has ended since the last tick, and with it its motions.
        self._queue.restart()
        self._servo.start()

    # Motions

    def commanded(self) -> Cycle:
        """Return a cycle in which the device holds: where a motion from rest begins.

        Raises:
            StateError: the device is not holding.
        """
        return self._servo.commanded()

    async def plan(self, request: PlanRequest) -> PlannedMotion:
        """Plan a motion that begins where the device will be once it has come to rest.

        Raises:
            RequestError: the request is not one that its method or the device allows.
            StateError: the device is neither holding nor moving.
            PlanError: it cannot be planned, the device cannot follow, or it would break a limit.
        """
        return await self._retargeting.plan(request)

    @contextlib.contextmanager
    def expecting(self, options: MoveOptions = AT_ONCE) -> Iterator[QueuedMotion]:
        """Know of a motion that is to begin within the context, so that a stop reaches it.

        If the caller goes away meanwhile, the motion is stopped again.
        """
        self._take_stops()
        queued = QueuedMotion(options=options)
        self._unfinished[queued] = None
        try:
            yield queued
        except asyncio.CancelledError:
            # It may be about to begin: then it does not, or is stopped again.
            queued.reason = queued.reason or GONE
            self.workers.stops.submit(self.abandon, queued, GONE)
            raise
        except BaseException:
            self._unfinished.pop(queued, None)
            raise

    async def move(self, queued: QueuedMotion, request: PlanRequest, *, token: str = "") -> None:
        """Plan a motion, and begin it.

        A motion that runs is replaced from a point a little ahead, or followed.

        Args:
            queued: the motion, see :meth:`expecting`.
            request: what to do.
            token: the lease.

        Raises:
            RequestError: the request is not one that its method or the device allows.
            LeaseError: *token* is not that of a lease of the device.
            StateError: the device cannot move, or was stopped meanwhile.
            PlanError: it cannot be planned, the device cannot follow, or it would break a limit.
            DeadlineError: the motions that were asked for before take too long.
        """
        queued.token = token
        await self._retargeting.begin(queued, request, self._begin)

    async def run(self, queued: QueuedMotion, motion: PlannedMotion, *, token: str = "") -> None:
        """Begin to run a kept plan on a device at rest.

        Args:
            queued: the motion, see :meth:`expecting`.
            motion: planned for the device.
            token: the lease.

        Raises:
            LeaseError: *token* is not that of a lease of the device.
            StateError: the device is not at rest, ready to move, or was stopped meanwhile.
            StartError: the motion does not begin where the device is commanded to be.
        """
        self._retargeting.check_start(motion)
        queued.token, queued.planned, queued.planned_ns = token, motion, time.monotonic_ns()
        await self.workers.commands.run(self._begin, queued)

    def _begin(self, queued: QueuedMotion) -> float:
        """Begin a planned motion, or let it wait for its turn.

        Returns:
            When the servo could see it, monotonic s.

        Raises:
            LeaseError: the lease is lost.
            LateError: the device has passed the point at which it was to begin.
            StateError: the device was stopped, or does not hold at the start of the motion.
        """
        with self._lock:
            lease = self._check_wanted(queued)
            self._number += 1
            queued.number = self._number
            posted = self._queue.start(queued)
            speed = self._queue.speed
            at_speed = "" if speed == 1.0 else f" at speed {speed:g}"
            text = f"{queued.motion.facts.duration:.3f} s{at_speed}"
            self._note_begun(queued, lease, text)
        return posted

    def _check_wanted(self, queued: QueuedMotion) -> Lease | None:
        """Return the lease that a motion is commanded under.

        Raises:
            LeaseError: its token is not that of a lease of the device.
            StateError: it was stopped before it began.
        """
        lease = None if self._leases is None else self._leases.check(queued.token, self.name)
        self._take_stops()
        if queued.reason:
            raise StateError(f"device {self.name} was stopped before it began: {queued.reason}")
        return lease

    def _note_begun(self, queued: QueuedMotion, lease: Lease | None, text: str) -> None:
        """Report that a motion has begun; stop it if a client stopped the device meanwhile."""
        # Its caller may have gone away, and it was no longer awaited.
        self._unfinished[queued] = None
        queued.begun_ns = time.monotonic_ns()
        if queued.options.start_ns != UNKNOWN:
            self._timed.append(queued)
        self._tell(EventKind.MOTION_STARTED, queued, text, lease)
        self._take_stops()
        if queued.reason:
            self._servo.brake()

    def unfinished(self) -> list[QueuedMotion]:
        """Return the motions that have not ended, in their order, also those yet to begin."""
        return list(self._unfinished)

    def find(self, number: int) -> QueuedMotion | None:
        """Return motion *number*, if it has not ended."""
        return next((one for one in self.unfinished() if one.number == number), None)

    def began_ns(self, start_ns: int) -> int | None:
        """Return when the motion began that was to begin at *start_ns*, if that is known."""
        timed = [one for one in self._timed if one.options.start_ns == start_ns]
        return timed[-1].began_ns if timed else None

    # Following targets

    def track(self, queued: QueuedMotion, servo_limits: ServoLimits, *, token: str = "") -> None:
        """Follow targets from now on, whatever moves at present; see :attr:`targets`.

        Args:
            queued: the following, see :meth:`expecting`.
            servo_limits: within the device's own.
            token: the lease.

        Raises:
            LeaseError: *token* is not that of a lease of the device.
            StateError: the device is neither holding nor moving, or cannot follow targets.
            PlanError: the device does not report the data needed to check targets.
        """
        queued.token = token
        self.targets.begin(servo_limits)
        with self._lock:
            lease = self._check_wanted(queued)
            queued.number = self._number + 1
            self._queue.track(queued, servo_limits)
            self._number = queued.number
            self._note_begun(queued, lease, "following targets")

    # Stops

    def stop(self, reason: str = "", *, is_quickest: bool = False) -> None:
        """Stop on the path; nothing happens to a device at rest.  Waits for no other command.

        Args:
            reason: reported to the clients whose motions it ends.
            is_quickest: whether to leave the path if that is quicker.

        Raises:
            DaemonError: the servo does not answer.
        """
        self._stop(self.unfinished(), reason, is_quickest=is_quickest)

    def _stop(
        self, motions: Iterable[QueuedMotion], reason: str, *, is_quickest: bool = False
    ) -> None:
        _note(motions, reason)
        _log.info("%s: stop: %s", self.name, reason)
        self._servo.ask(Command.HALT if is_quickest else Command.STOP)

    def _take_stops(self) -> None:
        """Note by whom the device was stopped without the daemon; naming the user may be slow."""
        with self._stops_lock:
            taken = self._servo.stops()
            met = [queued for queued in self.unfinished() if taken and not queued.reason]
            _note(met, STOPPED)
        if taken and self._stops is not None:
            who = self._stops.log_stops(self.name, taken)
            for queued in met:
                queued.reason = f"stopped by {who}"

    def abandon(self, queued: QueuedMotion, reason: str) -> None:
        """End a motion, and nothing that runs before it.

        One that waits for its turn is taken out; else the device is stopped on its path, which ends
        the motions behind it too.  One that is yet to begin then begins from rest.  A stop does not
        wait for a command of the device, which may take as long as the device does.

        Raises:
            DaemonError: the servo does not answer.
        """
        if queued.ended.done():
            return
        # If it begins at this moment, its thread finds the reason and stops it.
        queued.reason = queued.reason or reason
        if not queued.begun_ns:
            self._unfinished.pop(queued, None)
        elif self._queue.present is queued or not self._withdraw(queued, reason):
            self._stop([one for one in self.unfinished() if one.begun_ns], reason)

    def _withdraw(self, queued: QueuedMotion, reason: str) -> bool:
        """Take out a motion that waits for its turn; return whether that was possible."""
        if not self._lock.acquire(timeout=_WITHDRAWING):
            return False
        try:
            return queued.ended.done() or self._queue.withdraw(queued, reason)
        finally:
            self._lock.release()

    def disown(self, token: str, reason: str) -> None:
        """End every motion that was asked for with the lease *token*."""
        for queued in self.unfinished():
            if queued.token == token:
                self.abandon(queued, reason)

    # Commands

    def enable(self) -> None:
        """Make the device follow; it holds where it is."""
        self._servo.ask(Command.ENABLE)
        self.is_free = False

    def disable(self, *, is_freed: bool = False) -> None:
        """Disable the device, which must be holding; it may be freed for moving by hand."""
        was_following = self.snapshot().state is ServoState.HOLDING
        self._servo.ask(Command.FREE if is_freed else Command.DISABLE)
        self.is_free, self._was_following = is_freed, was_following

    def end_free(self) -> None:
        """End hand guiding: hold if the device was enabled before, otherwise stay disabled."""
        if self.is_free and self._was_following:
            self.enable()
        elif self.is_free:
            self.disable()

    def reset(self) -> None:
        """Leave a fault; start the servo again if it has died; enable if so configured.

        This takes as long as the device does.

        Raises:
            StateError: the device cannot, or another reset is under way.
            DaemonError: the servo cannot be started.
        """
        if not self._resetting.acquire(blocking=False):
            raise StateError(f"device {self.name}: another reset is under way")
        try:
            with self._lock:
                is_left = self._leave_fault()
                if not is_left:
                    self._start_servo()
            if not is_left:
                self._await_restart()
        finally:
            self._resetting.release()
        self.is_free = False

    def _await_restart(self) -> None:
        if not self.wait_ready(_RESTART):
            raise DaemonError(
                self.failure or f"the servo process of {self.name} is not ready in {_RESTART:g} s"
            )
        if self._servo.fault is Fault.DEVICE_FAULT:
            # The new servo found the device as stopped as the old one left it.
            with self._lock:
                self._leave_fault()

    def _leave_fault(self) -> bool:
        """Clear the servo's fault; return whether a servo is running."""
        if not self._servo.is_alive:
            return False
        try:
            self._servo.read_notes()  # an old fault would otherwise count as one after the reset
            self._queue.tend()
            self._servo.leave_fault()
        except DaemonError:
            # A servo that has lost its device may be ending when the reset arrives.
            if self._servo.ends_within(_ENDING):
                return False
            raise
        return True

    def pause(self) -> None:
        """Come to rest on the path, to be resumed."""
        with self._lock:
            self._queue.pause()

    def resume(self) -> None:
        """Resume after :meth:`pause`, at the set speed."""
        with self._lock:
            self._queue.unpause()

    def set_speed(self, speed: float) -> None:
        """Run at *speed* times as fast as planned, now and from now on.

        Raises:
            ValueError: *speed* is not in (0, 1].
        """
        if not 0.0 < speed <= 1.0:
            raise ValueError(f"speed must be above 0 and at most 1, got {speed!r}")
        with self._lock:
            self._queue.set_speed(speed)

    # What there is to see

    def snapshot(self) -> DeviceSnapshot:
        """Return the device as it is now."""
        cycle = self._servo.newest()
        if cycle is not None and cycle.state is ServoState.FAULT:
            self._learn_why()
        return take_snapshot(
            self._servo, self._queue, cycle, number=self._number, lead_cycles=self._lead_cycles
        )

    def _learn_why(self) -> None:
        """Read the servo's notes on its fault, if the device's thread has not yet."""
        if self._servo.fault is Fault.NONE and self._lock.acquire(blocking=False):
            try:
                self._servo.read_notes()
            finally:
                self._lock.release()

    @property
    def next_cycle(self) -> int:
        """Number of the cycle that comes next; it begins again with each servo process."""
        return self._servo.next_cycle

    def cycle_records(self, since: int, limit: int = 4096) -> list[bytes]:
        """Return the records of cycles from number *since* on, as far as they are still known."""
        return self._servo.cycle_records(since, limit)

    def cycles(self, since: int, limit: int = 4096) -> list[Cycle]:
        """Return cycles from number *since* on, oldest first, as far as they are still known."""
        return [unpack_cycle(record) for record in self._servo.cycle_records(since, limit)]

    def outline(self) -> Sequence[Sequence[Vector3]]:
        """Return the device's shape as it stands: lines, m; none if it has no axes."""
        cycle = self._servo.newest()
        return self._axes.outline(cycle.joints) if cycle is not None and cycle.joints else ()

    # The thread

    def _watch(self) -> None:
        while not self._closing.wait(TICK):
            while not self._lock.acquire(timeout=TICK):
                self._servo.beat()  # a command waits for the servo's answer
            try:
                if self._servo.memory is None or self._closing.is_set() or self._servo.failure:
                    continue
                try:
                    self._tick()
                except Exception as error:  # noqa: BLE001 - or it would go on unwatched
                    if self._servo.is_alive:
                        self._give_up(error)
                    else:
                        self._lose()
            finally:
                self._lock.release()

    def _measure(self) -> None:
        errors = LoopErrors(_log, f"{self.name}: motions are not measured")
        while not self._closing.wait(_MEASURE):
            with errors.logged():
                self._queue.measure()

    def _tick(self) -> None:
        self._servo.beat()
        is_alive, memory = self._servo.is_alive, self._servo.memory
        if self._cycle_memory is not None and memory is not None:
            self._cycle_memory.take(memory.cycles, is_last=not is_alive)
        if not is_alive:
            self._lose()
            return
        self._servo.read_notes()
        self._take_stops()
        self._queue.tend()

    def _give_up(self, error: Exception) -> None:
        """Stop the servo, since nothing watches it any more."""
        # Without a heartbeat it stops anyway; the command is sooner.
        self._servo.brake()
        is_known = isinstance(error, DaemonError)
        _log.error("%s: watching the servo failed: %s", self.name, error, exc_info=not is_known)
        self._servo.fail(Fault.INTERNAL, f"{type(error).__name__}: {error}")
        self._queue.drop(self._servo.failure)

    def _lose(self) -> None:
        """Report a servo that has ended, and with it the end of its motions."""
        self._servo.lose()
        self._queue.drop(self._servo.failure)

    # Events

    def tell(self, kind: EventKind, text: str) -> None:
        """Report an event that is not one of a motion; returns at once."""
        queued = self._queue.present if kind is EventKind.FAULT else None
        self._on_event(DeviceEvent(self.name, kind, text, time.monotonic_ns(), queued))

    def _tell(
        self, kind: EventKind, queued: QueuedMotion, text: str, lease: Lease | None = None
    ) -> None:
        """Report what has happened to a motion; it has ended by most of that."""
        ended, now_ns = self._how(kind, queued, text), time.monotonic_ns()
        self._on_event(DeviceEvent(self.name, kind, text, now_ns, queued, ended, lease))
        if ended is not None:
            self._conclude(queued, ended)

    def _how(self, kind: EventKind, queued: QueuedMotion, text: str) -> Ended | None:
        """Return how a motion has ended, and why; ``None`` if it has not by that."""
        outcome = _OUTCOMES.get(kind)
        if outcome != pb.OUTCOME_STOPPED:
            return None if outcome is None else (outcome, text)
        now = self.snapshot()
        if now.fault is not Fault.NONE:
            return pb.OUTCOME_FAULT, now.fault_text or text
        self._take_stops()
        reason = queued.reason
        if not reason or text in (STOPPED, reason):
            return pb.OUTCOME_STOPPED, reason or text
        return pb.OUTCOME_STOPPED, f"{text}: {reason}"

    def _conclude(self, queued: QueuedMotion, ended: Ended) -> None:
        self._unfinished.pop(queued, None)
        if not queued.ended.done():
            queued.ended.set_result(ended)
            self.last_ended = queued


def _note(motions: Iterable[QueuedMotion], reason: str) -> None:
    """Note the reason for which *motions* end, unless there is one already."""
    for queued in motions:
        queued.reason = queued.reason or reason
