"""What the servo asks of a driver, and the values that pass between them.

A driver lives in the servo process, on its one thread.  It is constructed with its options,
opened once, enabled and disabled by command, then called every cycle: first :meth:`Driver.read`,
then :meth:`Driver.write`.  Both must return well within a period and never wait for anything
but the device.  No NumPy here: a cycle is plain Python floats, and the values are named tuples,
which are made in a quarter of the time of a frozen dataclass.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

from orientd.clock import Clock
from orientd.driver.finding import Finding

Vector3 = tuple[float, float, float]
"""``(x, y, z)``; its frame and unit are in the name of what holds it."""
Quaternion = tuple[float, float, float, float]
"""``(w, x, y, z)`` of norm 1, tool to world."""

ZERO: Vector3 = (0.0, 0.0, 0.0)
"""No velocity, or the origin."""
IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)
"""The orientation of the world itself."""


class Setpoint(NamedTuple):
    """What the device is asked to do in one cycle.

    Attributes:
        time_ns: the cycle's deadline on the monotonic clock.
        q: orientation ``(w, x, y, z)``, tool to world.
        omega_body: angular velocity, rad/s, body frame.
        alpha_body: its derivative in body components, rad/s^2.
        position: tool position in the world, m.
        velocity: its derivative, m/s.
    """

    time_ns: int
    q: Quaternion
    omega_body: Vector3 = ZERO
    alpha_body: Vector3 = ZERO
    position: Vector3 = ZERO
    velocity: Vector3 = ZERO


class Feedback(NamedTuple):
    """What the device reported.

    Attributes:
        time_ns: when it was *measured*, on the monotonic clock; the servo computes the age.
        q: measured orientation ``(w, x, y, z)``, tool to world.
        omega_body: measured angular velocity, rad/s, body frame.
        position: measured tool position in the world, m.
        joints: whatever the device's axes are, rad; empty where it has none.
    """

    time_ns: int
    q: Quaternion
    omega_body: Vector3 = ZERO
    position: Vector3 = ZERO
    joints: tuple[float, ...] = ()


class Figure(NamedTuple):
    """One number that a driver certifies of a motion.

    Attributes:
        name: of what, in words.
        value: in *unit*.
        unit: as it is written, for example ``rad/s``.
        limit: what was allowed, same unit; ``None`` where nothing limits it.
        time: when in the motion, s; ``None`` where it is no one instant.
    """

    name: str
    value: float
    unit: str
    limit: float | None = None
    time: float | None = None


class ShapedPath(NamedTuple):
    """A path as a device's axes can follow it, on the same grid as the one it was made of.

    Attributes:
        orientations: one for each period; the first is that of the path given, and the path goes on
            from it as that one does.  The last one is at rest.
        path_times: how far along the path given each of them is, s; never decreasing.
        joints: axis angles at each of them, rad, unwrapped.
        figures: what holds for it.
        notes: what there is to say of it, in words, a line each.
    """

    orientations: Sequence[Quaternion]
    path_times: Sequence[float]
    joints: Sequence[tuple[float, ...]]
    figures: tuple[Figure, ...] = ()
    notes: tuple[str, ...] = ()


class Driver(ABC):
    """One device.  Raise :class:`~orientd.errors.DeviceError` subclasses, nothing else.

    Attributes:
        name: the registry's name of this kind of driver.
        default_rate_hz: cycle rate where the configuration names none.
    """

    name: ClassVar[str]
    default_rate_hz: ClassVar[float] = 500.0

    def __init__(self, options: Mapping[str, Any], *, period_ns: int, clock: Clock) -> None:
        """Check *options* and keep what is needed; touch no device.

        Args:
            options: the driver's own table of the configuration.
            period_ns: cycle period.
            clock: the clock that stamps feedback.

        Raises:
            ValueError: an option is unknown or not allowed; the message names the option, what was
                expected and what came.
        """
        self.options = dict(options)
        self.period_ns = period_ns
        self.clock = clock

    @property
    def speed_scaling(self) -> float:
        """How fast the device itself lets motions run, 0 to 1; the path clock follows it."""
        return 1.0

    def deadline_shift_ns(self, deadline_ns: int) -> int:  # noqa: ARG002 - most devices are always ready
        """Return by how much later than a period from *deadline_ns* the next deadline should be.

        For a device with a cycle of its own that setpoints should keep clear of.  Called after
        every cycle; must not raise.  Path time counts cycles, so the servo moves a deadline by no
        more than a four-hundredth of a period.
        """
        return 0

    @property
    def is_spent(self) -> bool:
        """Whether only a new process can reach the device again; the servo then ends this one."""
        return False

    def tune(self, options: Mapping[str, Any]) -> None:
        """Take the options that hold for the motions to come, in place of those taken before.

        Called in the servo process while the device holds still, before a motion begins whose
        options are others than those of the last; empty for those of the configuration alone.
        Called in the daemon's process, too, on a driver that is not open, to check them.

        Raises:
            ValueError: an option is unknown or not allowed, as in the constructor; nothing changes.
        """
        if options:
            names = ", ".join(map(repr, options))
            raise ValueError(f"the driver {self.name!r} has no options of one motion, got {names}")

    def examine(  # noqa: B027 - most devices follow any path inside the limits
        self, times: Sequence[float], poses: Sequence[tuple[Quaternion, Vector3]]
    ) -> None:
        """Refuse a path that the device cannot follow although it keeps the limits.

        Called in the daemon's process, on a driver that is not open, before a motion is accepted.

        Args:
            times: path times in seconds, increasing.
            poses: orientation and position at each of them.

        Raises:
            PlanError: why not, where and when.
        """

    def shape(
        self,
        period: float,  # noqa: ARG002 - most devices follow any path as it is
        orientations: Sequence[Quaternion],  # noqa: ARG002
        joints: tuple[float, ...],  # noqa: ARG002
        before: Sequence[tuple[float, ...]] = (),  # noqa: ARG002
        rates: Vector3 = (math.inf, math.inf, math.inf),  # noqa: ARG002
    ) -> ShapedPath | None:
        """Return the path that the device's axes will follow, where that is not any path.

        Called in the daemon's process, on a driver that is not open, before a motion is accepted
        and before :meth:`examine`.  What is returned is what will be streamed.

        Args:
            period: of the grid, s.
            orientations: of the whole motion up to its rest, a period apart.
            joints: axis angles where the motion begins, rad: those planned, or those that the
                device last reported; empty where they are not known.
            before: axis angles that were planned for the periods before a motion that begins while
                the device moves, the oldest first; empty where it begins at rest.
            rates: largest angular velocity, acceleration and jerk that the tool may have where the
                device leaves the path or its times; rad/s, rad/s^2, rad/s^3.

        Returns:
            ``None`` where the device follows the path as it is.

        Raises:
            LimitError: an axis cannot follow; the message names it, the value and the time.
            PlanError: the path cannot be followed for another reason.
        """
        return None

    def outline(self, joints: tuple[float, ...]) -> Sequence[Sequence[Vector3]]:  # noqa: ARG002 - many devices have no axes
        """Return the device's shape as it stands, for a picture of it.

        Called in the daemon's process, on a driver that is not open, while somebody watches; from
        any thread, so it must depend on nothing but *joints* and the options.

        Args:
            joints: axis angles as measured, rad.

        Returns:
            Lines, each from point to point, in the coordinates of the positions, m; empty where
            there is nothing to show.
        """
        return ()

    @abstractmethod
    def open(self) -> None:
        """Connect.  May take long; no cycle runs yet.

        Raises:
            LinkError: the device is not there.
        """

    @abstractmethod
    def enable(self) -> Feedback:
        """Make the device ready to follow setpoints, without moving it.

        Returns:
            Where the device is; the first setpoint will be exactly this.
        """

    @abstractmethod
    def read(self) -> Feedback | None:
        """Return the newest feedback, or ``None`` before there is any.  Called every cycle."""

    @abstractmethod
    def write(self, setpoint: Setpoint) -> None:
        """Send *setpoint*.  Called every cycle while enabled, after :meth:`read`."""

    @abstractmethod
    def disable(self) -> None:
        """Leave the device standing still and no longer following.  Must not raise twice."""

    def reset(self) -> None:  # noqa: B027 - most devices need nothing
        """Clear a fault of the device, so that :meth:`enable` can work again."""

    def diagnose(self) -> Sequence[Finding]:
        """Look at the device and the way to it; change nothing, raise no :class:`DeviceError`.

        Called on a driver that is not open, outside of a servo process, and never again.
        """
        return ()

    def park(self) -> None:  # noqa: B027 - most devices are left where they stand
        """Bring the device to where it may be left alone; it may move, and let go of its load.

        Called once, after :meth:`disable`, at an orderly end only: not in a fault, and not where
        the daemon was lost, when the device is to go on holding.  May take some 20 s.
        """

    @abstractmethod
    def close(self) -> None:
        """Release everything but the device's hold on where it is.

        Never raises; called on every way out.
        """
