"""A Universal Robots arm, driven with ``servoL`` through the client library ``ur-rtde``.

:mod:`orientd_ur.options` has the options.  :mod:`orientd_ur.link` describes how the library can
harm the process.  World coordinates are those of the robot's base; the tool is the active tool
centre point.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from math import degrees, dist, radians
from operator import sub
from typing import Any, ClassVar

from orientd.clock import Clock
from orientd.driver import (
    IDENTITY,
    ZERO,
    AxisGap,
    Driver,
    Feedback,
    Finding,
    FollowCheck,
    PartHealth,
    Quaternion,
    Setpoint,
    Vector3,
)
from orientd.errors import (
    AxisFaultError,
    DeviceFaultError,
    FeedbackError,
    LinkError,
    SpentLinkError,
)
from orientd.floats import difference, norm, rotate_back
from orientd.mechanism.mechanism import Mechanism
from orientd_ur import options as ur_options
from orientd_ur.arm import JOINT_NAMES, Arm
from orientd_ur.controller import (
    NO_DASHBOARD,
    RuntimeState,
    obstacle,
    rate_problem,
    tick_ns,
    version_problem,
)
from orientd_ur.doctor import inspect
from orientd_ur.link import Link, alarm_after, require_library
from orientd_ur.pose import continued, pose_of
from orientd_ur.probe import look
from orientd_ur.program import ControlProgram
from orientd_ur.robot import Robot
from orientd_ur.timing import ControllerClock, TickListener, TickPhase, WriteSilence

_LOOKING = 0.5
_FIRST_PACKAGES = 1.0
_COMING_TO_REST = 2.0
_STANDS = 1e-4
# After this many polls the receiving thread has run, however busy the machine is.
_LOOKS_BEFORE_STALE = 3
_REASON_TIMEOUT = 0.02
# Sending a setpoint takes some 30 us, and a tenth of a second when the library reconnects.
_SLOW_CALL_NS = 20_000_000
# The library can hang in any call if it reconnects at the wrong moment.
_LONGEST_CYCLE = 0.9
_FOLLOW_TIME = 0.1
_REACH = 1.0
"""Lever arm, m, that converts an angle of the tool to a distance."""
_COMPARE_EVERY_NS = 1_000_000_000
# The received packages come every 40 ms.
_NEARLY_IN_TIME_NS = 60_000_000
_ENDS = {
    6: "the client library ended it, as it does for data that are no RTDE packages: see what the "
    "controller at {host} sends, or what else answers there",
    11: "the client library crashed, as it may when the controller at {host} closes a connection",
    14: "a call of the client library took more than 0.9 s; the robot's watchdog stops the arm",
}


class UrDriver(Driver):
    """One arm."""

    name: ClassVar[str] = "ur"
    default_rate_hz: ClassVar[float] = 500.0
    longest_call = _LONGEST_CYCLE

    def __init__(self, options: Mapping[str, Any], *, period_ns: int, clock: Clock) -> None:
        super().__init__(options, period_ns=period_ns, clock=clock)
        self._options = ur_options.check(options, period=period_ns * 1e-9)
        self._tuned = self._options
        self._robot = Robot(self._options)
        self._link = Link(self._options.host, self._options.registers)
        self._program = ControlProgram(self._link, self._options)
        self._silence = WriteSilence(self._options.watchdog_hz)
        self._clock = ControllerClock()
        self._notices: tuple[str, ...] = ()
        self._follow: tuple[FollowCheck, ...] = ()
        self._commanded: Sequence[float] = ()
        self._arm: Arm | None = None
        self._is_enabled = self._is_in_fault = False
        self._timestamp = -1.0
        self._changed_ns = 0
        self._looks = 0
        self._is_muted = False
        self._kicked_ns = 0
        self._compared_ns = 0
        self._rotation: Vector3 = (0.0, 0.0, 0.0)
        self._sent: tuple[Quaternion, Vector3] = (IDENTITY, ZERO)
        self._feedback: Feedback | None = None
        self._speed_scaling = 1.0
        self._listener: TickListener | None = None
        self._phase = TickPhase(tick_ns((5,)), period_ns)

    def diagnose(self) -> Sequence[Finding]:
        """Inspect the robot with plain sockets: model, readiness and link."""
        return inspect(self._options, self.period_ns)

    @property
    def speed_scaling(self) -> float:
        """The speed slider times the share that the controller's own limiter leaves, 0 to 1."""
        return self._speed_scaling

    def tune(self, options: Mapping[str, Any]) -> None:
        """Set the lookahead, gain and servo time of the next motions."""
        self._tuned = ur_options.tuned(self._options, options)

    def mechanism(self, *, may_ask: bool) -> Mechanism | None:
        """Return the arm; ``None`` if its joints are not checked.

        Raises:
            LinkError: the robot does not answer, or does not report its arm.
            PlanError: the options do not name the arm.
        """
        if not self._options.check_joints:
            return None
        if self._is_enabled:
            return self._arm
        return self._robot.look()[0] if may_ask else self._robot.named()

    def offline_start(self, *, from_device: bool) -> Feedback:
        """Return the pose of the arm: from the options, or from the robot.

        Raises:
            LinkError: the robot does not answer.
            PlanError: the options do not name the arm.
        """
        if from_device:
            _, place = self._robot.look()
            return Feedback(0, place.pose[0], position=place.pose[1], joints=place.joints)
        joints = self._options.start_joints
        q, position = self._robot.named().forward(joints)
        return Feedback(0, q, position=position, joints=joints)

    def why_stale(self) -> str:
        """Return whether the controller's packages came late, or were received late here."""
        if self._listener is None or (silent_ns := self._listener.silence_ns()) is None:
            return ""
        since = f"the newest package arrived {silent_ns * 1e-6:.0f} ms ago"
        if silent_ns < _NEARLY_IN_TIME_NS:
            return f"{since}, so this machine was too busy to take it in"
        return f"{since}, so the controller or the network is late"

    def why_ended(self, signal: int) -> str:
        """Return the known causes of a crash of the client library."""
        return _ENDS.get(signal, "").format(host=self._options.host)

    def open(self) -> None:
        """Inspect the robot, then connect; the arm need not be running yet.

        Raises:
            LinkError: the robot does not answer, another client holds it, or the client library
                cannot drive its version or is not installed.
        """
        require_library()
        host, address = self._options.host, self._robot.address
        probe = look(address, timeout=_LOOKING)
        if problem := version_problem(probe.version):
            raise LinkError(f"{host}: {problem}")
        if problem := rate_problem(probe.version, self.period_ns):
            raise LinkError(f"{host} {problem}")
        self._arm = self._identified()
        self._program.version = probe.version
        self._notices = () if self._program.has_dashboard else (NO_DASHBOARD,)
        if self._options.keep_phase:
            self._listener = TickListener(address)
            self._phase = TickPhase(tick_ns(probe.version), self.period_ns)
        self._link.connect(address)
        self._awaited(SpentLinkError(f"{host} sends no data packages"))

    def enable(self) -> Feedback:
        """Make the control program play, and set the tool, payload and watchdog.

        Raises:
            DeviceFaultError: the robot may not move, is not in remote control, or commands
                another pose than it measures.
            LinkError: the link is lost, or another client holds the robot.
        """
        self._arm = self._arm or self._identified()
        self._program.play()
        self._clock.reset()
        measured = self._standing()
        now_ns = self.clock.now_ns()
        # The commanded pose: the measured one differs by the load of the arm.
        joints, numbers = self._link.commanded()
        self._require_agreement(joints, measured.joints)
        q, position = self._sent = pose_of(numbers)
        self._rotation = (numbers[3], numbers[4], numbers[5])
        start = Feedback(now_ns, q, position=position, joints=measured.joints)
        self._feedback = start
        if self._arm is not None:
            self._arm = self._arm.seen(joints, (q, position))
        self._is_enabled, self._is_muted, self._is_in_fault = True, False, False
        tolerance = radians(self._options.follow_tolerance_deg)
        self._follow = tuple(
            FollowCheck(f"joint {name}", tolerance=tolerance, duration=_FOLLOW_TIME)
            for name in JOINT_NAMES
        )
        self._silence.begin(now_ns)
        return start

    def free(self) -> None:
        """Switch on the controller's freedrive; the payload must be right, or the arm sinks.

        Raises:
            DeviceFaultError: as for :meth:`enable`.
            LinkError: as for :meth:`enable`.
        """
        self._program.free()
        self._clock.reset()
        self._awaited(FeedbackError(f"{self._options.host} sends no data packages"))

    def read(self) -> Feedback | None:
        """Return the controller's last measurement.

        Raises:
            LinkError: the connection is closed, or the controller's clock stood still for the
                link's timeout.
            FeedbackError: the controller's clock stood still for the feedback's timeout.
            DeviceFaultError: a stop, a fault, or the end of the control program.
            AxisFaultError: a joint does not follow the controller's command.
        """
        link, now_ns = self._link, self.clock.now_ns()
        with alarm_after(_LONGEST_CYCLE):
            link.require()
            timestamp = link.timestamp()
            is_new = timestamp != self._timestamp
            if is_new:
                self._timestamp, self._changed_ns, self._looks = timestamp, now_ns, 0
                self._feedback = self._measure(timestamp, now_ns)
            else:
                self._look_for_age(now_ns)
            if now_ns - self._compared_ns > _COMPARE_EVERY_NS:
                self._compared_ns = now_ns
                link.require_same()
            if self._is_in_fault:
                # From now on nothing may feed the watchdog, or remain for a program that is played
                # again.
                if link.has_control and not self._is_stale() and self._stands(now_ns):
                    self._program.end(now_ns)
            elif self._is_enabled:
                if reason := self._reason(now_ns):
                    # The library stops the program itself when it reconnects.
                    link.require_same()
                    raise DeviceFaultError(reason)
                if is_new:
                    self._require_following()
            elif (
                is_new
                and link.has_control
                and now_ns - self._kicked_ns > 0.2e9 / self._options.watchdog_hz
            ):
                # Without setpoints, something must feed the watchdog so that the program continues.
                # The library does not return if the controller is frozen.
                self._kicked_ns = now_ns
                if link.modes()[2] == RuntimeState.PLAYING:
                    link.tell("kickWatchdog")
        return self._feedback

    def write(self, setpoint: Setpoint) -> None:
        """Send the pose of *setpoint* with ``servoL``; stop sending once feedback was missing.

        Raises:
            LinkError: the connection is closed.
            DeviceFaultError: the control program does not accept it.
        """
        link, chosen, begun_ns = self._link, self._tuned, self.clock.now_ns()
        with alarm_after(_LONGEST_CYCLE):
            link.require()
            if self._is_muted or self._is_in_fault:
                return
            self._rotation = continued(setpoint.q, self._rotation)
            self._sent = setpoint.q, setpoint.position
            pose = [*setpoint.position, *self._rotation]
            rest = 0.0, 0.0, chosen.servo_time, chosen.lookahead, chosen.gain
            is_taken = link.tell("servoL", pose, *rest)
            self._silence.note(begun_ns)
            if self.clock.now_ns() - begun_ns > _SLOW_CALL_NS:
                link.require_same()
            if is_taken:
                return
            # The program's end is known here before the state that explains it arrives.
            ends = time.monotonic() + _REASON_TIMEOUT
            while not (reason := self._reason(begun_ns)) and time.monotonic() < ends:
                link.require()
                time.sleep(0.001)
            link.require_same()
            raise DeviceFaultError(reason or "the control program takes no setpoints")

    def gaps(self) -> Sequence[AxisGap]:
        """Return the distance of the commanded tool from the last setpoint, and the joints' lag."""
        allowed = radians(self._options.arrival_tolerance_deg)
        wanted, numbers = self._link.commanded()
        commanded, at = pose_of(numbers)
        q, position = self._sent
        off, turned = dist(position, at) / _REACH, norm(difference(q, commanded))
        measured = self._feedback.joints if self._feedback is not None else wanted
        # As long as the controller smooths, and longer if it runs slowly.
        patience = max(0.5, 5.0 * self._tuned.lookahead) / max(self._speed_scaling, 1e-3)
        tool = "the tool that the controller commands"
        return [
            AxisGap(tool, max(off, turned), allowed, patience=patience),
            *(
                AxisGap(f"joint {name}", a - b, allowed, patience=patience)
                for name, a, b in zip(JOINT_NAMES, wanted, measured, strict=True)
            ),
        ]

    def deadline_shift_ns(self, deadline_ns: int) -> int:
        """Keep the deadlines away from the moment at which the controller takes setpoints."""
        listener = self._listener
        if listener is None:
            return 0
        if heard := listener.heard():
            self._phase.hear(*heard)
        return self._phase.shift_ns(deadline_ns)

    def disable(self) -> None:
        """Leave servo mode with the arm standing still, if the robot can still be reached."""
        was_enabled, self._is_enabled = self._is_enabled, False
        link = self._link
        is_to_stop = was_enabled or self._program.is_free
        if not is_to_stop or not link.has_control or link.problem() or self._is_stale():
            return
        robot_mode, safety_mode, runtime_state = link.modes()
        if obstacle(robot_mode, safety_mode) or runtime_state != RuntimeState.PLAYING:
            return
        self._program.hold()
        link.order("servoStop", self._options.stop_deceleration, limit=_LONGEST_CYCLE)
        # That has fed the watchdog too; another message could meet a program that is just stopping.
        self._kicked_ns = self.clock.now_ns()

    def rest_in_fault(self) -> None:
        """Withdraw from the stream: the next cycles end the control program."""
        if not self._is_in_fault:
            self._is_in_fault = True
            self._program.give_up()

    def health(self) -> Sequence[PartHealth]:
        """Do nothing: the controller watches its joints itself."""
        return ()

    def notices(self) -> Sequence[str]:
        """Return which features the robot's software lacks, and actions on it during a fault."""
        return (*self._notices, *self._program.notices)

    def reset(self) -> None:
        """Unlock, power up if so configured, and play the control program again.

        Raises:
            DeviceFaultError: a person must act: a button, a safeguard, the pendant.
            LinkError: the link is lost; a new process is needed.
        """
        self._link.require()
        self._link.require_same()
        self._clock.reset()
        self._awaited(SpentLinkError(f"{self._options.host} sends no data packages"))
        self._program.clear()
        self._is_in_fault = False

    def close(self) -> None:
        """End the control program and disconnect; after a loss, do nothing at all."""
        self._is_enabled = False
        if not self._is_stale():
            self._link.disconnect()
        if self._listener is not None:
            self._listener.close()

    def _identified(self) -> Arm | None:
        """Return the arm; ``None`` if it is not checked, or unknown.

        Raises:
            LinkError: it differs from the model in the options.
        """
        if not self._options.check_joints:
            return None
        try:
            return self._robot.identify()
        except LinkError:
            if self._options.model is not None:
                raise
            return None

    def _standing(self) -> Feedback:
        """Wait until the controller commands the arm to stand; return the measurement then.

        Raises:
            DeviceFaultError: the arm does not come to rest.
            FeedbackError: the controller sends no data packages.
        """
        error = FeedbackError(f"{self._options.host} sends no data packages")
        ends = time.monotonic() + _COMING_TO_REST
        joints: tuple[float, ...] = ()
        while True:
            measured, before = self._awaited(error), joints
            self._link.tell("kickWatchdog")
            joints, _ = self._link.commanded()
            if before and max(map(abs, map(sub, before, joints))) < _STANDS:
                return measured
            if time.monotonic() > ends:
                raise DeviceFaultError(f"the arm of {self._options.host} does not come to rest")

    def _require_agreement(self, commanded: Sequence[float], measured: Sequence[float]) -> None:
        """Do nothing if the arm is where the controller commands it to be.

        Raises:
            DeviceFaultError: it is not: the first setpoint would move it there.
        """
        for name, wanted, at in zip(JOINT_NAMES, commanded, measured, strict=True):
            off = degrees(abs(wanted - at))
            if off > self._options.arrival_tolerance_deg:
                raise DeviceFaultError(
                    f"joint {name} is {off:.1f} deg from where {self._options.host} commands it to "
                    "be, so enabling would move the arm; find the obstacle or the load, then reset"
                )

    def _require_following(self) -> None:
        """Do nothing if every joint is where the controller commands it to be, or was until now.

        Raises:
            AxisFaultError: a joint is not; raised once, so that the stop has feedback.
        """
        measured = self._feedback
        if not self._follow or measured is None:
            return
        found = zip(self._follow, self._commanded, measured.joints, strict=True)
        problems = [one.problem(wanted - at, measured.time_ns) for one, wanted, at in found]
        if any(problems):
            self._follow = ()
            raise AxisFaultError("; ".join(filter(None, problems)))

    def _stands(self, now_ns: int) -> bool:
        """Return whether the arm is commanded to be where it is, as far as that is possible."""
        if not self._is_enabled or self._is_muted or self._feedback is None:
            return True
        return self._program.stands(self._feedback.joints, self._tuned, now_ns)

    def _reason(self, now_ns: int) -> str:
        """Return why the robot does not follow; its watchdog if it received too little."""
        reason = self._program.reason()
        if reason and self._link.modes()[2] == RuntimeState.STOPPED:
            return self._silence.reason(now_ns) or reason
        return reason

    def _measure(self, timestamp: float, now_ns: int) -> Feedback:
        pose, speed, joints, self._commanded, scaling = self._link.motion()
        self._speed_scaling = max(0.0, min(1.0, scaling))
        q, position = pose_of(pose)
        omega = rotate_back(q, (speed[3], speed[4], speed[5]))
        measured_ns = self._clock.measured_ns(timestamp, now_ns)
        return Feedback(measured_ns, q, omega, position, tuple(joints))

    def _look_for_age(self, now_ns: int) -> None:
        self._looks += 1
        age = (now_ns - self._changed_ns) * 1e-9
        if self._looks < _LOOKS_BEFORE_STALE or self._timestamp < 0.0:
            return
        host, chosen = self._options.host, self._options
        if age > chosen.link_timeout:
            self._link.is_lost = True
            raise SpentLinkError(
                f"the controller's clock at {host} has stood still for {age:.3f} s"
            )
        if age > chosen.feedback_timeout:
            # Further setpoints would pile up, and reach the arm as one jump.
            self._is_muted = True
            reason = self.why_stale()
            late = f"; {reason}" if reason else ""
            raise FeedbackError(f"no feedback from {host} for {age:.3f} s{late}")

    def _is_stale(self) -> bool:
        """Whether the controller may be frozen, so that waiting for it could last for ever."""
        if self._timestamp < 0.0 or self._link.problem():
            return False
        if self._link.timestamp() != self._timestamp:
            return False
        return (self.clock.now_ns() - self._changed_ns) * 1e-9 > self._options.feedback_timeout

    def _awaited(self, error: LinkError | FeedbackError) -> Feedback:
        """Wait until the controller's clock has advanced twice; return its measurement then."""
        ends = time.monotonic() + _FIRST_PACKAGES
        before = self._link.timestamp()
        for _ in range(2):
            while (timestamp := self._link.timestamp()) == before:
                self._link.require()
                if time.monotonic() > ends:
                    self._link.is_lost = isinstance(error, LinkError)
                    raise error
                time.sleep(0.0005)
            before = timestamp
        now_ns = self.clock.now_ns()
        self._timestamp, self._changed_ns, self._looks = before, now_ns, 0
        self._feedback = self._measure(before, now_ns)
        return self._feedback
