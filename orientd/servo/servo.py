"""The servo: the work of one cycle, with any clock.

Read the device, take a command, check that daemon and device are alive, make the next setpoint
(:mod:`orientd.servo.setpoint_generator`), write it, publish the cycle.  Nothing here waits, and
nothing grows.  :mod:`orientd.servo.process` calls :meth:`Servo.cycle` on time; tests call it as
fast as they like.
"""

from __future__ import annotations

import json
from collections.abc import Callable

from orientd.clock import Clock
from orientd.driver import (
    IDENTITY,
    Arriving,
    Driver,
    Explaining,
    Feedback,
    Freeable,
    Parkable,
    Resettable,
    RestsInFault,
    Setpoint,
    feedback_problem,
    tune,
)
from orientd.errors import (
    AxisFaultError,
    DeviceError,
    DeviceFaultError,
    Fault,
    NotYetError,
    SpentLinkError,
    StateError,
)
from orientd.mechanism.mechanism import Mechanical
from orientd.servo.device_reports import Arrival, DeviceReports
from orientd.servo.keep_out_cones import KeepOutCones
from orientd.servo.path.path_follower import PathPart
from orientd.servo.path.segment import PathPoint
from orientd.servo.setpoint_generator import SetpointGenerator
from orientd.servo.state_table import advance
from orientd.servo.stop_socket import StopSocket
from orientd.servo.watchdog import ServoWatchdog, WatchdogTimeouts
from orientd.stream.memory import GIVEN_UP_WORD, LONGEST_READ_WORD, LONGEST_WRITE_WORD, SharedMemory
from orientd.stream.records import (
    CYCLE_RECORD,
    JOINTS,
    NO_JOINTS,
    NO_Q,
    Answer,
    Command,
    CycleFlag,
    NoteKind,
    ServoLimits,
    ServoState,
    pack_note,
)
from orientd.stream.ring import HEAD

# Attribute access on an enumeration takes longer than a comparison.
_DRIVEN = (ServoState.STREAMING, ServoState.TRACKING)
_STREAMING, _HOLDING = ServoState.STREAMING, ServoState.HOLDING
_FEEDBACK, _WRITTEN, _FROM_REST, _ARRIVING = map(int, CycleFlag)

_NEVER_TOO_LATE = (Command.STOP, Command.HALT, Command.SHUTDOWN)
_LETTING_GO = (Command.DISABLE, Command.FREE, Command.RESET)

MOST_COUNTED = 2**32 - 1
"""Largest count of overruns or missed deadlines that a cycle record has space for."""

PARENT_CHECK = 8
"""Cycles between two checks whether the daemon lives, which take a system call."""

_NO_FEEDBACK = Feedback(0, IDENTITY)


def fault_of(error: Exception) -> Fault:
    """Return the fault for an exception of a driver."""
    return error.fault if isinstance(error, DeviceError) else Fault.INTERNAL


class Servo:
    """One device with its connections to the daemon.

    Attributes:
        ending: why the process ends; empty while it runs.
        overruns: cycles that began more than half a period late.
        missed: deadlines that were skipped.
        work_ns: duration of the last cycle.
        setpoints: state, path, and the next setpoint.
        reports: reports of the driver outside the cycles.

    Args:
        driver: an opened driver.
        memory: the rings shared with the daemon.
        period_ns: cycle period.
        watch: time limits.
        clock: the clock for feedback and heartbeat.
        parent_is_alive: whether the daemon that started this process still is.
        stop_socket: receives stops without the daemon.
        cones: keep-out cones of the device; ``None`` if it has none.
    """

    def __init__(
        self,
        driver: Driver,
        memory: SharedMemory,
        *,
        period_ns: int,
        watch: WatchdogTimeouts,
        clock: Clock,
        parent_is_alive: Callable[[], bool],
        stop_socket: StopSocket | None = None,
        cones: KeepOutCones | None = None,
    ) -> None:
        self.ending = ""
        self.overruns = 0
        self.missed = 0
        self.work_ns = 0
        self._driver = driver
        self._memory = memory
        self._period = period_ns * 1e-9
        self._watchdog = ServoWatchdog(watch, period_ns)
        self._clock = clock
        self._parent_is_alive = parent_is_alive
        self._stop_socket = stop_socket
        self.setpoints = SetpointGenerator(
            driver,
            memory,
            period_ns=period_ns,
            stall_ns=watch.stall_ns,
            on_fault=self._tell_fault,
            cones=cones,
        )
        self._arrival = Arrival(driver if isinstance(driver, Arriving) else None)
        self._resting = driver if isinstance(driver, RestsInFault) else None
        self._is_enabled = False
        self._is_orderly = False
        self._feedback = _NO_FEEDBACK
        self._enabled_ns = 0
        self._taken = 0  # commands from before the process was ready count
        self._cycle_count = 0
        self.reports = DeviceReports(driver, memory, period_ns)

    @property
    def state(self) -> ServoState:
        """The servo's state."""
        return self.setpoints.state

    @property
    def is_moving(self) -> bool:
        """Whether setpoints change."""
        return self.setpoints.is_moving

    def cycle(self, deadline_ns: int, lateness_ns: int) -> None:
        """Do the work of one cycle.

        Args:
            deadline_ns: its deadline.
            lateness_ns: how much later it began.
        """
        # Few calls: with cold caches, a call costs as much as a quaternion product.
        begun_ns = self._clock.now_ns()
        try:
            self._take_feedback(self._driver.read())
        except Exception as error:  # noqa: BLE001 - a driver's defect must not end the servo
            self.take_fault(error)
        self.reports.note_call(LONGEST_READ_WORD, self._clock.now_ns() - begun_ns)
        if self._taken != self._memory.commands.words[HEAD]:
            self._take_command()
        if self._stop_socket is not None:
            self._take_stops(self._stop_socket)
        self._look_for_life(deadline_ns)
        before = self.setpoints.state
        try:
            point = self.setpoints.step(deadline_ns, self._clock.now_ns())
        except Exception as error:  # noqa: BLE001 - what others may write must not end the servo
            point = self._lose_path(error)
        if self.setpoints.pursuit.hindrance:
            self.reports.publish_hindrance(self.setpoints.pursuit.hindrance, self._cycle_count)
        is_written = self._is_enabled
        if is_written:
            begun_ns = self._clock.now_ns()
            try:
                setpoint = tuple.__new__(Setpoint, (deadline_ns, *point[:6]))
                self._driver.write(setpoint)
            except Exception as error:  # noqa: BLE001 - a driver's defect must not end the servo
                self.take_fault(error, is_of_write=True)
                is_written = False
            self.reports.note_call(LONGEST_WRITE_WORD, self._clock.now_ns() - begun_ns)
        if before is _STREAMING and self.setpoints.state is _HOLDING:
            self._arrival.begin(self._clock.now_ns())
        if self._arrival.is_awaited:
            self._await_arrival()
        self._publish(deadline_ns, lateness_ns, point, is_written=is_written)

    def count_late(self, *, overruns: int = 0, missed: int = 0) -> None:
        """Count cycles that began late, and deadlines that were skipped."""
        self.overruns = min(self.overruns + overruns, MOST_COUNTED)
        self.missed = min(self.missed + missed, MOST_COUNTED)

    def _await_arrival(self) -> None:
        """Check whether the axes have reached the end of the motion, and fault if they do not."""
        arrival = self._arrival
        if self.setpoints.state is not _HOLDING:
            arrival.is_awaited = False
            return
        try:
            problem = arrival.look(self._feedback.time_ns)
            if problem:
                raise AxisFaultError(problem)
        except Exception as error:  # noqa: BLE001 - a driver's defect must not end the servo
            arrival.is_awaited = False
            self.take_fault(error)

    def request_end(self, reason: str) -> None:
        """Stop on the path if something moves; the process ends once it holds."""
        if not self.ending:
            self.ending = reason
            if self.setpoints.state in _DRIVEN:
                self.setpoints.stop()

    @property
    def has_ended(self) -> bool:
        """Whether the end was requested and the device stands."""
        setpoints = self.setpoints
        return bool(self.ending) and not (setpoints.is_moving or setpoints.is_coming_to_rest)

    def request_orderly_end(self, reason: str) -> None:
        """End as the daemon requested, unless the daemon is gone: then the device holds."""
        self._is_orderly = self._parent_is_alive()
        self.request_end(reason)

    def close(self) -> None:
        """Leave the device parked after an orderly end, otherwise holding, and release it."""
        try:
            if self._is_enabled:
                self._driver.disable()
        except Exception as error:  # noqa: BLE001 - the process ends at any exception
            self.ending += f"; disable failed: {error}"
        self._is_enabled = False
        driver = self._driver
        if self._is_orderly and self.state is not ServoState.FAULT and isinstance(driver, Parkable):
            try:
                driver.park()
            except Exception as error:  # noqa: BLE001 - the process ends at any exception
                self.ending += f"; park failed: {error}"
        try:
            driver.close()
        except Exception as error:  # noqa: BLE001 - the process ends at any exception
            self.ending += f"; close failed: {error}"

    def report(self) -> dict[str, object]:
        """Return the text that the process writes down when it ends."""
        setpoints = self.setpoints
        return {
            "reason": self.ending,
            "state": setpoints.state.name.lower(),
            "fault": setpoints.fault.name.lower(),
            "fault_text": setpoints.fault_text,
            "motion": setpoints.motion,
            "cycles": self._cycle_count,
            "overruns": self.overruns,
            "missed": self.missed,
            "longest_read_ns": self._memory.pulse[LONGEST_READ_WORD],
            "longest_write_ns": self._memory.pulse[LONGEST_WRITE_WORD],
            "orientation": dict(zip("wxyz", setpoints.last.q, strict=True)),
            "position": list(setpoints.last.position),
        }

    def _lose_path(self, error: Exception) -> PathPoint:
        """Come to rest: the servo received invalid data, as *error* tells."""
        text = f"the servo received invalid data: {type(error).__name__}: {error}"
        try:
            self.setpoints.last = self.setpoints.leave_path(Fault.INTERNAL, text)
        except Exception:  # noqa: BLE001 - nor do the limits
            self._fail(Fault.INTERNAL, text)
        return self.setpoints.last

    # The device

    def _take_feedback(self, feedback: Feedback | None) -> None:
        """Use *feedback* from here on, or brake if it is malformed: the setpoints are still right.

        Everything that reads the feedback afterwards relies on this check.
        """
        if feedback is None or feedback is self._feedback:
            return
        problem = feedback_problem(feedback, self._clock.now_ns())
        if problem:
            text = f"the driver's feedback is malformed: {problem}"
            self.setpoints.brake(Fault.INTERNAL, text)
        else:
            self._feedback = feedback

    def take_fault(self, error: Exception, *, is_of_write: bool = False) -> None:
        """Turn an exception of the driver into a fault: at once, or after a stop on the path.

        After a defect the servo can still brake, unless the exception *is_of_write*.
        """
        fault = fault_of(error)
        text = f"{type(error).__name__}: {error}" if fault is Fault.INTERNAL else str(error)
        brakes = not is_of_write
        if isinstance(error, DeviceError) and fault is not Fault.INTERNAL:
            brakes = error.brakes
        if brakes:
            self.setpoints.brake(fault, text)
        else:
            self._fail(fault, text)
        if isinstance(error, SpentLinkError):
            self.request_end(text)

    # Commands

    def _take_command(self) -> None:
        ring = self._memory.commands
        fields = ring.read(self._taken)
        if fields is None:
            # Still being written; or more stops than fit, while the driver was busy.
            if self._taken < (oldest := ring.oldest(self._taken)):
                self._pass_over(oldest)
            return
        if fields[1] in _LETTING_GO and self.setpoints.is_coming_to_rest:
            return  # until the next cycle, in which the device stands
        self._taken += 1
        index, code, motion, path_index, leave, final, start_ns, speed, *servo_limits = fields
        if index < ring.words[GIVEN_UP_WORD] and code not in _NEVER_TOO_LATE:
            return
        part = PathPart(motion, path_index, ServoLimits.from_floats(servo_limits), leave, final)
        try:
            text = self._obey(Command(code), part, speed, start_ns)
            answer = Answer.REFUSED if text else Answer.DONE
        except StateError as error:
            is_early = isinstance(error, NotYetError)
            answer, text = Answer.NOT_YET if is_early else Answer.WRONG_STATE, str(error)
        except Exception as error:  # noqa: BLE001 - a driver's defect must not end the servo
            answer, text = Answer.FAILED, str(error) or type(error).__name__
        self._memory.notes.publish(*pack_note(index, NoteKind.ANSWER, answer, text))

    def _pass_over(self, oldest: int) -> None:
        """Stop, and answer the commands before *oldest*, which newer ones have overwritten."""
        notes = self._memory.notes
        text = f"more than {self._memory.commands.capacity} commands waited; send it again"
        # The ring of notes keeps the latest of these answers, and the notes before them.
        for index in range(max(self._taken, oldest - notes.capacity // 2), oldest):
            notes.publish(*pack_note(index, NoteKind.ANSWER, Answer.FAILED, text))
        self._taken = oldest
        self.setpoints.stop()

    def _take_stops(self, stop_socket: StopSocket) -> None:
        """Stop if a client asks for it, and answer with the state that the stop met."""
        for request in stop_socket.requests():
            met = f"took {self.setpoints.state.name} {self.setpoints.motion}"
            self._memory.stops.publish(request.is_quickest, request.pid, request.uid, request.gid)
            self._stop(is_quickest=request.is_quickest)
            stop_socket.answer(request.sender, met)

    def _stop(self, *, is_quickest: bool = False) -> None:
        """Come to rest; during a fault have the driver check again that nothing moves."""
        if self.setpoints.state is ServoState.FAULT and self._is_enabled:
            self._rest_in_fault()
        if is_quickest:
            self.setpoints.halt()
        else:
            self.setpoints.stop()

    def _obey(self, command: Command, part: PathPart, speed: float, start_ns: int) -> str:
        """Execute one command; return why it was refused, or an empty string."""
        setpoints = self.setpoints
        if command is Command.STOP:
            self._stop()
        elif command is Command.SPEED:
            return setpoints.set_speed(speed)
        elif command is Command.START:
            return setpoints.start(part, speed, start_ns)
        elif command is Command.SPLICE:
            return setpoints.splice(part)
        elif command is Command.HALT:
            self._stop(is_quickest=True)
        elif command is Command.TRACK:
            setpoints.track(part, self._feedback.joints)
        elif command is Command.TUNE:
            return self._tune()
        elif command is Command.ENABLE:
            self._enable()
        elif command is Command.DISABLE:
            self._disable(command)
        elif command is Command.FREE:
            return self._free()
        elif command is Command.RESET:
            advance(setpoints.state, Command.RESET)
            if self._is_enabled:
                self._is_enabled = False
                self._driver.disable()
            if isinstance(self._driver, Resettable):
                self._driver.reset()
            setpoints.clear_fault()
            self.reports.publish_notices()
        elif command is Command.SHUTDOWN:
            self._is_orderly = True
            self.request_end("the daemon asked for it")
        return ""

    def _tune(self) -> str:
        """Give the driver the options of the next motions; return why it refuses them."""
        advance(self.setpoints.state, Command.TUNE)
        ring = self._memory.tunings
        fields = ring.read(ring.head - 1)
        if fields is None:
            return "the options did not arrive"
        _, length, text = fields
        try:
            tune(self._driver, json.loads(text[:length]))
        except ValueError as error:
            return str(error)
        return ""

    def _disable(self, command: Command) -> None:
        following = advance(self.setpoints.state, command)
        self._is_enabled = False
        self._driver.disable()
        self.setpoints.state = following

    def _free(self) -> str:
        """Let the device be moved by hand; return why that is impossible, or an empty string."""
        advance(self.setpoints.state, Command.FREE)
        driver = self._driver
        if not isinstance(driver, Freeable):
            return f"a device of the driver {driver.name!r} cannot be moved by hand"
        self._disable(Command.FREE)
        driver.free()
        return ""

    def _enable(self) -> None:
        following = advance(self.setpoints.state, Command.ENABLE)
        if self._is_enabled:
            return
        driver = self._driver
        feedback = driver.enable()
        try:
            problem = feedback_problem(feedback, self._clock.now_ns())
            if problem:
                raise DeviceFaultError(f"the driver's feedback is malformed: {problem}")
            mechanism = driver.mechanism(may_ask=False) if isinstance(driver, Mechanical) else None
            self.setpoints.anchor(feedback, mechanism)
        except Exception:
            driver.disable()
            raise
        self._feedback = feedback
        self._enabled_ns = self._clock.now_ns()
        self._is_enabled = True
        self.setpoints.state = following

    def _look_for_life(self, now_ns: int) -> None:
        if self._cycle_count % PARENT_CHECK == 0 and not self._parent_is_alive():
            self.request_end("the daemon is gone")
        watchdog, heartbeat_ns = self._watchdog, self._memory.pulse[0]
        measured_ns = self._feedback.time_ns
        if not watchdog.notice(now_ns, heartbeat_ns, measured_ns):
            return
        if now_ns < heartbeat_ns <= self._clock.now_ns():
            heartbeat_ns = now_ns  # this process was stalled since the cycle began
        setpoints = self.setpoints
        if setpoints.state in _DRIVEN:
            problem = watchdog.complain_of_daemon(heartbeat_ns, now_ns)
            if problem:
                setpoints.brake(Fault.HEARTBEAT_LOST, problem)
        if self._is_enabled and setpoints.fault is Fault.NONE:
            problem = watchdog.complain_of_device(max(measured_ns, self._enabled_ns), now_ns)
            if problem:
                setpoints.brake(Fault.FEEDBACK_STALE, problem + self._why_stale())

    def _why_stale(self) -> str:
        """Return the driver's reason for late feedback, as an addition to the fault's text."""
        try:
            reason = self._driver.why_stale() if isinstance(self._driver, Explaining) else ""
        except Exception as error:  # noqa: BLE001 - a driver's defect must not end the servo
            return f"; why_stale failed: {type(error).__name__}: {error}"
        return f"; {reason}" if reason else ""

    def _fail(self, fault: Fault, text: str) -> None:
        """Enter *fault* now; the servo writes nothing more to the device."""
        if self.setpoints.fail(fault, text) and self._is_enabled:
            self._is_enabled = False
            try:
                self._driver.disable()
            except Exception as error:  # noqa: BLE001 - the fault stays at any exception of disable
                self.setpoints.fault_text = f"{text}; disable failed: {error}"

    def _tell_fault(self, fault: Fault, text: str) -> None:
        self._memory.notes.publish(*pack_note(0, NoteKind.FAULT, fault, text))
        self.setpoints.fault_text += self._rest_in_fault()

    def _rest_in_fault(self) -> str:
        """Make the driver hold the device still; return an addition to the fault's text."""
        try:
            if self._resting:
                self._resting.rest_in_fault()
        except Exception as error:  # noqa: BLE001 - the fault stays at any exception of the driver
            return f"; rest_in_fault failed: {error}"
        return ""

    def _publish(
        self, deadline_ns: int, lateness_ns: int, point: PathPoint, *, is_written: bool
    ) -> None:
        measured, setpoints, ring = self._feedback, self.setpoints, self._memory.cycles
        follower = setpoints.follower
        flags = (_WRITTEN if is_written else 0) | (_FEEDBACK if measured is not _NO_FEEDBACK else 0)
        flags |= _FROM_REST if setpoints.is_from_rest else 0
        flags |= _ARRIVING if self._arrival.is_awaited else 0
        record = CYCLE_RECORD.pack(
            ring.next,
            deadline_ns,
            lateness_ns,
            self.work_ns,
            measured.time_ns,
            follower.index,
            setpoints.state,
            setpoints.fault,
            setpoints.motion,
            flags,
            self.overruns,
            self.missed,
            follower.fraction,
            setpoints.time_scaling.rate,
            *point.q,
            *point.omega_body,
            *point.alpha_body,
            *point.position,
            *measured.q,
            *measured.omega_body,
            *measured.position,
            *(measured.joints + NO_JOINTS)[:JOINTS],
            *((point.joints if is_written else ()) + NO_JOINTS)[:JOINTS],
            *(follower.q if follower.part.number == setpoints.motion else NO_Q),
        )
        ring.append(record)
        self._cycle_count += 1
        try:
            self.reports.publish_health(self._cycle_count)
        except Exception as error:  # noqa: BLE001 - a driver's defect must not end the servo
            self.take_fault(error)
