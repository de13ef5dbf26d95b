"""The contract of a driver: six methods that the servo calls.

A driver lives in the servo process, on its one thread.  The servo constructs it with its options,
opens it once, and enables and disables it by command.  Then it calls :meth:`Driver.read` and
:meth:`Driver.write` in every cycle, in this order.  Both must return well within a period and wait
for nothing but the device.  :mod:`orientd.driver.values` has the values that pass between the two,
:mod:`orientd.driver.protocols` the optional methods.

An exception of a method that the servo calls in a cycle becomes a fault.  Its type decides how the
device comes to rest.  To brake, the servo keeps reading and writing until the device stands
still on its path.  To cut off, the servo writes nothing more and calls :meth:`Driver.disable` at
once.

====================  ===================  =========================================
raised                fault                what the servo does
====================  ===================  =========================================
``FeedbackError``     ``feedback_stale``   brakes on the path
``AxisFaultError``    ``device_fault``     brakes on the path
``DeviceFaultError``  ``device_fault``     cuts off
``LinkError``         ``link_lost``        cuts off
``SpentLinkError``    ``link_lost``        cuts off, and the process ends
anything else         ``internal``         brakes, but cuts off if ``write`` raised
====================  ===================  =========================================

Anything else is a defect of the driver.  So is feedback that is malformed
(:func:`~orientd.driver.feedback_problem`): the servo uses none of it and brakes, with the same
fault.

An error of a command (enable, reset, free) fails that command and is no fault.  An error of
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
        takes: what :meth:`write` receives: ``"poses"``, or ``"joints"`` for the angles of the axes.
        longest_call: how long a read or a write takes at most, s.  The servo measures both and
            warns if one takes longer.  By default it only measures.
    """

    name: ClassVar[str]
    default_rate_hz: ClassVar[float] = 500.0
    takes: ClassVar[Literal["poses", "joints"]] = "poses"
    longest_call: float = math.inf

    def __init__(self, options: Mapping[str, Any], *, period_ns: int, clock: Clock) -> None:
        """Check and keep *options*; touch no device.

        Args:
            options: the driver's own table of the configuration.
            period_ns: cycle period.
            clock: the clock that stamps feedback.

        Raises:
            ValueError: an option is unknown or has a wrong value.  The message names the option,
                the expected value and the given one.
        """
        self.options = dict(options)
        self.period_ns = period_ns
        self.clock = clock

    @abstractmethod
    def open(self) -> None:
        """Connect to the device.  May take long; no cycle runs yet.

        Raises:
            LinkError: the device does not answer.
        """

    @abstractmethod
    def enable(self) -> Feedback:
        """Make the device ready to follow setpoints, without moving it.

        Returns:
            The pose of the device, which becomes the first setpoint.  It has the angles of the axes
            if the driver takes joints.
        """

    @abstractmethod
    def read(self) -> Feedback | None:
        """Return the newest feedback, or ``None`` before the first.  Called every cycle."""

    @abstractmethod
    def write(self, setpoint: Setpoint) -> None:
        """Send *setpoint*.  Called every cycle while enabled, after :meth:`read`."""

    @abstractmethod
    def disable(self) -> None:
        """Stop following setpoints; the device stands still.  If it raises, a repeat must not."""

    @abstractmethod
    def close(self) -> None:
        """Release everything except the device's hold on its position.

        Never raises.  The servo calls it whenever it ends.
        """
