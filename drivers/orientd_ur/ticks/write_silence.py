"""For how long nothing was written to the robot: what its watchdog ends the program for."""

from __future__ import annotations

_RECENT_NS = 100_000_000
_NEARLY = 0.95


class WriteSilence:
    """The last long pause between two setpoints.

    Args:
        watchdog_hz: how often the robot is to hear.
    """

    def __init__(self, watchdog_hz: float) -> None:
        self._allowed_ns = round(1e9 / watchdog_hz)
        self._written_ns = self._pause_ns = self._ended_ns = 0

    def begin(self, now_ns: int) -> None:
        """Count from now."""
        self._written_ns, self._pause_ns = now_ns, 0

    def note(self, now_ns: int) -> None:
        """Note that a setpoint is written now."""
        self._look(now_ns)
        self._written_ns = now_ns

    def reason(self, now_ns: int) -> str:
        """Return that the robot's watchdog has ended the program, where it has reason to."""
        self._look(now_ns)
        if not self._pause_ns or now_ns - self._ended_ns > _RECENT_NS:
            return ""
        return (
            f"the robot's watchdog ended the control program: nothing was written for "
            f"{self._pause_ns * 1e-6:.0f} ms, {self._allowed_ns * 1e-6:.0f} ms are allowed "
            "(`watchdog_hz`); this machine was too busy, or the process stood still; reset to "
            "start the program again"
        )

    def _look(self, now_ns: int) -> None:
        pause_ns = now_ns - self._written_ns
        if pause_ns > _NEARLY * self._allowed_ns:
            self._pause_ns, self._ended_ns = pause_ns, now_ns
