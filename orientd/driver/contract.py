"""What the servo asks of every driver: six methods.

A driver lives in the servo process, on its one thread.  It is constructed with its options,
opened once, enabled and disabled by command, then called every cycle: first :meth:`Driver.read`,
then :meth:`Driver.write`.  Both must return well within a period and wait for nothing but the
device.  What passes between the two is in :mod:`orientd.driver.values`, and what a driver may offer
besides in :mod:`orientd.driver.protocols`.

What :meth:`Driver.read` or :meth:`Driver.write` raises becomes a fault.  Its kind decides how the
device comes to rest.  To brake, the servo goes on reading and writing until the device stands still
on its path.  To cut off, the servo writes nothing more and calls :meth:`Driver.disable` at once.

====================  ===================  ====================================
raised                fault                what the servo does
====================  ===================  ====================================
``FeedbackError``     ``feedback_stale``   brakes on the path
``AxisFaultError``    ``device_fault``     brakes on the path
``DeviceFaultError``  ``device_fault``     cuts off
``LinkError``         ``link_lost``        cuts off
``SpentLinkError``    ``link_lost``        cuts off, and the process ends
anything else         ``internal``         cuts off; it is a defect of the driver
====================  ===================  ====================================

An error of a command (enable, reset, free) fails that command and is no fault; an error of
:meth:`Driver.open` ends the process.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal

from orientd.clock import Clock
from orientd.driver.values import (
    Feedback,
    Quaternion,
    Setpoint,
    ShapedPath,
    Vector3,
)


class Driver(ABC):
    """One device.  Raise :class:`~orientd.errors.DeviceError` subclasses, nothing else.

    Attributes:
        name: the registry's name of this kind of driver.
        default_rate_hz: cycle rate if the configuration names none.
        takes: what :meth:`write` sends: ``"poses"``, or ``"joints"`` for the angles of the axes.
        longest_call: how long a read or a write takes at most, s.  The servo measures both, and
            warns if they take longer; by default it only measures.
    """

    name: ClassVar[str]
    default_rate_hz: ClassVar[float] = 500.0
    takes: ClassVar[Literal["poses", "joints"]] = "poses"
    longest_call: float = math.inf

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
    def sent_joints(self) -> tuple[float, ...]:
        """The axis angles that were sent last, rad; empty where the driver sends none."""
        return ()

    def examine(  # noqa: B027 - most devices follow any path inside the limits
        self,
        times: Sequence[float],
        poses: Sequence[tuple[Quaternion, Vector3]],
        joints: tuple[float, ...] = (),
        *,
        is_offline: bool = False,
    ) -> None:
        """Refuse a path that the device cannot follow although it keeps the limits.

        Called in the daemon's process, on a driver that is not open, before a motion is accepted.

        Args:
            times: path times in seconds, increasing.
            poses: orientation and position at each of them.
            joints: axis angles near where the path begins, rad; empty where they are not known.
            is_offline: whether the device is not to be asked for anything.

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
        free: float = 0.0,  # noqa: ARG002
    ) -> ShapedPath | None:
        """Return the path that the device's axes will follow, where that is not any path.

        Called in the daemon's process, on a driver that is not open, before a motion is accepted
        and before :meth:`examine`.  What is returned is what will be streamed.

        Args:
            period: of the grid, s.
            orientations: of the whole motion up to its rest, a period apart.
            joints: axis angles where the motion begins, rad: those planned or sent, or those that
                the device last reported; empty where they are not known.
            before: axis angles that were planned for the periods before a motion that begins while
                the device moves, the oldest first; empty where it begins at rest.
            rates: largest angular velocity, acceleration and jerk that the tool may have where the
                device leaves the path or its times; rad/s, rad/s^2, rad/s^3.
            free: up to which path time the path may stand while an axis turns at a pole, s; the
                path as it is has been refused then.

        Returns:
            ``None`` where the device follows the path as it is.

        Raises:
            LimitError: an axis cannot follow; the message names it, the value and the time.
            PlanError: the path cannot be followed for another reason.
        """
        return None

    def pace(
        self,
        period: float,  # noqa: ARG002 - most devices follow any path at its own pace
        orientations: Sequence[Quaternion],  # noqa: ARG002
        *,
        grid: float,  # noqa: ARG002
        fixed: tuple[float, float],  # noqa: ARG002
        rates: Vector3,  # noqa: ARG002
        share: float,  # noqa: ARG002
    ) -> Sequence[float]:
        """Return how far along a path that the axes cannot follow they can be in every cycle.

        Args:
            period: of the cycles, s.
            orientations: of the path, *grid* apart.
            grid: s of path time.
            fixed: path times between which it must be as it is; the first one later than the
                second where there are none.
            rates: as for :meth:`shape`.
            share: of the accelerations, to be used where the pace does not change.

        Returns:
            Path times a period apart, s, from 0 to the end; empty where there is no pace to find.

        Raises:
            LimitError: an axis cannot follow between the fixed times; it says how long would do.
        """
        return ()

    def way(
        self,
        joints: tuple[float, ...],  # noqa: ARG002 - most devices go the shortest way
        q: Quaternion,  # noqa: ARG002
        *,
        period: float,  # noqa: ARG002
        rates: Vector3,  # noqa: ARG002
        least: float,  # noqa: ARG002
        is_refused: bool,  # noqa: ARG002
    ) -> ShapedPath | None:
        """Return how the axes turn together from rest to rest at *q*, where that is the way to go.

        Called where :meth:`shape` is, for a motion with a single keyframe that begins at rest.

        Args:
            joints: axis angles where the device is, rad.
            q: the keyframe.
            period: of the cycles, s.
            rates: as for :meth:`shape`.
            least: how long it lasts at least, s.
            is_refused: whether :meth:`shape` has refused the shortest turn of the tool.

        Returns:
            The way, its path times from 0 to its duration; ``None`` for the shortest turn.

        Raises:
            LimitError: no axis angles inside their limits make *q*; the message names the axis.
            PlanError: there is no way for another reason.
        """
        return None

    def pointed(self, direction: Vector3, axis: str) -> Quaternion | None:  # noqa: ARG002 - most devices roll as they like
        """Return the orientation with which the device's axes point best where the roll is free.

        Called where :meth:`shape` has refused the least turn of the tool for the angle of an axis.

        Args:
            direction: where to point, in the coordinates of the orientations.
            axis: of the tool, ``x``, ``y`` or ``z``: what is to point there.

        Returns:
            ``None`` where there is no better one than the least turn.
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

    def follow(self, setpoint: Setpoint) -> Quaternion:
        """Send *setpoint*, which is on no planned path, or what the device's axes can do of it.

        Called in place of :meth:`write` while targets are followed, and while the device comes to
        rest off its path.

        Returns:
            The orientation that was sent.
        """
        self.write(setpoint)
        return setpoint.q

    @abstractmethod
    def disable(self) -> None:
        """Leave the device standing still and no longer following.  Must not raise twice."""

    @abstractmethod
    def close(self) -> None:
        """Release everything but the device's hold on where it is.

        Never raises; called on every way out.
        """
