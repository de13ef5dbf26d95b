"""One device of the daemon: what it can be asked to do, and what there is to see of it."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from orientd.config import DeviceSettings
from orientd.daemon.device_axes import DeviceAxes
from orientd.daemon.devices import DeviceEvent, EventKind, servo_limits_of
from orientd.daemon.motions import AT_ONCE, Motions, MoveOptions, Prepared
from orientd.daemon.planners import PlanCall, PlannedMotion, Planners
from orientd.daemon.supervised_device import SupervisedDevice
from orientd.driver import Explaining, Quaternion, Vector3, make_driver
from orientd.errors import RequestError, StateError
from orientd.planner import Limits
from orientd.planner import State as PlannedState
from orientd.rpc import control_pb2 as pb
from orientd.servo import LEFT_OUT_WORD
from orientd.stream import NOT_GIVEN, Command, Cycle, ServoState, unpack_cycle

if TYPE_CHECKING:
    from orientd.daemon.stops import StopFolder

_log = logging.getLogger(__name__)

_SAME_BRANCH = 0.5
"""How far axis angles as measured may be from those planned to be on the same branch, rad."""


class Device(SupervisedDevice):
    """A device and what can be asked of it, from any thread.

    Its attributes are those of :class:`~orientd.daemon.supervised_device.SupervisedDevice`, and:

    Attributes:
        limits: what no motion of it may exceed.
        is_free: whether it was let go when it was disabled, to be moved by hand.
    """

    def __init__(
        self,
        settings: DeviceSettings,
        *,
        planners: Planners,
        on_event: Callable[[DeviceEvent], None],
        stops: StopFolder | None = None,
    ) -> None:
        """Check the driver and its options; start nothing.

        Args:
            settings: the device's part of the configuration.
            planners: plan for it.
            on_event: called from the device's thread, or from a command.
            stops: where the servo listens for stops, and who records them.

        Raises:
            ConfigError: the driver is not installed, or refuses its options.
        """
        # First, as it says of a driver that is not installed which device was to have it.
        self._examiner = make_driver(
            settings.name, settings.driver, settings.options, settings.period_ns
        )
        explaining = self._examiner if isinstance(self._examiner, Explaining) else None
        super().__init__(settings, on_event=on_event, explaining=explaining, stops=stops)
        self.limits, self._planners = settings.limits.to_limits(), planners
        self._axes = DeviceAxes(self._examiner, self.name)
        self.is_free = self._was_following = False

    # Motions

    def commanded(self) -> PlannedState:
        """Return the state a new motion must begin in: where the device is commanded to be.

        Raises:
            StateError: the device is not holding.
        """
        cycle = self._servo.running().newest()
        if cycle is None or cycle.state is not ServoState.HOLDING:
            state = "not ready" if cycle is None else cycle.state.name.lower()
            problem = self._servo.fault_text
            advice = {
                "idle": f": {problem}; then reset it" if problem else "; enable it first",
                "streaming": "; stop the present motion first",
                "tracking": "; end the following of targets first",
                "fault": f": {problem}; reset it first",
            }.get(state, "")
            raise StateError(f"device {self.name} is {state}, not holding{advice}")
        return PlannedState.at_rest(cycle.q, cycle.position)

    async def plan(self, order: PlanCall) -> PlannedMotion:
        """Plan a motion that begins at rest; see :meth:`.Motions.plan`."""
        self._check_able()
        return await self._loaded().plan(order)

    async def prepare(
        self, order: PlanCall, move_options: MoveOptions = AT_ONCE, *, attempt: int = 0
    ) -> Prepared:
        """Plan a motion for :meth:`start`; see :meth:`.Motions.prepare`."""
        self._check_able()
        return await self._loaded().prepare(order, move_options, attempt=attempt)

    async def await_steady(self) -> None:
        """Wait while the speed along the path is changing; see :meth:`.Motions.await_steady`."""
        await self._loaded().await_steady()

    def start(self, prepared: Prepared) -> int:
        """Begin a motion and return its number, once the servo has taken it up.

        See :meth:`.Motions.start`.
        """
        with self._lock:
            motions = self._loaded()
            if prepared.leave is None:
                self._tend()
                self.commanded()
            self._number += 1
            motions.start(prepared, self._number, speed=self._speed)
            return self._number

    def _check_able(self) -> None:
        """Refuse what a device cannot do that is neither holding nor moving.

        Raises:
            StateError: why not.
        """
        cycle = self._servo.running().newest()
        if cycle is None or cycle.state not in (ServoState.STREAMING, ServoState.STOPPING):
            self.commanded()

    def _loaded(self) -> Motions:
        """Return the motions of the present servo, which are made with the first of them."""
        with self._lock:
            if self._motions is None:
                self._motions = Motions(
                    self._servo.running(),
                    self.name,
                    self._planners,
                    period=self.period_ns * 1e-9,
                    lead=self.lead,
                    read_ahead=self._read_ahead,
                    tell=self._tell,
                )
            return self._motions

    def is_at(self, joints: tuple[float, ...]) -> bool:
        """Whether the device's axes are at *joints*, on the same branch and turn."""
        cycle = self._servo.running().newest()
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
            PlanError: the device does not say what has to be known of it to judge targets.
        """
        servo_limits = servo_limits_of(self.limits.narrowed(limits), brake_rate=1.0)
        self._axes.expect_targets()
        with self._lock:
            number = self._number + 1
            self._servo.running().ask(Command.TRACK, motion=number, servo_limits=servo_limits)
            self._number = self._tracked = number
            if self._motions is not None:
                self._motions.is_paused = False
                kind = EventKind.MOTION_REPLACED
                self._motions.drop("by targets to follow", kind=kind)
            self._tell(EventKind.MOTION_STARTED, number, "following targets")
        return number

    def aim(
        self,
        q: Quaternion,
        omega_body: Vector3 | None,
        time_ns: int,
        expires_ns: int,
        position: Vector3 | None = None,
    ) -> None:
        """Hand the servo a target; waits for nothing.  To be called by one thread at a time.

        Raises:
            RequestError: the device cannot be there.
            StateError: there is no servo.
        """
        servo = self._servo.running()
        cycle = servo.newest()
        if cycle is not None and cycle.joints:
            at = cycle.position if position is None else position
            problem = self._axes.refusal(q, at, cycle.joints)
            if problem:
                raise RequestError("target", problem)
        servo.memory.targets.publish(
            time_ns, expires_ns, *q, *(omega_body or NOT_GIVEN), *(position or NOT_GIVEN)
        )

    @property
    def targets(self) -> tuple[int, int]:
        """How many targets the servo process was given so far, and how many it left out."""
        ring = self._servo.running().memory.targets
        return ring.head, ring.words[LEFT_OUT_WORD]

    # Commands

    def enable(self) -> None:
        """Make the device follow; it holds where it is."""
        self._servo.running().ask(Command.ENABLE)
        self.is_free = False

    def reset(self) -> None:
        """See :meth:`.SupervisedDevice.reset`; whatever a fault leaves is held from then on."""
        super().reset()
        self.is_free = False

    def disable(self, *, is_freed: bool = False) -> None:
        """Let the device no longer follow; it must be holding, and may be moved by hand then."""
        was_following = self.snapshot().state is ServoState.HOLDING
        self._servo.running().ask(Command.FREE if is_freed else Command.DISABLE)
        self.is_free, self._was_following = is_freed, was_following

    def end_free(self) -> None:
        """Have what was let go hold where it is if it followed before, else not follow."""
        if self.is_free and self._was_following:
            self.enable()
        elif self.is_free:
            self.disable()

    def stop(self) -> None:
        """Stop on the path; nothing happens to a device at rest."""
        self._servo.running().ask(Command.STOP)

    def halt(self) -> None:
        """Stop as quickly as the limits allow, off the path if need be."""
        self._servo.running().ask(Command.HALT)

    def pause(self) -> None:
        """Come to rest on the path, to be resumed."""
        with self._lock:
            self._servo.running().ask(Command.SPEED, speed=0.0)
            if self._motions is not None:
                self._motions.is_paused = True

    def resume(self) -> None:
        """Go on after :meth:`pause`, at the speed that was set."""
        with self._lock:
            self._servo.running().ask(Command.SPEED, speed=self._speed)
            if self._motions is not None:
                self._motions.is_paused = False

    def withdraw(self, number: int, reason: str) -> bool:
        """Have motion *number* not be run, if it waits for its turn; what runs goes on.

        Returns:
            Whether that was so; else it runs, or has ended.
        """
        with self._lock:
            motions = self._motions
            out = None if motions is None else motions.withdraw(number, reason)
            for queued in out or ():
                self._tell(EventKind.MOTION_STOPPED, queued.number, reason)
        return out is not None

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
            link = self._servo.running()
            cycle = link.newest()
            if cycle is not None and cycle.state is ServoState.STREAMING and not self.is_paused:
                link.ask(Command.SPEED, speed=speed)
            self._speed = speed

    # What there is to see

    @property
    def next_cycle(self) -> int:
        """Number of the cycle that comes next; it begins again with each servo process."""
        return self._servo.next_cycle

    def cycles(self, since: int, limit: int = 4096) -> list[Cycle]:
        """Return cycles from number *since* on, oldest first, as far as they are still known."""
        return [unpack_cycle(record) for record in self.cycle_records(since, limit)]

    def cycle_records(self, since: int, limit: int = 4096) -> list[bytes]:
        """Return the records of cycles from number *since* on, as far as they are still known."""
        return self._servo.cycle_records(since, limit)

    def outline(self) -> Sequence[Sequence[Vector3]]:
        """Return the device's shape as it stands: lines, m; none where it has no axes."""
        link = self._servo.link
        cycle = link.newest() if link is not None else None
        return self._axes.outline(cycle.joints) if cycle is not None and cycle.joints else ()

    def statistics(self, motion_number: int) -> pb.MotionStatistics | None:
        """Return what was measured of a motion; ``None`` unless it is one of the newest."""
        return self._figures(motion_number)[0]

    def settled_after(self, motion_number: int) -> float | None:
        """Return how long after its last setpoint a motion was on target, s, if that is known."""
        return None if self._motions is None else self._motions.settled_after(motion_number)

    def began_ns(self, motion_number: int) -> int | None:
        """Return when a motion began to move, monotonic clock, where that is known."""
        return self._figures(motion_number)[1]

    def _figures(self, motion_number: int) -> tuple[pb.MotionStatistics | None, int | None]:
        with self._lock:
            motions = self._motions
            return (None, None) if motions is None else motions.figures(motion_number)
