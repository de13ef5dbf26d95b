"""Stalls: the servo's own process did not run for a while, and nothing was sent.

Path time does not pass then, so that the device never jumps; but it has come to rest at the last
setpoint, and to go on at the old speed would be a step in velocity.  So motion goes on from rest,
inside the limits; after a longer stall not by itself.
"""

from __future__ import annotations

SHORTEST_NS = 50_000_000
"""Shorter gaps a device rides out: its own control smooths them."""

FEWEST_PERIODS = 3
"""Nor is it a stall when the device's own answers take a cycle or two."""


class Stalls:
    """What is a stall, and what to say of it.

    Attributes:
        shortest_ns: time from one cycle to the next above which it is one.
    """

    def __init__(self, period_ns: int, longest_ns: int) -> None:
        """Expect a cycle every *period_ns*; see :class:`.WatchdogTimeouts`."""
        self.shortest_ns = max(SHORTEST_NS, FEWEST_PERIODS * period_ns)
        self._longest_ns = longest_ns

    def complain(self, stall_ns: int) -> str:
        """Return what is wrong with a stall, or nothing where motion may go on by itself."""
        if stall_ns <= self._longest_ns:
            return ""
        return (
            f"the servo process did not run for {stall_ns * 1e-9:.3f} s, at most "
            f"{self._longest_ns * 1e-9:g} s are allowed in motion"
        )
