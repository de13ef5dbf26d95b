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
from collections.abc import Mapping
from typing import Any, ClassVar, Literal

from orientd.clock import Clock
from orientd.driver.values import (
    Feedback,
    Setpoint,
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
            Where the device is; the first setpoint will be exactly this.  With the angles of the
            axes if the driver takes joints.
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

    @abstractmethod
    def close(self) -> None:
        """Release everything but the device's hold on where it is.

        Never raises; called on every way out.
        """
