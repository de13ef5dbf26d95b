"""Latency compensation: setpoints lead a device that is behind them by a known time.

What is sent is the path a lead ahead of the path time that is reported, so that the device is where
the plan says for that time.  Path time begins when the device does: the first record is sent a lead
before it, and the device holds on the last record for the lead after.  Along the path this is a
shift in time and nothing else, so derivatives, limits, guard and stops are those of what is sent.
"""

from __future__ import annotations

import numpy as np

from orientd import rotation
from orientd.recorder import Table
from orientd.rotation import Floats
from orientd.stream import CycleFlag

_OLDEST_FEEDBACK_NS = 2_000_000_000


class LedSetpoints:
    """The setpoints of the recent past, to compare feedback with those sent a lead before it."""

    def __init__(self, lead: float, held: Floats) -> None:
        """Expect feedback *lead* seconds after its setpoint; *held* is sent before the first."""
        self._lead_ns = round(lead * 1e9)
        self._held = np.asarray(held, dtype=np.float64)
        self._times_ns = np.zeros(0, dtype=np.int64)
        self._q = np.zeros((0, 4))

    def gaps(self, cycles: Table) -> Floats:
        """Return the angles between the feedback of further *cycles* and what was to be, rad.

        Args:
            cycles: in order, each with feedback or without; those without have a gap of 0.
        """
        if not len(self._times_ns):
            self._times_ns = cycles["deadline_ns"][:1] - 1
            self._q = self._held[None]
        self._times_ns = np.concatenate([self._times_ns, cycles["deadline_ns"]])
        self._q = np.concatenate([self._q, cycles["sent_q"]])
        times_ns, q = self._times_ns, self._q
        wanted_ns = cycles["feedback_time_ns"] - self._lead_ns
        after = np.clip(np.searchsorted(times_ns, wanted_ns), 1, len(times_ns) - 1)
        before_ns = times_ns[after - 1]
        share = (wanted_ns - before_ns) / np.maximum(times_ns[after] - before_ns, 1)
        expected = rotation.slerp(q[after - 1], q[after], np.clip(share, 0.0, 1.0))
        gaps = rotation.angle(expected, cycles["measured_q"])
        is_kept = times_ns > times_ns[-1] - self._lead_ns - _OLDEST_FEEDBACK_NS
        self._times_ns, self._q = times_ns[is_kept], q[is_kept]
        return np.where(cycles["flags"] & CycleFlag.FEEDBACK, gaps, 0.0)
