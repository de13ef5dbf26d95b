"""The setpoint generator: it has the servo's state and makes the next setpoint.

It streams a path and follows targets.  It stops on the path or, if that is impossible, off it.
:mod:`orientd.servo.servo` reads the device, writes to it and talks to the daemon.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from math import dist

from orientd.driver import IDENTITY, ZERO, Driver, Feedback, Joints, Quaternion, Scaled, Vector3
from orientd.errors import DeviceFaultError, Fault, NotYetError
from orientd.floats import combine, difference, norm
from orientd.mechanism.chain import chain_of
from orientd.mechanism.following import Following
from orientd.mechanism.mechanism import Mechanism
from orientd.servo.guard import Guard
from orientd.servo.keep_out_cones import KeepOutCones
from orientd.servo.path.path_follower import (
    KeepOutAhead,
    PathFollower,
    PathPart,
    StarvedError,
    joint_gap,
)
from orientd.servo.path.quick_stop import QuickStop
from orientd.servo.path.segment import PathPoint
from orientd.servo.path.time_scaling import TimeScaling
from orientd.servo.state_table import Event, advance
from orientd.servo.tracking.law import NO_LIMITS, Law
from orientd.servo.tracking.target_follower import TargetFollower
from orientd.servo.watchdog import longest_gap_ns
from orientd.stream.memory import SharedMemory
from orientd.stream.records import UNKNOWN, Command, ServoLimits, ServoState

# Attribute access on an enumeration takes longer than a comparison.
_STREAMING, _STOPPING, _TRACKING = ServoState.STREAMING, ServoState.STOPPING, ServoState.TRACKING
_MOVING = (_STREAMING, _STOPPING, _TRACKING)
_NO_FAULT = Fault.NONE

_START_TOLERANCE = 1e-9
_POSITION_TOLERANCE = 1e-6  # m; the daemon's for a plan that was made earlier
_STILL = 1e-6  # rad/s
_BY_POSES = 0.99
"""Share of the axes' acceleration that a quick stop uses if the device takes poses.

Between two records the joints of the poses differ a little from those of the path.
"""

_GIMBAL_AXES = 3
"""Most axes that only turn a tool; they follow poses by themselves, also past their pole."""

_AXES_RESERVE = 4e-4
"""Angle outside of a cone that a stop of such axes keeps, rad: less than that of the poses."""

_JOINT_TOLERANCE = 1e-8
"""Tolerance of an axis' angle, rad: near a pole rounding is larger than elsewhere."""


class SetpointGenerator:
    """State, path and limits, and the next setpoint.

    Attributes:
        state: of the servo.
        fault: reason of the fault state, or of the stop before it.
        fault_text: the same in words.
        motion: number of the motion of the setpoints; 0 before the first.
        last: the last setpoint.
        time_scaling: speed along the path.
        follower: position of the setpoint on the path.
        is_from_rest: whether motion resumes from rest in this cycle, after a stall.
        pursuit: the followed targets, or a stop off the path, which has none.
        cones: keep-out cones of the device; ``None`` if it has none.
    """

    def __init__(
        self,
        driver: Driver,
        memory: SharedMemory,
        *,
        period_ns: int,
        stall_ns: int,
        on_fault: Callable[[Fault, str], None],
        cones: KeepOutCones | None = None,
    ) -> None:
        """Create it holding still; after *stall_ns* without a cycle no motion resumes by itself."""
        period = period_ns * 1e-9
        self.state = ServoState.IDLE
        self.fault = Fault.NONE
        self.fault_text = ""
        self.motion = 0
        self.last = PathPoint(IDENTITY, ZERO, ZERO, ZERO, ZERO)
        self.is_from_rest = False
        self.time_scaling = TimeScaling(period)
        self.follower = PathFollower(memory.path, period, NO_LIMITS)
        self.cones = cones
        self._cones_ahead = None if cones is None else KeepOutAhead(cones, self.follower, period)
        self._guard = Guard(period, cones)
        self._quick_stop = QuickStop(self.time_scaling, self.follower, self._guard)
        self.pursuit = TargetFollower(memory.targets, memory.chunks, self._guard, cones)
        self._takes_joints = driver.takes == "joints"
        self._mechanism: Mechanism | None = None
        self._following: Following | None = None
        self._scaled = driver if isinstance(driver, Scaled) else None
        self._on_fault = on_fault
        self._period_ns, self._stall_ns = period_ns, stall_ns
        self._gap_ns = longest_gap_ns(period_ns)
        self._servo_limits = NO_LIMITS
        self._speed = 0.0
        self._start_ns = UNKNOWN
        self._is_waiting = self._is_off_path = False
        self._moved_ns, self._sent = 0, IDENTITY

    @property
    def is_moving(self) -> bool:
        """Whether setpoints change."""
        return self.state in _MOVING

    @property
    def is_coming_to_rest(self) -> bool:
        """Whether the last setpoint ended a motion, and still differs from the one before."""
        guard = self._guard
        has_stood = guard.omega == guard.velocity == ZERO and not any(guard.joint_rates)
        return not (self.is_moving or has_stood)

    def step(self, deadline_ns: int, now_ns: int) -> PathPoint:
        """Return the setpoint of the cycle with deadline *deadline_ns* that runs at *now_ns*."""
        if self.cones is not None:
            self.cones.tick()
        gap_ns, self._moved_ns = now_ns - self._moved_ns, now_ns
        self.is_from_rest = gap_ns > self._gap_ns and self.state in _MOVING
        if self.is_from_rest:
            self._go_on_from_rest(gap_ns)
        if self.state not in _MOVING:
            self.last = self._hold()
        elif self.pursuit.is_on:
            self.last = self._follow(deadline_ns)
        else:
            self.last = self._move(deadline_ns)
        return self.last

    def _hold(self) -> PathPoint:
        """Return the last setpoint once more, at rest."""
        self._guard.hold()
        last = self.last
        return PathPoint(last.q, ZERO, ZERO, last.position, ZERO, last.joints)

    def anchor(self, feedback: Feedback, mechanism: Mechanism | None = None) -> None:
        """Begin at rest at the device's pose in *feedback*; its axes are those of *mechanism*.

        Raises:
            DeviceFaultError: the driver takes joints, but reports none.
        """
        q, position, period = feedback.q, feedback.position, self._period_ns * 1e-9
        if self._takes_joints and (mechanism is None or not feedback.joints):
            raise DeviceFaultError("the driver takes joints, but does not say which and where")
        self._mechanism = mechanism
        axes = mechanism.axes if mechanism is not None else ()
        self._guard.know(axes)
        self._quick_stop.know(axes, share=1.0 if self._takes_joints else _BY_POSES)
        self.pursuit.joint_tracker = self._following = None
        if mechanism is not None:
            chain = chain_of(mechanism)
            if self._takes_joints:
                self._following = Following(mechanism, period, chain)
            if chain is not None and not (self._takes_joints and len(axes) <= _GIMBAL_AXES):
                self.pursuit.make_joint_tracker(mechanism, chain, takes_joints=self._takes_joints)
        joints = feedback.joints if self._takes_joints else ()
        self.last = PathPoint(q, ZERO, ZERO, position, ZERO, joints)
        self._guard.anchor(q, position, joints)
        self.time_scaling.halt()

    # What the daemon asks for

    def set_speed(self, speed: float) -> str:
        """Follow the path at *speed*, 1 is as planned; return a refusal, or an empty string."""
        following = advance(self.state, Command.SPEED)
        if not 0.0 <= speed <= 1.0:
            return f"speed must be between 0 and 1, got {speed!r}"
        self._speed = speed
        self.state = following
        return ""

    def halt(self) -> None:
        """Come to rest as fast as the limits allow, on or off the path.

        Near a keep-out cone it stays on the path.
        """
        self.stop()
        if self.is_moving and not self.pursuit.is_on:
            self._pursue(self._servo_limits, is_off_path=True)
            if not self._may_leave_path():
                # The path is certified to stay outside of the cones.
                self.pursuit.end()

    def _may_leave_path(self) -> bool:
        """Return whether a stop off the path ends outside of the keep-out cones."""
        following, guard = self._following, self._guard
        if not self.pursuit.tracker.is_clear:
            return False
        if following is None or not guard.joint_rates:
            return True
        return self._brakes_outside(following.braked(guard.joints, guard.joint_rates))

    def _brakes_outside(self, joints: Joints) -> bool:
        """Return whether axes that go to *joints*, and brake there, stay outside of the cones."""
        if self._following is None or self.cones is None:
            return True
        clearance = min(self.cones.clearances(self._sent))
        cones = self.cones.rows(self._sent, _AXES_RESERVE)
        return self._following.brakes_outside(joints, self._guard.joints, clearance, cones)

    def clear_fault(self) -> None:
        """Leave the fault state."""
        self.state = advance(self.state, Command.RESET)
        self.fault, self.fault_text = Fault.NONE, ""

    def start(self, part: PathPart, speed: float, start_ns: int) -> str:
        """Stream the path of *part* from *start_ns* on; return a refusal, or an empty string."""
        following = advance(self.state, Command.START)
        first = self.follower.peek(part.first)
        if first is None:
            return f"path record {part.first} is not in the ring"
        gap = norm(difference(self.last.q, first.q))
        if not gap <= _START_TOLERANCE:
            return f"the path begins {gap:.3g} rad from the commanded orientation"
        gap = dist(self.last.position, first.position)
        if not gap <= _POSITION_TOLERANCE:
            return f"the path begins {gap:.3g} m from the commanded position"
        if self._takes_joints:
            gap = joint_gap(self.last.joints, first.joints)
            if not gap <= _JOINT_TOLERANCE:
                return f"the path begins {gap:.3g} rad from the commanded angles of the axes"
        brake_rate = part.servo_limits.brake_rate
        if not (brake_rate > 0.0 and 0.0 <= speed <= 1.0):
            return f"brake rate and speed must be positive, got {brake_rate!r} and {speed!r}"
        self._speed = speed
        self._start_ns, self._is_waiting = start_ns, True
        self.time_scaling.begin(brake_rate, 0.0)
        self.follower.begin(part)
        self._adopt(part)
        self.state = following
        return ""

    def splice(self, part: PathPart) -> str:
        """Replace the rest of the path, or follow at its end; return why it is refused."""
        following = advance(self.state, Command.SPLICE)
        scaling, brake_rate = self.time_scaling, part.servo_limits.brake_rate
        if not brake_rate > 0.0:
            return f"brake rate must be positive, got {brake_rate!r}"
        if scaling.plan or (not scaling.is_steady and brake_rate < scaling.brake_rate):
            raise NotYetError("the speed is changing")
        problem = self.follower.splice(part)
        if not problem:
            if self._is_waiting and part.leave == self.follower.index:
                # It replaces all of a motion that waits for its start time.
                self._start_ns = UNKNOWN
            self._brake_as_promised()
            self.state = following
        return problem

    def track(self, part: PathPart, joints: Joints) -> None:
        """Follow targets from here on, whatever moves at present; the axes are near *joints*.

        Raises:
            NotYetError: the axes have no stop from here that keeps every limit.
        """
        following = advance(self.state, Command.TRACK)
        servo_limits, guard = part.servo_limits, self._guard
        if self.pursuit.joint_tracker is None:
            # If a narrower limit is already broken, reduce the excess.
            linear = Law(guard.period)
            linear.limit_position(servo_limits)
            speed = linear.loosened(guard.velocity, guard.acceleration)
            servo_limits = replace(servo_limits, linear_velocity=speed)
        elif not joints:
            raise NotYetError("the device does not say where its axes are")
        self._pursue(servo_limits, joints, is_off_path=False)
        self.time_scaling.halt()
        self.motion = part.number
        self.state = following

    def _pursue(self, servo_limits: ServoLimits, joints: Joints = (), *, is_off_path: bool) -> None:
        """Continue from the written setpoints without a path: after targets, or to stop."""
        self.pursuit.limits = self._servo_limits
        self.pursuit.begin(servo_limits, joints)
        self._servo_limits, self._is_off_path = servo_limits, is_off_path
        self._sent = self.last.q
        if self._following is not None:
            self._following.begin()

    def stop(self) -> None:
        """Begin to come to rest, on the path or away from the target."""
        following = advance(self.state, Command.STOP)
        self.time_scaling.target = 0.0
        self.pursuit.cease()
        self.state = following

    def brake(self, fault: Fault, text: str) -> None:
        """Stop on the path, then enter *fault*; the first reason counts."""
        if self.fault is not _NO_FAULT:
            return
        if self.is_moving:
            self.fault, self.fault_text = fault, text
            self.stop()
        else:
            self.fail(fault, text)

    def leave_path(self, fault: Fault, text: str) -> PathPoint:
        """Begin to come to rest without the path; return the first setpoint of that."""
        self.brake(fault, text)
        if not self.is_moving:
            return self._hold()
        self._pursue(self._servo_limits, is_off_path=True)
        self.pursuit.stop_joints(self._servo_limits)
        return self._follow(UNKNOWN)

    def fail(self, fault: Fault, text: str) -> bool:
        """Enter *fault* now; return whether it is new."""
        if self.state is ServoState.FAULT and self.fault is fault:
            return False
        self.fault, self.fault_text = fault, text
        if self.is_moving:
            self._rest()
        self.pursuit.end()
        self.time_scaling.halt()
        self.state = advance(self.state, Event.FAIL)
        self._on_fault(fault, text)
        return True

    # The next setpoint

    def _move(self, deadline_ns: int) -> PathPoint:
        """Return the next setpoint of a motion, or of a stop on its path."""
        scaling, follower, share = self.time_scaling, self.follower, 1.0
        if self.state is _STREAMING:
            speed = self._speed * self._share_of_device()
            if self._is_waiting:
                # The last setpoints of the previous motion must be over, for differences over
                # cycles too.
                share = self._share_run(deadline_ns) if self._guard.is_at_rest else 0.0
                if share <= 0.0:
                    return self._hold()
                self._is_waiting = False
                # The path is at rest there: it needs no ramp of the speed.
                scaling.begin(scaling.brake_rate, speed)
            scaling.target = speed
            if not follower.reaches(scaling.braking_cycles):
                self.brake(Fault.PATH_STARVED, "the daemon did not deliver the path in time")
            if self._cones_ahead is not None:
                problem = self._cones_ahead.intrusion(scaling.braking_cycles)
                if problem:
                    self.brake(Fault.LIMIT_GUARD, f"the path would reach {problem}")
        before, part = scaling.rate, follower.part
        if scaling.target == 0.0 < before and not scaling.plan:
            self._quick_stop.seek(self._servo_limits, may_end=self.state is _STOPPING)
        rate = scaling.advance()
        try:
            path = follower.advance(rate * share)
        except StarvedError as error:
            return self.leave_path(Fault.PATH_STARVED, str(error))
        if follower.part is not part:
            self._adopt(follower.part)
        if self._following is not None and not path.joints:
            return self.leave_path(Fault.PATH_STARVED, "the path has no joints any more")
        problem = self._guard.admit(path.q, path.position, self._servo_limits, path.joints)
        if problem:
            return self.leave_path(Fault.LIMIT_GUARD, f"the next setpoint would reach {problem}")
        if follower.is_at_end:
            self.last = path
            self._finish()
            return self.last
        if self.state is _STOPPING and scaling.is_at_rest and before == 0.0:
            self.last = path
            self._finish()
            return self._hold()
        if rate == 1.0 == before:
            return path
        change = (rate - before) / scaling.period
        return PathPoint(
            path.q,
            combine(path.omega_body, rate, path.omega_body, 0.0),
            combine(path.alpha_body, rate * rate, path.omega_body, change),
            path.position,
            combine(path.velocity, rate, path.velocity, 0.0),
            path.joints,
        )

    def _share_of_device(self) -> float:
        """Return how fast the device lets motions run, 0 to 1; brake if the driver cannot say."""
        if self._scaled is None:
            return 1.0
        try:
            share = self._scaled.speed_scaling
            if 0.0 <= share <= 1.0:
                return share
            problem = f"expected 0 to 1, got {share!r:.80}"
        except Exception as error:  # noqa: BLE001 - a driver's defect must not end the servo
            problem = f"{type(error).__name__}: {error}"
        self.brake(Fault.INTERNAL, f"the driver's speed_scaling is wrong: {problem}")
        return 0.0

    def _share_run(self, deadline_ns: int) -> float:
        """Return the share of the current cycle for which a waiting motion runs.

        Each setpoint is the target for the end of its cycle.  So devices whose cycles begin at
        different times stay in step on their paths.
        """
        if self._start_ns == UNKNOWN:
            return 1.0
        period_ns = self._period_ns
        return min((deadline_ns + period_ns - self._start_ns) / period_ns, 1.0)

    def _go_on_from_rest(self, gap_ns: int) -> None:
        """Resume a stopped motion from the device's rest position, if that is allowed."""
        guard = self._guard
        guard.anchor(guard.q, guard.position, guard.joints)
        self.time_scaling.halt()
        if self.state is _STOPPING:
            self._finish()
        elif gap_ns > self._stall_ns:
            self.fail(
                Fault.SERVO_STALLED,
                f"the servo process did not run for {gap_ns * 1e-9:.3f} s, at most "
                f"{self._stall_ns * 1e-9:g} s are allowed in motion",
            )
        elif self.state is _TRACKING:
            self.pursuit.rest()

    def _follow(self, deadline_ns: int) -> PathPoint:
        """Return the next setpoint towards a target, or of a stop off the path."""
        pursuit, guard = self.pursuit, self._guard
        point, position, joints = pursuit.step(
            deadline_ns, self._servo_limits, is_stopping=self.state is not _TRACKING
        )
        self._servo_limits = pursuit.limits
        q = sent = point.q
        if not joints:
            joints = self._joints_towards(q, position)
            # The servo sends what the axes can follow.
            if self._mechanism is not None and joints:
                sent = self._mechanism.forward(joints)[0]
        if self._is_off_path:
            guard.take(q, position, joints)
        elif problem := self._enters_cone(sent, joints) or guard.admit(
            q, position, self._servo_limits, joints
        ):
            return self.leave_path(Fault.LIMIT_GUARD, f"the next setpoint would reach {problem}")
        q = sent
        is_there = norm(difference(q, self._sent)) < _START_TOLERANCE
        is_there = is_there and max(map(abs, guard.joint_rates), default=0.0) < _STILL
        self._sent = q
        if self.state is _STOPPING and is_there and pursuit.is_at_rest and guard.velocity == ZERO:
            self._finish()
            # Axes that could not reach it hold where they could.
            guard.anchor(q, position, joints if self._takes_joints else ())
            return PathPoint(q, ZERO, ZERO, position, ZERO, joints)
        return PathPoint(q, point.omega_body, point.alpha_body, position, guard.velocity, joints)

    def _enters_cone(self, sent: Quaternion, joints: Joints) -> str:
        """Return into which cone axes lead that take another path than their poses."""
        if self.cones is None or not joints:
            return ""
        return self.cones.intrusion(self._sent, sent)

    def _joints_towards(self, q: Quaternion, position: Vector3) -> Joints:
        """Return the joints of the next cycle towards a pose; empty if the pose itself is sent."""
        if self._following is None:
            return ()
        guard = self._guard
        last = guard.joints
        joints = self._following.step(q, position, last, guard.joint_rates)
        if not self._brakes_outside(joints):
            return self._following.braked(last, guard.joint_rates)
        return joints

    def _rest(self) -> None:
        """Set the pose to that of the joints.

        Between two records of a path its orientation differs slightly from that of the joints, and
        the next motion begins where both agree.
        """
        last = self.last
        if self._following is not None and self._mechanism is not None and last.joints:
            try:
                q = self._mechanism.forward(last.joints)[0]
            except Exception:  # noqa: BLE001 - a driver's defect must not keep it from the fault
                return
            self._guard.q, self.last = q, last._replace(q=q)

    def _finish(self) -> None:
        """Come to rest: enter holding, or the fault that made the stop necessary."""
        self._rest()
        self.time_scaling.halt()
        self.pursuit.end()
        if self.fault is not _NO_FAULT:
            self.fail(self.fault, self.fault_text)
        else:
            self.state = advance(self.state, Event.REST)

    def _adopt(self, part: PathPart) -> None:
        """Use the limits of the motion that the path has reached."""
        self._servo_limits = part.servo_limits
        self.motion = part.number
        self._brake_as_promised()

    def _brake_as_promised(self) -> None:
        """Stop as fast as the rest of the path permits, at least as fast as now."""
        follower, scaling = self.follower, self.time_scaling
        slowest = follower.slowest_brake_rate
        if not scaling.plan and (scaling.is_steady or slowest > scaling.brake_rate):
            scaling.brake_rate = slowest
