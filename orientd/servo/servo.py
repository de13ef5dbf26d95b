"""The servo: what happens in one cycle, whichever clock drives it.

Read the device, take a command, look whether everybody is still alive, move the setpoint along the
path, let the guard look at it, write it, publish the cycle.  Nothing here waits, and nothing grows.
:mod:`orientd.servo.process` calls :meth:`Servo.cycle` on time; tests call it as fast as they like.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace

from orientd.clock import Clock
from orientd.driver import IDENTITY, ZERO, Driver, Feedback, Quaternion, Setpoint, Vector3
from orientd.errors import (
    DeviceFaultError,
    Fault,
    FeedbackError,
    LinkError,
    NotYetError,
    StateError,
)
from orientd.floats import difference, norm
from orientd.servo.guard import Guard
from orientd.servo.path import (
    BrakeLaw,
    Leg,
    Past,
    PathClock,
    PathFollower,
    PathPoint,
    Place,
    StarvedError,
    eased,
)
from orientd.servo.stall import Stalls
from orientd.servo.state_table import Event, advance
from orientd.servo.tracking import Pursuit
from orientd.servo.watchdog import Vigil, Watch
from orientd.stream import (
    CYCLE_RECORD,
    GIVEN_UP_WORD,
    HEAD,
    JOINTS,
    NO_JOINTS,
    UNKNOWN,
    Answer,
    Command,
    CycleFlag,
    NoteKind,
    SharedMemory,
    State,
    Terms,
    pack_note,
)

# Looking a member up in its enumeration takes longer than comparing it.
_STREAMING, _STOPPING, _TRACKING = State.STREAMING, State.STOPPING, State.TRACKING
_NO_FAULT = Fault.NONE
_WRITTEN, _FEEDBACK = int(CycleFlag.WRITTEN), int(CycleFlag.FEEDBACK)

_NEVER_TOO_LATE = (Command.STOP, Command.HALT, Command.SHUTDOWN)

PARENT_CHECK = 8
"""Cycles from one look at whether the daemon lives to the next; it is a system call."""

_NO_FEEDBACK = Feedback(0, IDENTITY)
_NO_TERMS = Terms(1e-9, 1e-9, 1e-9, 1e-9, 1e-9, 1.0)
_START_TOLERANCE = 1e-9
_EASINGS = 3


class Servo:
    """One device: its state, its path and its last setpoint.

    Args:
        driver: an opened driver.
        memory: the rings shared with the daemon.
        period_ns: cycle period.
        watch: time limits.
        clock: the clock that feedback and heartbeat are stamped with.
        parent_is_alive: whether the daemon that started this process still is.
    """

    def __init__(
        self,
        driver: Driver,
        memory: SharedMemory,
        *,
        period_ns: int,
        watch: Watch,
        clock: Clock,
        parent_is_alive: Callable[[], bool],
    ) -> None:
        self.state = State.IDLE
        self.ending = ""
        self.overruns = 0
        self.missed = 0
        self.work_ns = 0
        self._driver = driver
        self._memory = memory
        self._vigil = Vigil(watch, period_ns)
        self._stalls = Stalls(period_ns, watch.stall_ns)
        self._clock = clock
        self._parent_is_alive = parent_is_alive
        self._period_ns = period_ns
        period = period_ns * 1e-9
        self._path_clock = PathClock(period)
        self._speed = 0.0
        self._follower = PathFollower(memory.path, period, _NO_TERMS)
        self._guard = Guard(period)
        self._brake_law = BrakeLaw(self._path_clock, self._follower, self._guard)
        self._terms = _NO_TERMS
        self._start_ns = UNKNOWN
        self._is_waiting = False
        self._pursuit = Pursuit(memory.targets, period)
        self._escape: Iterator[tuple[Quaternion, Vector3]] | None = None
        self._fault = Fault.NONE
        self._fault_text = ""
        self._is_enabled = False
        self._is_orderly = False
        self._feedback: Feedback | None = None
        self._enabled_ns = 0
        self._motion = 0
        self._last = PathPoint(IDENTITY, ZERO, ZERO, ZERO, ZERO)
        self._taken = 0  # what was asked for before the process was ready counts
        self._cycle_count = 0
        self._moved_ns = 0

    @property
    def is_moving(self) -> bool:
        """Whether setpoints change."""
        state = self.state
        return state is _STREAMING or state is _STOPPING or state is _TRACKING

    @property
    def _held(self) -> PathPoint:
        """Where the device is held: the last setpoint, at rest."""
        last = self._last
        return PathPoint(last.q, ZERO, ZERO, last.position, ZERO)

    def cycle(self, deadline_ns: int, lateness_ns: int) -> None:
        """Do the work of one cycle.

        Args:
            deadline_ns: when it was due.
            lateness_ns: how much later it began.
        """
        # Few calls, wide or deep: where caches are cold, one costs as much as a quaternion product.
        try:
            self._feedback = self._driver.read() or self._feedback
        except Exception as error:  # noqa: BLE001 - a driver's defect must not end the servo
            self._take_fault(error)
        if self._taken != self._memory.commands.words[HEAD]:
            self._take_command()
        self._look_for_life(deadline_ns)
        now_ns = self._clock.now_ns()
        gap_ns, self._moved_ns = now_ns - self._moved_ns, now_ns
        if gap_ns > self._stalls.shortest_ns and self.is_moving:
            self._go_on_from_rest(gap_ns)
        if self.is_moving:
            point = self._move(deadline_ns)
        else:
            point = self._held
            self._guard.hold()
        self._last = point
        is_written = self._is_enabled
        if is_written:
            try:
                self._driver.write(tuple.__new__(Setpoint, (deadline_ns, *point)))
            except Exception as error:  # noqa: BLE001 - a driver's defect must not end the servo
                self._take_fault(error)
                is_written = False
        self._publish(deadline_ns, lateness_ns, point, is_written=is_written)

    def request_end(self, reason: str) -> None:
        """Stop on the path if something moves; the process ends once it holds."""
        if not self.ending:
            self.ending = reason
            if self.state is _STREAMING or self.state is _TRACKING:
                self._stop(Event.STOP)

    @property
    def has_ended(self) -> bool:
        """Whether the end was asked for and nothing moves any more."""
        return bool(self.ending) and not self.is_moving

    def request_orderly_end(self, reason: str) -> None:
        """End as the daemon would have it, unless the daemon is gone: then the device holds."""
        self._is_orderly = self._parent_is_alive()
        self.request_end(reason)

    def close(self) -> None:
        """Leave the device parked after an orderly end, else holding, and let go of it."""
        try:
            if self._is_enabled:
                self._driver.disable()
        except Exception as error:  # noqa: BLE001 - whatever a driver raises, the process ends
            self.ending += f"; disable failed: {error}"
        self._is_enabled = False
        if self._is_orderly and self.state is not State.FAULT:
            try:
                self._driver.park()
            except Exception as error:  # noqa: BLE001 - whatever a driver raises, the process ends
                self.ending += f"; park failed: {error}"
        self._driver.close()

    def report(self) -> dict[str, object]:
        """Return what the process writes down when it ends."""
        return {
            "reason": self.ending,
            "state": self.state.name.lower(),
            "fault": self._fault.name.lower(),
            "fault_text": self._fault_text,
            "motion": self._motion,
            "cycles": self._cycle_count,
            "overruns": self.overruns,
            "missed": self.missed,
            "orientation": dict(zip("wxyz", self._last.q, strict=True)),
            "position": list(self._last.position),
        }

    # The device

    def _take_fault(self, error: Exception) -> None:
        """Turn what a driver raised into a fault: at once, or after a stop on the path."""
        if isinstance(error, FeedbackError):
            self._brake(Fault.FEEDBACK_STALE, str(error))
        elif isinstance(error, LinkError):
            self._fail(Fault.LINK_LOST, str(error))
        elif isinstance(error, DeviceFaultError):
            self._fail(Fault.DEVICE_FAULT, str(error))
        else:
            self._fail(Fault.INTERNAL, f"{type(error).__name__}: {error}")

    # Commands

    def _take_command(self) -> None:
        ring = self._memory.commands
        fields = ring.read(self._taken)
        if fields is None:
            return  # still being written; it is there in the next cycle
        self._taken += 1
        index, code, motion, path_index, leave, final, start_ns, speed, *terms = fields
        if index < ring.words[GIVEN_UP_WORD] and code not in _NEVER_TOO_LATE:
            return
        leg = Leg(motion, path_index, Terms.from_floats(terms), leave, final)
        try:
            text = self._obey(Command(code), leg, speed, start_ns)
            answer = Answer.REFUSED if text else Answer.DONE
        except StateError as error:
            is_early = isinstance(error, NotYetError)
            answer, text = Answer.NOT_YET if is_early else Answer.WRONG_STATE, str(error)
        except Exception as error:  # noqa: BLE001 - a driver's defect must not end the servo
            answer, text = Answer.FAILED, str(error) or type(error).__name__
        self._memory.notes.publish(*pack_note(index, NoteKind.ANSWER, answer, text))

    def _obey(self, command: Command, leg: Leg, speed: float, start_ns: int) -> str:
        """Carry out one command; return why it was refused, or nothing."""
        if command is Command.STOP:
            self._stop(Event.STOP)
        elif command is Command.SPEED:
            following = advance(self.state, Event.SPEED)
            if not 0.0 <= speed <= 1.0:
                return f"speed must be between 0 and 1, got {speed!r}"
            self._speed = speed
            self.state = following
        elif command is Command.START:
            return self._start(leg, speed, start_ns)
        elif command is Command.SPLICE:
            return self._splice(leg)
        elif command is Command.HALT:
            self._stop(Event.HALT)
            if self.is_moving and self._escape is None and not self._pursuit.is_on:
                self._escape = self._guard.soft_stop(self._terms)
        elif command is Command.TRACK:
            self._track(leg)
        elif command is Command.TUNE:
            return self._tune()
        elif command is Command.ENABLE:
            self._enable()
        elif command is Command.DISABLE:
            following = advance(self.state, Event.DISABLE)
            self._is_enabled = False
            self._driver.disable()
            self.state = following
        elif command is Command.RESET:
            following = advance(self.state, Event.RESET)
            if self._is_enabled:
                self._is_enabled = False
                self._driver.disable()
            self._driver.reset()
            self._fault, self._fault_text = Fault.NONE, ""
            self.state = following
        elif command is Command.SHUTDOWN:
            self._is_orderly = True
            self.request_end("the daemon asked for it")
        return ""

    def _tune(self) -> str:
        """Hand the driver the options of the motions to come; return why it refuses them."""
        advance(self.state, Event.TUNE)
        ring = self._memory.tunings
        fields = ring.read(ring.head - 1)
        if fields is None:
            return "the options are not there"
        _, length, text = fields
        try:
            self._driver.tune(json.loads(text[:length]))
        except ValueError as error:
            return str(error)
        return ""

    def _enable(self) -> None:
        following = advance(self.state, Event.ENABLE)
        if self._is_enabled:
            return
        feedback = self._driver.enable()
        self._feedback = feedback
        self._last = PathPoint(feedback.q, ZERO, ZERO, feedback.position, ZERO)
        self._guard.anchor(feedback.q, feedback.position)
        self._path_clock.halt()
        self._enabled_ns = self._clock.now_ns()
        self._is_enabled = True
        self.state = following

    def _start(self, leg: Leg, speed: float, start_ns: int) -> str:
        following = advance(self.state, Event.START)
        first = self._follower.peek(leg.first)
        if first is None:
            return f"path record {leg.first} is not in the ring"
        gap = norm(difference(self._last.q, first.q))
        if not gap <= _START_TOLERANCE:
            return f"the path begins {gap:.3g} rad from the commanded orientation"
        brake_rate = leg.terms.brake_rate
        if not (brake_rate > 0.0 and 0.0 <= speed <= 1.0):
            return f"brake rate and speed must be positive, got {brake_rate!r} and {speed!r}"
        self._speed = speed
        self._start_ns, self._is_waiting = start_ns, True
        self._path_clock.begin(brake_rate, 0.0)
        self._follower.begin(leg)
        self._adopt(leg)
        self.state = following
        return ""

    def _splice(self, leg: Leg) -> str:
        """Have *leg* replace the rest of the path, or follow at its end."""
        following = advance(self.state, Event.SPLICE)
        clock, brake_rate = self._path_clock, leg.terms.brake_rate
        if not brake_rate > 0.0:
            return f"brake rate must be positive, got {brake_rate!r}"
        if clock.is_led or (not clock.is_steady and brake_rate < clock.brake_rate):
            raise NotYetError("the speed is changing")
        problem = self._follower.splice(leg)
        if not problem:
            # Until the path of before is behind, a stop keeps the limits of both.
            clock.brake_rate = min(brake_rate, clock.brake_rate)
            self.state = following
        return problem

    def _adopt(self, leg: Leg) -> None:
        """Keep what the motion promised that the path has come to."""
        self._terms = leg.terms
        self._motion = leg.number
        if self._path_clock.is_steady and not self._follower.is_spliced:
            self._path_clock.brake_rate = leg.terms.brake_rate

    def _track(self, leg: Leg) -> None:
        """Follow targets from here on, whatever moves at present."""
        following = advance(self.state, Event.TRACK)
        guard = self._guard
        self._path_clock.halt()
        # Where a narrower limit is broken already, what there is of it is taken away.
        speed = max(leg.terms.linear_velocity, norm(guard.velocity))
        self._terms, self._motion = replace(leg.terms, linear_velocity=speed), leg.number
        self._pursuit.begin(guard.q, guard.omega, guard.alpha, leg.terms)
        self.state = following

    def _stop(self, event: Event) -> None:
        """Begin to come to rest, on the path or away from the target."""
        following = advance(self.state, event)
        self._path_clock.target = 0.0
        self._pursuit.cease()
        self.state = following

    # Motion

    def _move(self, deadline_ns: int) -> PathPoint:
        """Return the next setpoint of a motion or of a stop."""
        if self._escape is not None:
            return self._step_off_path()
        if self._pursuit.is_on:
            return self._follow(deadline_ns)
        clock, follower, share = self._path_clock, self._follower, 1.0
        if self.state is _STREAMING:
            speed = self._speed * self._driver.speed_scaling
            if self._is_waiting:
                share = self._share_run(deadline_ns)
                if share <= 0.0:
                    return self._held
                self._is_waiting = False
                # The path is at rest there: it needs no run-up in time.
                clock.begin(clock.brake_rate, speed)
            clock.target = speed
            if not follower.reaches(clock.braking_cycles):
                self._brake(Fault.PATH_STARVED, "the daemon did not deliver the path in time")
        before, leg = clock.rate, follower.leg
        if clock.is_led or clock.target == 0.0 < before:
            rate = self._brake_law.advance(self._terms, may_end=self.state is _STOPPING)
        else:
            rate = clock.advance()
        try:
            path, place = follower.look(rate * share)
            terms = self._terms if place.leg is leg else place.leg.terms
            problem = self._guard.admit(path.q, path.position, terms)
            if problem and not clock.is_led and (rate != 1.0 or follower.fraction):
                path, place, rate, problem = self._ease(path, place, rate, problem)
        except StarvedError as error:
            return self._leave_path(Fault.PATH_STARVED, str(error))
        follower.move(place)
        if follower.leg is not leg:
            self._adopt(follower.leg)
        if problem:
            return self._leave_path(Fault.LIMIT_GUARD, f"the next setpoint would reach {problem}")
        if follower.is_at_end:
            clock.halt()
            self._finish(Event.FINISH if self.state is _STREAMING else Event.REST)
            return path
        if self.state is _STOPPING and clock.is_at_rest and before == 0.0:
            self._finish(Event.REST)
        if rate == 1.0 == before:
            return path
        change = (rate - before) / clock.period
        return PathPoint(
            path.q,
            _combine(path.omega_body, rate, path.omega_body, 0.0),
            _combine(path.alpha_body, rate * rate, path.omega_body, change),
            path.position,
            _combine(path.velocity, rate, path.velocity, 0.0),
        )

    def _share_run(self, deadline_ns: int) -> float:
        """Return for which share of the cycle that begins the motion that waits is to run.

        A setpoint is where the device is to be at the end of its cycle, so that devices whose
        cycles begin at other instants are as far along their paths at every instant.
        """
        if self._start_ns == UNKNOWN:
            return 1.0
        period_ns = self._period_ns
        return min((deadline_ns + period_ns - self._start_ns) / period_ns, 1.0)

    def _ease(
        self, path: PathPoint, place: Place, rate: float, problem: str
    ) -> tuple[PathPoint, Place, float, str]:
        """Return point and place on the path that another rate leads to, that, and what is wrong.

        Where the path bends sharply the differences between its records may be somewhat larger than
        on them, on which the certificate has looked: a little slower or faster keeps the limits.
        """
        clock, follower, guard = self._path_clock, self._follower, self._guard
        leg = place.leg
        terms = self._terms if leg is follower.leg else leg.terms
        past, tried, other = Past(guard.omega, guard.alpha, guard.velocity), path, rate
        for _ in range(_EASINGS):
            rates = guard.rates(tried.q, tried.position)
            found = eased(past, *rates, tried, other, terms, clock.period)
            if found is None or found + follower.fraction >= 2.0:
                break
            seen, there = follower.look(found)
            if there.leg is not leg:
                break
            other, tried = found, seen
            if not guard.admit(tried.q, tried.position, terms):
                clock.ease(other)
                return tried, there, other, ""
        return path, place, rate, problem

    def _go_on_from_rest(self, stall_ns: int) -> None:
        """Have what moved go on from where the device has come to rest, if it may."""
        guard = self._guard
        guard.anchor(guard.q, guard.position)
        self._path_clock.halt()
        self._escape = None
        problem = self._stalls.complain(stall_ns)
        if self.state is _STOPPING:
            self._finish(Event.REST)
        elif problem:
            self._pursuit.end()
            self._fail(Fault.SERVO_STALLED, problem, is_enabled=self._is_enabled)
        elif self.state is _TRACKING:
            self._pursuit.rest(guard.q)

    def _follow(self, deadline_ns: int) -> PathPoint:
        """Return the next setpoint on the way to a target, or to rest."""
        pursuit, guard = self._pursuit, self._guard
        if self.state is _TRACKING:
            pursuit.aim(deadline_ns)
        point, position = pursuit.step(deadline_ns), guard.braked_position(self._terms)
        problem = guard.admit(point.q, position, self._terms)
        if problem:
            return self._leave_path(Fault.LIMIT_GUARD, f"the next setpoint would reach {problem}")
        if self.state is _STOPPING and pursuit.is_at_rest and guard.velocity == ZERO:
            self._finish(Event.REST)
        return PathPoint(point.q, point.omega_body, point.alpha_body, position, guard.velocity)

    def _leave_path(self, fault: Fault, text: str) -> PathPoint:
        """Begin to come to rest without the path."""
        self._brake(fault, text)
        self._escape = self._guard.soft_stop(self._terms)
        return self._step_off_path()

    def _step_off_path(self) -> PathPoint:
        guard = self._guard
        step = next(self._escape, None) if self._escape is not None else None
        if step is None:
            self._escape = None
            self._path_clock.halt()
            self._finish(Event.REST)
            return PathPoint(guard.q, ZERO, ZERO, guard.position, ZERO)
        return PathPoint(step[0], guard.omega, guard.alpha, step[1], guard.velocity)

    def _finish(self, event: Event) -> None:
        """Go to rest: into holding, or into the fault that made the stop necessary."""
        self._path_clock.halt()
        self._pursuit.end()
        if self._fault is not _NO_FAULT:
            self._fail(self._fault, self._fault_text, is_enabled=self._is_enabled)
        else:
            self.state = advance(self.state, event)

    # Faults

    def _look_for_life(self, now_ns: int) -> None:
        if self._cycle_count % PARENT_CHECK == 0 and not self._parent_is_alive():
            self.request_end("the daemon is gone")
        vigil, heartbeat_ns = self._vigil, self._memory.pulse[0]
        measured_ns = self._feedback.time_ns if self._feedback else 0
        if not vigil.notice(now_ns, heartbeat_ns, measured_ns):
            return
        if self.state is _STREAMING or self.state is _TRACKING:
            problem = vigil.complain_of_daemon(heartbeat_ns, now_ns)
            if problem:
                self._brake(Fault.HEARTBEAT_LOST, problem)
        if self._is_enabled and self._fault is _NO_FAULT:
            problem = vigil.complain_of_device(max(measured_ns, self._enabled_ns), now_ns)
            if problem:
                self._brake(Fault.FEEDBACK_STALE, problem)

    def _brake(self, fault: Fault, text: str) -> None:
        """Stop on the path, then be in *fault*; the first reason is the one that is kept."""
        if self._fault is not _NO_FAULT:
            return
        if self.is_moving:
            self._fault, self._fault_text = fault, text
            self._stop(Event.BRAKE)
        else:
            self._fail(fault, text, is_enabled=self._is_enabled)

    def _fail(self, fault: Fault, text: str, *, is_enabled: bool = False) -> None:
        """Be in *fault* now; unless *is_enabled*, nothing more is written to the device."""
        if self.state is State.FAULT and self._fault is fault:
            return
        self._fault, self._fault_text = fault, text
        self._escape = None
        self._pursuit.end()
        self._path_clock.halt()
        self.state = advance(self.state, Event.FAIL)
        self._memory.notes.publish(*pack_note(0, NoteKind.FAULT, fault, text))
        if self._is_enabled and not is_enabled:
            self._is_enabled = False
            try:
                self._driver.disable()
            except Exception as error:  # noqa: BLE001 - the fault stands, whatever disable raises
                self._fault_text = f"{text}; disable failed: {error}"
        if self._driver.is_spent:
            self.request_end(text)

    def _publish(
        self, deadline_ns: int, lateness_ns: int, point: PathPoint, *, is_written: bool
    ) -> None:
        flags = _WRITTEN if is_written else 0
        measured = self._feedback
        if measured:
            flags |= _FEEDBACK
        else:
            measured = _NO_FEEDBACK
        joints = measured.joints
        follower, ring = self._follower, self._memory.cycles
        record = CYCLE_RECORD.pack(
            ring.words[HEAD],
            deadline_ns,
            lateness_ns,
            self.work_ns,
            measured.time_ns,
            follower.index,
            self.state,
            self._fault,
            self._motion,
            flags,
            self.overruns,
            self.missed,
            follower.fraction,
            self._path_clock.rate,
            *point.q,
            *point.omega_body,
            *point.alpha_body,
            *point.position,
            *measured.q,
            *measured.omega_body,
            *measured.position,
            *((joints + NO_JOINTS)[:JOINTS] if joints else NO_JOINTS),
        )
        ring.append(record)
        self._cycle_count += 1


def _combine(a: Vector3, s: float, b: Vector3, t: float) -> Vector3:
    return (a[0] * s + b[0] * t, a[1] * s + b[1] * t, a[2] * s + b[2] * t)
