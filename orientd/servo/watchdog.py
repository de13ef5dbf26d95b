"""The watchdog: silence of the daemon or the device, and stalls of the servo itself.

A stall is a time in which the servo's own process does not run, because the machine is overloaded
or a call of the driver is slow.  The servo then hears nothing, but the others are not at fault.
Path time does not pass in a stall, so the device never jumps.  But the device has come to rest at
the last setpoint, and resuming at the old speed would be a velocity step.  So the motion resumes
from rest, within the limits.  After a longer stall it does not resume by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

from orientd.driver import FUTURE_NS

SHORTEST_NS = 50_000_000
"""A device's own control smooths shorter gaps between cycles."""

FEWEST_PERIODS = 3
"""Nor is it a stall if the device's own answers take a cycle or two."""


@dataclass(frozen=True, slots=True)
class WatchdogTimeouts:
    """The timeouts of the servo.

    Attributes:
        heartbeat_ns: longest silence of the daemon while something moves.
        feedback_ns: largest age of the device's feedback.
        stall_ns: longest stall after which a motion resumes by itself.
    """

    heartbeat_ns: int
    feedback_ns: int
    stall_ns: int = 500_000_000


class ServoWatchdog:
    """Silences, minus the stalls of this process."""

    def __init__(self, watch: WatchdogTimeouts, period_ns: int) -> None:
        """Use the timeouts of *watch*; expect a cycle every *period_ns*."""
        self._heartbeat_ns, self._feedback_ns = watch.heartbeat_ns, watch.feedback_ns
        self._period_ns = period_ns
        self._deadline_ns = 0
        self._stall_ns = 0
        self._stall_end_ns = 0

    def notice(self, deadline_ns: int, heartbeat_ns: int, measured_ns: int) -> bool:
        """Record the deadlines missed before this one; return whether something may be wrong.

        *measured_ns* is the time of the newest feedback, 0 without any.
        """
        missed_ns = deadline_ns - self._deadline_ns - self._period_ns
        if missed_ns > self._period_ns // 2 and self._deadline_ns:
            if not measured_ns or measured_ns >= self._stall_end_ns:
                self._stall_ns = 0
            self._stall_ns += missed_ns
            self._stall_end_ns = deadline_ns
        self._deadline_ns = deadline_ns
        return (
            deadline_ns - heartbeat_ns > self._heartbeat_ns
            or deadline_ns - measured_ns > self._feedback_ns
            or heartbeat_ns - deadline_ns > FUTURE_NS
        )

    def complain_of_daemon(self, heartbeat_ns: int, now_ns: int) -> str:
        """Return what is wrong with the daemon's heartbeat, or an empty string."""
        if heartbeat_ns - now_ns > FUTURE_NS:
            return "a heartbeat of the daemon from the future"
        silence_ns = self._silence_ns(heartbeat_ns, now_ns)
        if silence_ns <= self._heartbeat_ns:
            return ""
        return f"no heartbeat from the daemon for {silence_ns * 1e-9:.3f} s"

    def complain_of_device(self, measured_ns: int, now_ns: int) -> str:
        """Return what is wrong with the age of the feedback, or an empty string."""
        age_ns = self._silence_ns(measured_ns, now_ns)
        if age_ns <= self._feedback_ns:
            return ""
        return (
            f"feedback is {age_ns * 1e-6:.1f} ms old, "
            f"at most {self._feedback_ns * 1e-6:.1f} ms are allowed"
        )

    def _silence_ns(self, heard_ns: int, now_ns: int) -> int:
        silence_ns = now_ns - heard_ns
        return silence_ns - self._stall_ns if heard_ns < self._stall_end_ns else silence_ns


def longest_gap_ns(period_ns: int) -> int:
    """Return the time between two cycles above which the process has stalled, ns."""
    return max(SHORTEST_NS, FEWEST_PERIODS * period_ns)
