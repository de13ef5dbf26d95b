"""A gimbal on Dynamixel servos, with the driver contract.

A cycle reads the answers to the previous cycle's request, then sends one write of all goals and the
next request.  It never waits for a servo, even in a fault.  It waits at most :data:`CYCLE_SHARE` of
a period for the end of an answer that has begun to arrive.

Implausible readings are rejected (:mod:`orientd_dynamixel.servo`).  Writes of goals have no
acknowledgement, so the driver watches torque, hardware error, watchdog and the distance between
goal and position instead.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, ClassVar, Literal

from orientd.clock import Clock
from orientd.driver import (
    AxisGap,
    Driver,
    Feedback,
    Finding,
    FollowCheck,
    PartHealth,
    Setpoint,
)
from orientd.errors import AxisFaultError, DeviceError, DeviceFaultError, LinkError
from orientd.mechanism.gimbal import Gimbal
from orientd_dynamixel.bus import READ_WAIT_S, OpenBus, open_bus
from orientd_dynamixel.group import TAIL_SHARE, Group, listen
from orientd_dynamixel.options import GimbalOptions, parse
from orientd_dynamixel.servo import Servo
from orientd_dynamixel.standing import Standing, complain, judge
from orientd_dynamixel.start import engage_all, park, prepare
from orientd_dynamixel.turns import Turns

GLANCE_SHARE = 0.2
"""Share of the period for one read of the port."""
CYCLE_SHARE = TAIL_SHARE + 2 * GLANCE_SHARE
"""Share of the period that a read and a write together may wait for the port."""


class DynamixelDriver(Driver):
    """Two or three servos that turn a tool; *advice* lists conditions that cost speed."""

    name: ClassVar[str] = "dynamixel"
    default_rate_hz: ClassVar[float] = 100.0
    takes: ClassVar[Literal["poses", "joints"]] = "joints"

    def __init__(
        self,
        options: Mapping[str, Any],
        *,
        period_ns: int,
        clock: Clock,
        open_bus: OpenBus = open_bus,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        super().__init__(options, period_ns=period_ns, clock=clock)
        self.longest_call = CYCLE_SHARE * 1e-9 * period_ns
        self.settings: GimbalOptions = parse(options)
        self.advice: list[str] = []
        self._open_bus = open_bus
        self._sleep = sleep
        self._group: Group | None = None
        self._servos = [Servo(axis) for axis in self.settings.axes]
        self._gimbal: Gimbal = self.settings.gimbal()
        self._is_enabled = self._is_free = self._is_out_of_reach = False
        self._feedback: Feedback | None = None
        self._closed = f"{self.settings.port} is not open"
        self._standing = Standing(self._servos)
        self._follow: list[FollowCheck] = []
        self._turns = Turns(self.settings, self._servos)
        self._overwritten: list[str] = []
        self._unknown = ""
        self._health: tuple[PartHealth, ...] = ()
        self._health_ns = 0

    def mechanism(self, *, may_ask: bool) -> Gimbal:  # noqa: ARG002 - the options say all of it
        """Return the gimbal that the options describe."""
        return self._gimbal

    def open(self) -> None:
        """Find every servo, correct its settings, and start reading; nothing moves.

        Raises:
            LinkError: the port or a servo does not answer.
            DeviceFaultError: a servo is another model, or cannot be corrected.
        """
        self._connect()

    def enable(self) -> Feedback:
        """Switch the torque on at the present angles.

        Raises:
            LinkError: the bus is gone.
            DeviceFaultError: a servo refuses, the gimbal is outside its limits, or its turn is
                unknown.
        """
        group = self._connected()
        if self._unknown:
            raise DeviceFaultError(self._unknown)
        self._settle(group)
        for servo in self._servos:
            servo.check()
        begun = engage_all(self._servos)
        try:
            for servo in self._servos:
                servo.arm_watchdog(self.settings.watchdog_ms)
        except DeviceError:
            # Axes that held before keep holding.
            for servo in begun:
                servo.release()
            raise
        group.forget()
        angles = tuple(servo.angle(servo.goal) for servo in self._servos)
        self._is_enabled, self._is_free = True, False
        self._standing = Standing(self._servos)
        tolerance, duration = self.settings.follow_tolerance, self.settings.follow_time
        self._follow = [
            FollowCheck(str(servo), tolerance=tolerance, duration=duration)
            for servo in self._servos
        ]
        self._feedback = Feedback(
            self.clock.now_ns(), self._gimbal.orientation(angles), joints=angles
        )
        return self._feedback

    def free(self) -> None:
        """Switch the torque off, so that the gimbal can be turned by hand; it may sink."""
        group = self._connected()
        self._settle(group)
        for servo in self._servos:
            servo.let_go()
        self._is_free = True

    def read(self) -> Feedback | None:
        """Read the answers to the last request.

        Raises:
            LinkError: the port is gone.
            FeedbackError: too many answers were lost in a row.
            AxisFaultError: a servo reports an error, has no torque, or does not follow; its axis
                stands from now on.
        """
        group = self._connected()
        now_ns = self.clock.now_ns()
        try:
            is_new = group.take(now_ns)
        finally:
            if not self._is_enabled and not group.is_waiting:
                group.ask(self.clock.now_ns())
        if is_new:
            self._feedback = self._report(group)
        self._supervise(group, is_new=is_new)
        return self._feedback

    def write(self, setpoint: Setpoint) -> None:
        """Send the angles of *setpoint*, and the next request.

        Raises:
            LinkError: the port is gone.
            DeviceFaultError: an axis would leave its limits.
        """
        group = self._connected()
        if self._standing.is_at_rest:
            self._standing.send(group.bus)
            group.ask(self.clock.now_ns())
            return
        for servo, angle in zip(self._servos, setpoint.joints, strict=True):
            servo.check_angle(angle)
        # Axes that stand keep their own goals.
        for place, (servo, angle) in enumerate(zip(self._servos, setpoint.joints, strict=True)):
            within = min(max(angle, servo.options.low), servo.options.high)
            servo.goal = self._standing.goals.get(place, servo.ticks(within))
        group.bus.sync_write([(s.options.id, s.table.goal, s.goal) for s in self._servos])
        group.ask(self.clock.now_ns())

    def rest_in_fault(self) -> None:
        """Hold every axis at its present angle from now on.

        If they already stand, the driver reads their angles again.
        """
        self._standing.rest(self.clock.now_ns())

    def gaps(self) -> Sequence[AxisGap]:
        """Return the distance of every servo from its goal, and its current."""
        found = []
        readings = () if self._group is None else self._group.readings
        for servo, reading in zip(self._servos, readings, strict=bool(readings)):
            unit = servo.options.model.current_unit
            gap = servo.angle(servo.goal) - servo.angle(reading.position)
            load = f"{abs(reading.current) * unit:.2f} A" if unit else ""
            found.append(AxisGap(str(servo), gap, self.settings.arrival_tolerance, load))
        return found

    def disable(self) -> None:
        """Hold the last goal, or in a fault the position; switch the watchdogs off."""
        self._is_enabled = False
        if self._group is None or self._is_out_of_reach:
            return
        try:
            self._hold(self._group)
            if self._is_free:
                engage_all(self._servos)
                self._is_free = False
        except DeviceError:
            # The watchdogs stop unreachable servos; further attempts would only take time.
            self._is_out_of_reach = True
            raise

    def reset(self) -> None:
        """Reopen the port if it is gone, and restart servos that report an error.

        Raises:
            LinkError: the port or a servo does not answer.
            DeviceFaultError: a servo still reports an error.
        """
        self._is_enabled = False
        if self._group is not None:
            self._group.bus.close()
        self._connect()

    def diagnose(self) -> Sequence[Finding]:
        """Inspect port, servos and the highest rate of the bus."""
        diagnose = importlib.import_module("orientd_dynamixel.doctor").diagnose
        found: list[Finding] = diagnose(self.settings, self.period_ns * 1e-9, self._open_bus)
        return found

    def notices(self) -> Sequence[str]:
        """Return the overwritten settings of the servos, and conditions that cost speed."""
        return (*self._overwritten, *self.advice)

    def health(self) -> Sequence[PartHealth]:
        """Return voltage, temperature and current of every servo, with warnings."""
        group = self._group
        if group is not None and group.health and group.health_ns != self._health_ns:
            self._health_ns = group.health_ns
            told = zip(self._servos, group.health, strict=True)
            self._health = tuple(judge(servo, reading, group.health_ns) for servo, reading in told)
        return self._health

    def park(self) -> None:
        """Park and switch the torque off, or leave it on, as the options say."""
        if self._group is None or self.settings.at_end != "release":
            return
        try:
            self._settle(self._group)
            is_held = all(servo.get(servo.table.torque) for servo in self._servos)
            if self.settings.park is not None and is_held:
                park(self._servos, self.settings.park, self._sleep)
        finally:
            for servo in self._servos:
                servo.release()

    def close(self) -> None:
        """Leave the servos with their goals, watchdogs off, and release the port."""
        self._is_enabled = False
        group, self._group = self._group, None
        self._turns.close()
        if group is None:
            return
        # The watchdogs stop unreachable servos.
        with suppress(DeviceError):
            if not self._is_out_of_reach:
                self._hold(group)
        group.bus.close()

    def _connect(self) -> None:
        options = self.settings
        self._group = None
        glance_s = min(READ_WAIT_S, GLANCE_SHARE * 1e-9 * self.period_ns)
        bus = self._open_bus(
            options.port, options.baud, wait_ms=options.latency_ms, glance_s=glance_s
        )
        for servo in self._servos:
            servo.bus = bus
        try:
            self._overwritten = []
            self._unknown = prepare(
                self._servos, options, self._turns, self._sleep, self.clock, told=self._overwritten
            )
            self._group, self.advice = listen(self._servos, options, self.period_ns, self.clock)
        except DeviceError as error:
            self._closed = str(error)
            bus.close()
            raise
        self._is_out_of_reach = False

    def _connected(self) -> Group:
        if self._group is None:
            raise LinkError(self._closed)
        return self._group

    def _settle(self, group: Group) -> None:
        group.settle(self.settings.latency_ms)

    def _hold(self, group: Group) -> None:
        """Leave every servo at its goal; an unreachable one does not affect the others."""
        self._settle(group)
        now_ns = self.clock.now_ns()
        failure: DeviceError | None = None
        for place, servo in enumerate(self._servos):
            try:
                servo.hold(stands=self._standing.stands(place, now_ns))
            except DeviceError as error:
                failure = failure or error
        if failure is not None:
            raise failure

    def _report(self, group: Group) -> Feedback:
        angles, rates = [], []
        for place, (servo, reading) in enumerate(zip(self._servos, group.readings, strict=True)):
            if not self._unknown and place not in group.restarted:
                self._turns.note(place, reading.position)
            angles.append(servo.angle(reading.position))
            rates.append(servo.rate(reading.velocity))
        return Feedback(
            group.time_ns,
            self._gimbal.orientation(tuple(angles)),
            self._gimbal.kinematics.omega_body(angles, rates),
            joints=tuple(angles),
        )

    def _supervise(self, group: Group, *, is_new: bool) -> None:
        """Raise a new problem of a servo, after making its axis stand."""
        problems = [
            f"{self._servos[place]} has started again and lost its settings; was its supply "
            "interrupted?"
            for place in sorted(group.restarted)
            if self._standing.fail(place)
        ]
        for place, servo in enumerate(self._servos):
            if is_new and self._is_enabled and place not in group.restarted:
                reading, follow = group.readings[place], self._follow[place]
                problem = complain(servo, reading, follow, group.time_ns)
                if problem and self._standing.fail(place):
                    problems.append(problem)
        if problems:
            raise AxisFaultError("; ".join(problems))
