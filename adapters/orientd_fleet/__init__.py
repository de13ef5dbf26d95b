"""Cells of daemons over Zenoh: presence, states, one stop for all, one start together.

For programs that read the table ``[fleet]``: ``settings``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd_fleet.access import address_of, member_configuration, router_configuration
    from orientd_fleet.client import Fleet, Stopped, connect_fleet, daemon_address
    from orientd_fleet.clocks import ClockOffset
    from orientd_fleet.overview import Overview
    from orientd_fleet.plan_file import FleetMotion, read_plan
    from orientd_fleet.recording import FleetRecording
    from orientd_fleet.session import open_session
    from orientd_fleet.together import Together, move_together

__getattr__ = lazily(
    __name__,
    {
        "orientd_fleet.access": ("address_of", "member_configuration", "router_configuration"),
        "orientd_fleet.client": ("Fleet", "Stopped", "connect_fleet", "daemon_address"),
        "orientd_fleet.clocks": ("ClockOffset",),
        "orientd_fleet.overview": ("Overview",),
        "orientd_fleet.plan_file": ("FleetMotion", "read_plan"),
        "orientd_fleet.recording": ("FleetRecording",),
        "orientd_fleet.session": ("open_session",),
        "orientd_fleet.together": ("Together", "move_together"),
    },
)
