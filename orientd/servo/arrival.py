"""Whether the device's axes have arrived where a motion has ended.

A motion ends with its last setpoint; the axes come after it.  They have arrived once each was
measured to be within its tolerance.  What has not arrived in the time that its driver allows, half
a second for most, is blocked or overloaded: a fault, which says which axis it is and how far it is
behind.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from orientd.driver import AxisGap

ARRIVAL_NS = 500_000_000
"""How long after a motion's last setpoint the axes of most devices may take to arrive."""


class Arrival:
    """The wait for the axes after the last setpoint of a motion.

    Attributes:
        is_awaited: whether they have not arrived yet.
    """

    def __init__(self) -> None:
        self.is_awaited = False
        self._sent_ns = 0

    def begin(self, sent_ns: int) -> None:
        """Wait for the axes to be where the setpoint of the cycle at *sent_ns* sends them."""
        self.is_awaited, self._sent_ns = True, sent_ns

    def end(self) -> None:
        """Wait no longer."""
        self.is_awaited = False

    def look(self, gaps: Sequence[AxisGap], measured_ns: int, allowed_ns: int = ARRIVAL_NS) -> str:
        """Look at the axes as they were measured at *measured_ns*.

        Args:
            gaps: of the axes.
            measured_ns: when.
            allowed_ns: how long after the last setpoint they may take.

        Returns:
            Which of them will not arrive; empty while they may, and once they have.
        """
        # A measurement from before the last setpoint says nothing; nor does no measurement at all.
        if gaps and measured_ns <= self._sent_ns:
            return ""
        behind = [axis for axis in gaps if not abs(axis.gap) <= axis.tolerance]
        if not behind:
            self.is_awaited = False
        elif measured_ns - self._sent_ns >= allowed_ns:
            self.is_awaited = False
            return "; ".join(_explain(axis, allowed_ns) for axis in behind)
        return ""


def _explain(axis: AxisGap, allowed_ns: int) -> str:
    load = f", with {axis.load}" if axis.load else ""
    return (
        f"{axis.name} has not arrived: it is {math.degrees(abs(axis.gap)):.1f} deg behind the end "
        f"of the motion {allowed_ns * 1e-9:.2g} s after the last setpoint, at most "
        f"{math.degrees(axis.tolerance):.3g} deg are allowed{load}; is it blocked or overloaded?"
    )
