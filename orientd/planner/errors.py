"""Reasons for a refusal that the planner itself tells apart.

The daemon reads them from its planners, and has no use for NumPy otherwise: it takes 12 MiB.
"""

from __future__ import annotations

from orientd.errors import LimitError, PlanError


class AxisLimitError(LimitError):
    """An axis of the device exceeds a limit: no lower limit of the tool helps."""


class LeadError(PlanError):
    """No lead leads from the state of the device onto a curve, or from its end to rest."""


class TotalError(PlanError):
    """The keyframes take longer than the requested duration.

    Attributes:
        least: their shortest duration, s.
    """

    def __init__(self, total: float, least: float) -> None:
        super().__init__(
            f"the keyframes take at least {least:.6g} s, got a duration of {total:g} s"
        )
        self.least = least
