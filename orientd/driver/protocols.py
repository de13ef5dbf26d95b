"""What a driver may offer besides the six methods; each is optional.

A driver offers one of them by having its methods; it need not inherit.  Whoever asks looks once,
with ``isinstance``.  :class:`~orientd.testing.DriverConformance` tests all that a driver offers.
Methods of a running device are called in the servo process, on its one thread; nothing else is
called meanwhile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from orientd.driver.finding import Finding
from orientd.driver.values import AxisGap, Feedback, PartHealth

if TYPE_CHECKING:
    from orientd.driver.contract import Driver


@runtime_checkable
class Resettable(Protocol):
    """A device with faults of its own that a command can clear."""

    def reset(self) -> None:
        """Clear a fault of the device, so that :meth:`.Driver.enable` can work again.

        Called after :meth:`.Driver.disable`; may take long.

        Raises:
            DeviceError: the fault is still there.
        """


@runtime_checkable
class RestsInFault(Protocol):
    """A device that could still move in a fault, for example when a jammed axis comes free."""

    def rest_in_fault(self) -> None:
        """Leave the device where it is from now on, whatever setpoint it still gets.

        Called once a fault has brought everything to rest, before :meth:`.Driver.disable` if that
        follows at once, and again for every stop in the fault.  :meth:`.Driver.write` may still be
        called with the setpoint that is held.  Must neither wait nor raise.
        """


@runtime_checkable
class Freeable(Protocol):
    """A device that a person can move by hand."""

    def free(self) -> None:
        """Let the device be moved by hand, until it is enabled or disabled again.

        Called after :meth:`.Driver.disable`; feedback goes on.

        Raises:
            DeviceFaultError: it cannot be moved by hand now.
        """


@runtime_checkable
class Parkable(Protocol):
    """A device that needs more than to be disabled before it is left alone."""

    def park(self) -> None:
        """Bring the device to where it may be left alone; it may move, and let go of its load.

        Called once, after :meth:`.Driver.disable`, at an orderly end only: not in a fault, and not
        if the daemon was lost, when the device is to go on holding.  May take some 20 s.
        """


@runtime_checkable
class Tunable(Protocol):
    """A driver with options that a single motion may set."""

    def tune(self, options: Mapping[str, Any]) -> None:
        """Take the options that hold for the motions to come, in place of those taken before.

        Called in the servo process while the device holds still, before a motion whose options
        differ from those of the last one; empty for those of the configuration alone.  Called in
        the daemon's process, too, on a driver that is not open, to check them.

        Raises:
            ValueError: an option is unknown or not allowed, as in the constructor; nothing changes.
        """


@runtime_checkable
class Healthy(Protocol):
    """A device that reports on its parts, or a driver with something to say.

    Both are called once a second, in a cycle, and must neither wait nor raise.
    """

    def health(self) -> Sequence[PartHealth]:
        """Return how the device's parts are, as last measured; empty if they do not tell."""

    def notices(self) -> Sequence[str]:
        """Return warnings: settings that were changed, what keeps the device from doing better.

        Each is given to the user once until the next reset.
        """


@runtime_checkable
class Arriving(Protocol):
    """A device whose axes lag behind their setpoints."""

    def gaps(self) -> Sequence[AxisGap]:
        """Return how far every axis is from where it was last sent, by the newest feedback.

        Called in each cycle after the last setpoint of a motion, until all axes are within their
        tolerances: the motion is done then.  An axis that is not after its patience is a fault of
        the device.  Must neither wait nor raise.
        """


@runtime_checkable
class Scaled(Protocol):
    """A device that may run motions more slowly than they are sent."""

    @property
    def speed_scaling(self) -> float:
        """How fast the device itself lets motions run, 0 to 1; the time scaling follows it."""


@runtime_checkable
class PhaseLocked(Protocol):
    """A device with a cycle of its own that setpoints should keep clear of."""

    def deadline_shift_ns(self, deadline_ns: int) -> int:
        """Return by how much later than a period from *deadline_ns* the next deadline should be.

        At most half a period either way.  Called after every cycle; must neither wait nor raise.
        Path time counts cycles, so the servo moves a deadline by no more than a four-hundredth of
        a period.
        """


@runtime_checkable
class Explaining(Protocol):
    """A driver that knows why its device or its client library fails."""

    def why_stale(self) -> str:
        """Return who is late when feedback is, in words; empty if the driver cannot know.

        Called in the cycle in which feedback has become too old; must neither wait nor raise.
        """

    def why_ended(self, signal: int) -> str:
        """Return what it means that *signal* has ended the servo process; empty if unknown.

        Called in the daemon's process, on a driver that is not open.
        """


@runtime_checkable
class Diagnosable(Protocol):
    """A device that ``orientd doctor`` can look at."""

    def diagnose(self) -> Sequence[Finding]:
        """Look at the device and the way to it; change nothing, raise no :class:`DeviceError`.

        Called on a driver that is not open, outside of a servo process, and never again.
        """


@runtime_checkable
class Locatable(Protocol):
    """A device that can say where it is without a daemon."""

    def offline_start(self, *, from_device: bool) -> Feedback | None:
        """Return where a plan begins that is made without the daemon.

        Called on a driver that is not open.

        Args:
            from_device: whether to ask the device; else the options say.

        Returns:
            ``None`` if the first keyframe says enough.

        Raises:
            LinkError: the device is asked, and does not answer.
            PlanError: it is not asked, and the options do not say enough.
        """


def tune(driver: Driver, options: Mapping[str, Any]) -> None:
    """Hand *driver* the options of the motions to come; see :meth:`Tunable.tune`.

    Raises:
        ValueError: it refuses them, or has none.
    """
    if isinstance(driver, Tunable):
        driver.tune(options)
    elif options:
        names = ", ".join(map(repr, options))
        raise ValueError(f"the driver {driver.name!r} has no options of one motion, got {names}")
