"""Optional methods of a driver, one protocol for each purpose.

A driver offers a protocol by having its methods; it need not inherit.  The caller checks once, with
``isinstance``.  :class:`~orientd.testing.DriverConformance` tests all that a driver offers.
The servo process calls the methods of a running device on its one thread, and nothing else
meanwhile.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from orientd.driver.values import AxisGap, Feedback, PartHealth

if TYPE_CHECKING:
    from orientd.driver.contract import Driver


from dataclasses import dataclass
from enum import Enum


class Verdict(Enum):
    """The meaning of a finding for real-time operation, or for moving a device at all."""

    OK = "ok"
    IMPROVE = "improve"
    PROBLEM = "problem"


@dataclass(frozen=True, slots=True)
class Finding:
    """One finding.

    Attributes:
        name: what was inspected.
        found: its value or state.
        verdict: what that means.
        mend: how to improve it; empty if nothing needs to change.
    """

    name: str
    found: str
    verdict: Verdict
    mend: str = ""


@runtime_checkable
class Resettable(Protocol):
    """A device whose own faults a command can clear."""

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
        """Hold the device where it is from now on, whatever setpoints follow.

        Called once a fault has brought everything to rest, and again for every stop during the
        fault.  If :meth:`.Driver.disable` follows at once, this comes first.  :meth:`.Driver.write`
        may still be called with the held setpoint.  Must neither wait nor raise.
        """


@runtime_checkable
class Freeable(Protocol):
    """A device that a person can move by hand."""

    def free(self) -> None:
        """Let the device be moved by hand, until it is enabled or disabled again.

        Called after :meth:`.Driver.disable`; feedback continues.

        Raises:
            DeviceFaultError: the device cannot be moved by hand now.
        """


@runtime_checkable
class Parkable(Protocol):
    """A device that must be parked before it is left alone."""

    def park(self) -> None:
        """Bring the device to where it may be left alone; it may move, and release its load.

        Called once, after :meth:`.Driver.disable`, and only at an orderly end.  Not called in a
        fault, nor if the daemon was lost: the device must then keep holding.  May take some 20 s.
        """


@runtime_checkable
class Tunable(Protocol):
    """A driver with options that a single motion may set."""

    def tune(self, options: Mapping[str, Any]) -> None:
        """Use *options* for the motions to come, in place of the previous ones.

        Called in the servo process while the device holds still, before a motion whose options
        differ from those of the last one.  Empty options restore those of the configuration.  The
        daemon's process also calls it, to check options, on a driver that is not open.

        Raises:
            ValueError: an option is unknown or has a wrong value, as in the constructor; nothing
            changes.
        """


@runtime_checkable
class Healthy(Protocol):
    """A device that reports on its parts, or a driver that has warnings.

    Both methods are called once a second, in a cycle, and must neither wait nor raise.
    """

    def health(self) -> Sequence[PartHealth]:
        """Return the condition of the device's parts as last measured; empty if unknown."""

    def notices(self) -> Sequence[str]:
        """Return warnings: changed settings, and conditions that limit the device.

        The user sees each one once until the next reset.
        """


@runtime_checkable
class Arriving(Protocol):
    """A device whose axes lag behind their setpoints."""

    def gaps(self) -> Sequence[AxisGap]:
        """Return the distance of every axis from its last setpoint, by the newest feedback.

        Called in each cycle after the last setpoint of a motion.  The motion is done when all axes
        are within their tolerances.  An axis that exceeds its patience is a fault of the device.
        Must neither wait nor raise.
        """


@runtime_checkable
class Scaled(Protocol):
    """A device that may run motions more slowly than they are commanded."""

    @property
    def speed_scaling(self) -> float:
        """How fast the device itself lets motions run, 0 to 1; the time scaling follows it."""


@runtime_checkable
class PhaseLocked(Protocol):
    """A device with a cycle of its own, which setpoints should not coincide with."""

    def deadline_shift_ns(self, deadline_ns: int) -> int:
        """Return how much later than a period after *deadline_ns* the next deadline should be, ns.

        At most half a period either way.  Called after every cycle; must neither wait nor raise.
        Path time counts cycles, so the servo moves a deadline by no more than a four-hundredth of
        a period.
        """


@runtime_checkable
class Explaining(Protocol):
    """A driver that knows why its device or its client library fails."""

    def why_stale(self) -> str:
        """Return what causes late feedback, in words; empty if the driver cannot know.

        Called in the cycle in which feedback has become too old; must neither wait nor raise.
        """

    def why_ended(self, signal: int) -> str:
        """Return the cause if *signal* ended the servo process; empty if unknown.

        Called in the daemon's process, on a driver that is not open.
        """


@runtime_checkable
class Diagnosable(Protocol):
    """A device that ``orientd doctor`` can inspect."""

    def diagnose(self) -> Sequence[Finding]:
        """Inspect the device and the link to it; change nothing, raise no :class:`DeviceError`.

        Called on a driver that is not open, outside of a servo process, and never again.
        """


@runtime_checkable
class Locatable(Protocol):
    """A device that can report its pose without a daemon."""

    def offline_start(self, *, from_device: bool) -> Feedback | None:
        """Return the start state of a plan that is made without the daemon.

        Called on a driver that is not open.

        Args:
            from_device: whether to ask the device; otherwise the options decide.

        Returns:
            ``None`` if the first keyframe is enough to start from.

        Raises:
            LinkError: the device does not answer.
            PlanError: the device is not asked, and the options do not give the start.
        """


def tune(driver: Driver, options: Mapping[str, Any]) -> None:
    """Give *driver* the options of the motions to come; see :meth:`Tunable.tune`.

    Raises:
        ValueError: the driver refuses them, or has none.
    """
    if isinstance(driver, Tunable):
        driver.tune(options)
    elif options:
        names = ", ".join(map(repr, options))
        raise ValueError(f"the driver {driver.name!r} takes no options of one motion, got {names}")
