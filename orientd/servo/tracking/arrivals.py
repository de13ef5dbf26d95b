"""How far apart targets arrive: evenly, or some lost or late; and whether they have ceased."""

from __future__ import annotations

UNEVEN = 1.25
"""How many times the usual gap between arrivals, and two cycles more, an even stream may take."""

SILENT = 4.0
"""After how many times the usual gap, and :data:`SILENT_NS` more, an uneven stream has ceased."""

SILENT_NS = 50_000_000

PAUSE_NS = 250_000_000
"""What comes so long after the time of the newest target begins anew, and tells of no usual gap."""

USUAL = 0.05
"""Share of the last gap in what counts as the usual one."""

FORGETTING = 0.01
"""By which share of a gap the longest one is forgotten."""


class Arrivals:
    """The gaps between arrivals; targets that arrive together count as one."""

    def __init__(self, period_ns: float) -> None:
        """Begin without any target; cycles are *period_ns* apart."""
        self._period_ns = period_ns
        self._arrived_ns = 0
        self._gap_ns = self._longest_ns = 0.0

    def note(self, newest_ns: int | None, now_ns: int) -> None:
        """Note that a target arrives; *newest_ns* is the time of the newest of those before."""
        gap_ns = now_ns - self._arrived_ns
        self._arrived_ns = now_ns
        if newest_ns is None or gap_ns <= 0:
            return
        if now_ns - newest_ns > max(PAUSE_NS, SILENT * self._gap_ns + SILENT_NS):
            return
        self._gap_ns += (USUAL if self._gap_ns else 1.0) * (gap_ns - self._gap_ns)
        self._longest_ns = max(gap_ns, self._longest_ns - FORGETTING * gap_ns)

    @property
    def are_uneven(self) -> bool:
        """Whether some targets were lost or late lately."""
        return self._longest_ns > UNEVEN * self._gap_ns + 2.0 * self._period_ns

    def have_ceased(self, now_ns: int) -> bool:
        """Whether the next target is overdue."""
        if self.are_uneven:
            patience_ns = SILENT * self._gap_ns + SILENT_NS
        else:
            patience_ns = UNEVEN * self._gap_ns + 2.0 * self._period_ns
        return now_ns - self._arrived_ns > patience_ns
