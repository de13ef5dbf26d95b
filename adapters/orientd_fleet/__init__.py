"""Cells of daemons over Zenoh: presence, states, one stop for all, one start together.

For programs that read the table ``[fleet]``: ``settings``.  For those that join a cell: ``access``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd_fleet.client import Fleet, Stopped, connect_fleet, daemon_address
    from orientd_fleet.together import FleetMotion, Together, move_together, read_plan

__getattr__ = lazily(
    __name__,
    {
        "orientd_fleet.client": ("Fleet", "Stopped", "connect_fleet", "daemon_address"),
        "orientd_fleet.together": ("FleetMotion", "Together", "move_together", "read_plan"),
    },
)
