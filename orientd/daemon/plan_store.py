"""The newest plans, kept for a later move."""

from __future__ import annotations

import threading
from collections import OrderedDict

from orientd.daemon.planners import PlannedMotion
from orientd.errors import UnknownNameError

KEPT_PLANS = 4
"""Plans kept for a later move; each takes as much memory as its request, and up to 14 MB more."""


class PlanStore:
    """Plans by their names, each for one device; the oldest make room for new ones."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._plans: OrderedDict[str, tuple[str, PlannedMotion]] = OrderedDict()

    def keep(self, device: str, motion: PlannedMotion) -> None:
        """Keep *motion*, planned for the device of that name."""
        with self._lock:
            self._plans[motion.id] = (device, motion)
            while len(self._plans) > KEPT_PLANS:
                self._plans.popitem(last=False)

    def find(self, device: str, motion_id: str) -> PlannedMotion:
        """Return a plan that was kept for the device of that name.

        Raises:
            UnknownNameError: there is none of that name, or no longer.
        """
        with self._lock:
            name, motion = self._plans.get(motion_id, ("", None))
        if motion is None or name != device:
            raise UnknownNameError(
                "motion_id", f"device {device!r} has no plan {motion_id!r}, plan it again"
            )
        return motion.again()
