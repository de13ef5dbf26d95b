"""How targets arrive: how far apart, how old, and how stale they become before the next one.

Networks lose targets and deliver them late.  These statistics tell a disturbed stream from one
whose targets are merely rare, and a stream that has ceased from one whose next target is due.
"""

from __future__ import annotations

SILENT = 4.0
"""After how many times the usual gap between arrivals, and :data:`SILENT_NS` more, targets without
velocity have ceased if some are lost or late.  If none is, the next one is overdue from
:data:`DISTURBED` times the usual gap on."""

SILENT_NS = 50_000_000

PAUSE_NS = 250_000_000
"""What comes so long after the time of the newest target begins anew, and tells of no usual gap."""

USUAL = 0.05
"""Share of the last spacing of targets in what counts as the usual one."""

DISTURBED = 1.25
"""From how many times what the usual spacing of targets and their usual age at arrival explain on
staleness tells of lost or late ones."""

RECOVERY = 0.01
"""How fast the delay shrinks again, seconds per second."""


class Arrivals:
    """Statistics of the arrivals of targets.

    Attributes:
        newest_ns: the time of the newest target; ``None`` before there is any.
    """

    def __init__(self, period_ns: float) -> None:
        """Begin without any target; cycles are *period_ns* apart."""
        self._period_ns = period_ns
        self.newest_ns: int | None = None
        self._since_newest = 0  # arrivals
        self._spacing_ns = self._stalest_ns = 0.0
        self._youngest_ns: float | None = None
        self._arrived_ns = 0
        self._gap_ns = self._longest_gap_ns = 0.0

    def note(self, time_ns: int, now_ns: int) -> None:
        """Note that a target of *time_ns* arrives at *now_ns*."""
        self._note_gap(now_ns)
        newest_ns = self.newest_ns
        if newest_ns is None or time_ns > newest_ns:
            if newest_ns is not None:
                # Those between the newest ones count.
                spacing_ns = (time_ns - newest_ns) / self._since_newest
                self._spacing_ns = _averaged(self._spacing_ns, spacing_ns)
            self.renew(time_ns)
        age_ns, last_ns = float(now_ns - time_ns), self._youngest_ns
        if last_ns is not None:
            age_ns = min(age_ns, last_ns + RECOVERY * self._spacing_ns)
        self._youngest_ns = age_ns
        self._since_newest += 1

    def renew(self, time_ns: int) -> None:
        """Count from the target of *time_ns*, the newest one now."""
        self.newest_ns, self._since_newest = time_ns, 0

    def _note_gap(self, now_ns: int) -> None:
        """Note how far apart targets arrive; those that come together count as one."""
        gap_ns = now_ns - self._arrived_ns
        self._arrived_ns = now_ns
        if self.newest_ns is None or gap_ns <= 0:
            return
        if now_ns - self.newest_ns > max(PAUSE_NS, SILENT * self._gap_ns + SILENT_NS):
            return
        self._gap_ns = _averaged(self._gap_ns, gap_ns)
        self._longest_gap_ns = max(gap_ns, self._longest_gap_ns - RECOVERY * gap_ns)

    def are_disturbed(self, stale_ns: float) -> bool:
        """Return whether targets come later than their own spacing explains.

        Args:
            stale_ns: how far the newest target lies in the past in this cycle.
        """
        self._stalest_ns = max(self._stalest_ns - RECOVERY * self._period_ns, stale_ns)
        due_ns = max(self._spacing_ns + (self._youngest_ns or 0.0), 0.0)
        return self._stalest_ns > DISTURBED * (due_ns + self._period_ns)

    def have_ceased(self, now_ns: int) -> bool:
        """Whether the next target is overdue."""
        patience_ns = DISTURBED * self._gap_ns + 2.0 * self._period_ns
        if self._longest_gap_ns > patience_ns:
            patience_ns = SILENT * self._gap_ns + SILENT_NS
        return now_ns - self._arrived_ns > patience_ns


def _averaged(usual: float, last: float) -> float:
    """Return what is usual once *last* has come; 0 before there is anything usual."""
    return usual + USUAL * (last - usual) if usual else last
