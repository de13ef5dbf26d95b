"""A Universal Robots arm, streamed to with ``servoL`` through the client library ``ur-rtde``.

See :mod:`orientd_ur.options` for the options and :mod:`orientd_ur.link` for what the library may
do to the process.  World coordinates are those of the robot's base; the tool is the active tool
centre point.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Mapping, Sequence
from math import dist, radians
from typing import Any, ClassVar

from orientd.clock import Clock
from orientd.driver import (
    IDENTITY,
    ZERO,
    AxisGap,
    ComingPose,
    Driver,
    Feedback,
    Finding,
    Joints,
    Quaternion,
    Setpoint,
    Vector3,
)
from orientd.errors import DeviceFaultError, FeedbackError, LinkError
from orientd.floats import difference, exp, norm, rotate_back
from orientd_ur import options as ur_options
from orientd_ur.arm import Arm
from orientd_ur.control_program import ControlProgram
from orientd_ur.deadline import arm, disarm
from orientd_ur.following import Following
from orientd_ur.inspection import advice, inspect, rate_problem
from orientd_ur.kinematics import JOINT_NAMES
from orientd_ur.link import Link, require_library
from orientd_ur.pose import continued
from orientd_ur.prediction import Prediction
from orientd_ur.probe import look
from orientd_ur.program_end import ProgramEnd
from orientd_ur.recovery import NO_DASHBOARD, Recovery
from orientd_ur.sockets import Address
from orientd_ur.states import RuntimeState, obstacle
from orientd_ur.ticks import ControllerClock, TickListener, TickPhase, WriteSilence, tick_ns

_RESOLVING = 5.0
_LOOKING = 0.5
_FIRST_PACKAGES = 1.0
# After this many looks the receiving thread has had its turn, however busy the machine.
_LOOKS_BEFORE_STALE = 3
_REASON_TIMEOUT = 0.02
# A setpoint takes some 30 us to send, and a tenth of a second when the library connects anew.
_SLOW_CALL_NS = 20_000_000
# The library can hang in any call, when it connects anew at the wrong moment.
_LONGEST_CYCLE = 0.9
_REACH = 1.0
"""m at which an angle of the tool is compared with a distance."""
_COMPARE_EVERY_NS = 1_000_000_000
# The packages that are listened to come every 40 ms.
_NEARLY_IN_TIME_NS = 60_000_000
_ENDS = {
    6: "the client library ended it, as it does for data that are no RTDE packages: see what the "
    "controller at {host} sends, or what else answers there",
    11: "the client library crashed, as it may when the controller at {host} closes a connection",
    14: "a call of the client library took more than 0.9 s; the robot's watchdog stops the arm",
}


_log = logging.getLogger(__name__)


class UrDriver(Driver):
    """One arm."""

    name: ClassVar[str] = "ur"
    default_rate_hz: ClassVar[float] = 500.0

    def __init__(self, options: Mapping[str, Any], *, period_ns: int, clock: Clock) -> None:
        super().__init__(options, period_ns=period_ns, clock=clock)
        self._options = ur_options.check(options, period=period_ns * 1e-9)
        self._tuned = self._options
        self._address = Address(self._options.host)
        self._prediction = Prediction(self._options, self._address)
        self._link = Link(self._options.host, self._options.registers)
        self._recovery = Recovery(self._link, self._options)
        self._program = ControlProgram(self._link, self._recovery, self._options)
        self._ending = ProgramEnd(self._link, self._recovery, self._options.stop_deceleration)
        self._advice: tuple[str, ...] = ()
        self._silence = WriteSilence(self._options.watchdog_hz)
        self._clock = ControllerClock()
        self._arm: Arm | None = None
        self._following: Following | None = None
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
        """Look at the robot with plain sockets: what it is, whether it will move, the link."""
        return inspect(self._options, self.period_ns)

    @property
    def speed_scaling(self) -> float:
        """The speed slider times what the controller's own limiter leaves, 0 to 1."""
        return self._speed_scaling

    @property
    def is_spent(self) -> bool:
        """Whether the link was lost: the library can then neither be used nor be destroyed."""
        return self._link.is_lost

    def tune(self, options: Mapping[str, Any]) -> None:
        """Take the lookahead, gain and servo time of the motions to come."""
        self._tuned = ur_options.tuned(self._options, options)

    def examine(
        self,
        times: Sequence[float],
        poses: Sequence[tuple[Quaternion, Vector3]],
        joints: tuple[float, ...] = (),
        *,
        is_offline: bool = False,
    ) -> None:
        """Refuse a path on which a joint would be too fast, or a singularity too near.

        Raises:
            PlanError: the time and the joint; or the robot does not say where it is.
        """
        self._prediction.examine(times, poses, joints, is_offline=is_offline)

    def offline_start(self, *, from_device: bool) -> Feedback:
        """Return where the arm stands: by the options, or as the robot says.

        Raises:
            LinkError: the robot does not answer.
            PlanError: the options do not say which arm it is.
        """
        return self._prediction.start(from_device=from_device)

    def outline(self, joints: tuple[float, ...]) -> Sequence[Sequence[Vector3]]:
        """Return the arm's links up to the flange; nothing until the controller said which arm."""
        return self._prediction.outline(joints) if len(joints) == len(JOINT_NAMES) else ()

    def why_stale(self) -> str:
        """Return whether the controller's packages came late, or were not taken in here."""
        if self._listener is None or (silent_ns := self._listener.silence_ns()) is None:
            return ""
        since = f"the newest package arrived {silent_ns * 1e-6:.0f} ms ago"
        if silent_ns < _NEARLY_IN_TIME_NS:
            return f"{since}, so this machine was too busy to take it in"
        return f"{since}, so the controller or the network is late"

    def why_ended(self, signal: int) -> str:
        """Return what the client library's ends are known to come from."""
        return _ENDS.get(signal, "").format(host=self._options.host)

    def open(self) -> None:
        """Look at the robot, then connect; the arm need not be running yet.

        Raises:
            LinkError: it does not answer, is held by another client, or has a version that the
                client library cannot drive; or there is no client library.
        """
        require_library()
        host, address = self._options.host, self._address.get(_RESOLVING)
        probe = look(address, timeout=_LOOKING)
        if probe.version_problem:
            raise LinkError(f"{host}: {probe.version_problem}")
        if problem := rate_problem(probe.version, self.period_ns):
            raise LinkError(f"{host} {problem}")
        self._advice = advice(probe.version, self._options)
        self._prediction.confirm(address)
        self._recovery.version = probe.version
        if not self._recovery.has_dashboard:
            _log.warning("%s: %s", host, NO_DASHBOARD)
        if self._options.keep_phase:
            self._listener = TickListener(address)
            self._phase = TickPhase(tick_ns(probe.version), self.period_ns)
        self._link.connect(address)
        self._await_package(LinkError(f"{host} sends no data packages"))

    def enable(self) -> Feedback:
        """Have the control program play and the tool, payload and watchdog be set.

        Raises:
            DeviceFaultError: the robot may not move, or is not in remote control.
            LinkError: the link is lost, or another client holds the robot.
        """
        self._arm, self._following = self._arm or self._prediction.confirm(self._link.address), None
        self._forget_age()
        self._program.play()
        self._clock.reset()
        self._await_package(FeedbackError(f"{self._options.host} sends no data packages"))
        # Where the controller commands the arm to be: what it measures differs by the arm's load.
        pose = self._link.target_pose()
        self._rotation = (pose[3], pose[4], pose[5])
        self._feedback = Feedback(
            self.clock.now_ns(),
            exp(self._rotation),
            position=(pose[0], pose[1], pose[2]),
            joints=tuple(self._link.motion()[2]),
        )
        self._sent = self._feedback.q, self._feedback.position
        self._is_enabled, self._is_muted, self._is_in_fault = True, False, False
        self._silence.begin(self.clock.now_ns())
        return self._feedback

    def free(self) -> None:
        """Switch the controller's freedrive on; the payload must be right, or the arm sinks.

        Raises:
            DeviceFaultError: as for :meth:`enable`.
            LinkError: as for :meth:`enable`.
        """
        self._forget_age()
        self._program.free()
        self._clock.reset()
        self._await_package(FeedbackError(f"{self._options.host} sends no data packages"))

    def read(self) -> Feedback | None:
        """Return what the controller measured last.

        Raises:
            LinkError: the connection is closed, or the controller's clock has stood still for the
                link's timeout.
            FeedbackError: the controller's clock has stood still for the feedback's timeout.
            DeviceFaultError: a stop, a fault, or the end of the control program.
        """
        armed = arm(_LONGEST_CYCLE)
        try:
            return self._read()
        finally:
            disarm(armed)

    def write(self, setpoint: Setpoint) -> None:
        """Send the pose of *setpoint* with ``servoL``; nothing more once feedback was missing.

        Raises:
            LinkError: the connection is closed.
            DeviceFaultError: the control program does not take it.
        """
        self._send(setpoint)
        measured = self._feedback
        if self._arm is None or measured is None:
            return
        if self._following is None:
            pose = measured.q, measured.position
            self._following = Following(self._arm, measured.joints, pose, self.period_ns * 1e-9)
        self._following.stream(setpoint.q, setpoint.position, measured.joints)

    def foresee(self, coming: Sequence[ComingPose]) -> str:
        """Return why the joints cannot follow what comes next, or an empty string."""
        if self._following is not None:
            return self._following.look(coming)
        return "which arm it is is not known" if self._options.check_joints else ""

    def follow(self, setpoint: Setpoint) -> tuple[Quaternion, Joints]:
        """Send the pose of a *setpoint* on the way to a target; errors are those of a write."""
        self._send(setpoint)
        if self._following is not None:
            self._following.took(setpoint.q, setpoint.position)
        return setpoint.q, ()

    def expect_targets(self) -> None:
        """Ask the robot for its arm and where it is; see :meth:`refusal`.

        Raises:
            PlanError: it does not say.
        """
        self._following = self._prediction.following(self.period_ns * 1e-9)

    def refusal(self, q: Quaternion, position: Vector3, joints: tuple[float, ...]) -> str:
        """Return why the arm cannot be at a target, or an empty string."""
        if self._following is None:
            return ""
        return self._following.refusal(q, position, joints)

    def _send(self, setpoint: Setpoint) -> None:
        armed = arm(_LONGEST_CYCLE)
        try:
            self._write(setpoint)
        finally:
            disarm(armed)

    def _read(self) -> Feedback | None:
        link, now_ns = self._link, self.clock.now_ns()
        link.require()
        timestamp = link.timestamp()
        if timestamp == self._timestamp:
            self._look_for_age(now_ns)
        else:
            self._timestamp, self._changed_ns, self._looks = timestamp, now_ns, 0
            self._feedback = self._measure(timestamp, now_ns)
        if now_ns - self._compared_ns > _COMPARE_EVERY_NS:
            self._compared_ns = now_ns
            link.require_same()
        if self._is_in_fault:
            # Nothing may feed the watchdog now, nor be left for a program that is played on.
            if link.has_control and not self._is_stale():
                self._ending.advance(now_ns)
        elif self._is_enabled:
            reason = self._reason(now_ns)
            if reason:
                # The library stops the program itself when it connects anew.
                link.require_same()
                raise DeviceFaultError(reason)
        elif link.has_control and now_ns - self._kicked_ns > 0.2e9 / self._options.watchdog_hz:
            # No setpoint keeps the watchdog quiet now, and the program is to go on.
            self._kicked_ns = now_ns
            if link.modes()[2] == RuntimeState.PLAYING:
                link.kick()
        return self._feedback

    def _write(self, setpoint: Setpoint) -> None:
        self._link.require()
        if self._is_muted or self._is_in_fault:
            return
        self._rotation = continued(setpoint.q, self._rotation)
        self._sent = setpoint.q, setpoint.position
        pose = [*setpoint.position, *self._rotation]
        chosen, begun_ns = self._tuned, self.clock.now_ns()
        is_taken = self._link.servo(pose, chosen.servo_time, chosen.lookahead, chosen.gain)
        self._silence.note(begun_ns)
        if self.clock.now_ns() - begun_ns > _SLOW_CALL_NS:
            self._link.require_same()
        if is_taken:
            return
        # The program's end is known here before the state that explains it has arrived.
        ends = time.monotonic() + _REASON_TIMEOUT
        while not (reason := self._reason(begun_ns)) and time.monotonic() < ends:
            self._link.require()
            time.sleep(0.001)
        self._link.require_same()
        raise DeviceFaultError(reason or "the control program takes no setpoints")

    def gaps(self) -> Sequence[AxisGap]:
        """Return how far the commanded tool is from the last setpoint, and each joint behind it."""
        allowed = radians(self._options.arrival_tolerance_deg)
        x, y, z, *rotation = self._link.target_pose()
        q, position = self._sent
        off = dist(position, (x, y, z)) / _REACH
        turned = norm(difference(q, exp((rotation[0], rotation[1], rotation[2]))))
        wanted, measured = self._link.joints()
        return [
            AxisGap("the tool that the controller commands", max(off, turned), allowed),
            *(
                AxisGap(f"joint {name}", a - b, allowed)
                for name, a, b in zip(JOINT_NAMES, wanted, measured, strict=True)
            ),
        ]

    @property
    def arrival_time(self) -> float:
        """As long as the controller smooths, and longer while it runs slowly; s."""
        return max(0.5, 5.0 * self._tuned.lookahead) / max(self._speed_scaling, 1e-3)

    def deadline_shift_ns(self, deadline_ns: int) -> int:
        """Keep the deadlines clear of the moment at which the controller takes setpoints."""
        listener = self._listener
        if listener is None:
            return 0
        if heard := listener.heard():
            self._phase.hear(*heard)
        return self._phase.shift_ns(deadline_ns)

    def disable(self) -> None:
        """Leave servo mode, the arm standing still, where there is still somebody to tell."""
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
        # That has fed the watchdog too; a kick now could meet a program that is just being stopped.
        self._kicked_ns = self.clock.now_ns()

    def rest_in_fault(self) -> None:
        """Take the stream back: the control program is ended in the cycles to come."""
        if not self._is_in_fault:
            self._is_in_fault = True
            self._ending.begin()

    def notices(self) -> Sequence[str]:
        """Return what the robot's software lacks, and what was done to it during a fault."""
        return (*self._advice, *self._ending.notices)

    def reset(self) -> None:
        """Unlock, power up if so configured, and play the control program again.

        Raises:
            DeviceFaultError: what is wrong needs a person: a button, a safeguard, the pendant.
            LinkError: the link is lost; a new process is needed.
        """
        self._link.require()
        self._link.require_same()
        self._clock.reset()
        self._await_package(LinkError(f"{self._options.host} sends no data packages"))
        self._ending.wait()
        self._recovery.clear()
        if self._link.has_control:
            self._link.play()
        self._is_in_fault = False
        self._ending.forget()
        self._forget_age()

    def close(self) -> None:
        """End the control program and disconnect; after a loss, do nothing at all."""
        self._is_enabled = False
        if not self._is_stale():
            self._link.disconnect()
        if self._listener is not None:
            self._listener.close()

    # Parts of reading

    def _reason(self, now_ns: int) -> str:
        """Return why the robot does not follow; its own watchdog where it heard too little."""
        reason = self._program.reason()
        if reason and self._link.modes()[2] == RuntimeState.STOPPED:
            return self._silence.reason(now_ns) or reason
        return reason

    def _measure(self, timestamp: float, now_ns: int) -> Feedback:
        pose, speed, joints, scaling = self._link.motion()
        self._speed_scaling = max(0.0, min(1.0, scaling))
        q = exp((pose[3], pose[4], pose[5]))
        return Feedback(
            self._clock.measured_ns(timestamp, now_ns),
            q,
            rotate_back(q, (speed[3], speed[4], speed[5])),
            (pose[0], pose[1], pose[2]),
            tuple(joints),
        )

    def _look_for_age(self, now_ns: int) -> None:
        self._looks += 1
        age = (now_ns - self._changed_ns) * 1e-9
        if self._looks < _LOOKS_BEFORE_STALE or self._timestamp < 0.0:
            return
        host, chosen = self._options.host, self._options
        if age > chosen.link_timeout:
            self._link.is_lost = True
            raise LinkError(f"the controller's clock at {host} has stood still for {age:.3f} s")
        if age > chosen.feedback_timeout:
            # What is sent from now on would pile up, and reach the arm as one jump.
            self._is_muted = True
            raise FeedbackError(f"no feedback from {host} for {age:.3f} s{self._late_words()}")

    def _late_words(self) -> str:
        reason = self.why_stale()
        return f"; {reason}" if reason else ""

    def _is_stale(self) -> bool:
        """Whether the controller may be frozen, so that waiting for it could last for ever."""
        if self._timestamp < 0.0 or self._link.problem():
            return False
        if self._link.timestamp() != self._timestamp:
            return False
        return (self.clock.now_ns() - self._changed_ns) * 1e-9 > self._options.feedback_timeout

    def _await_package(self, error: LinkError | FeedbackError) -> None:
        """Wait until the controller's clock has moved twice, then take that as the newest."""
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

    def _forget_age(self) -> None:
        """Count the age of feedback from now: nobody has looked for as long as a call took."""
        self._timestamp, self._changed_ns, self._looks = -1.0, self.clock.now_ns(), 0
