"""Cells of daemons over Zenoh: presence, states, one stop for all, one start together."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.fleet.access import address_of, member_configuration, router_configuration
    from orientd.fleet.client import Fleet, Stopped, connect_fleet, daemon_address
    from orientd.fleet.clocks import ClockOffset
    from orientd.fleet.keys import PACKET_BYTES, TIME_BYTES
    from orientd.fleet.overview import Overview
    from orientd.fleet.plan_file import FleetMotion, read_plan
    from orientd.fleet.recording import FleetRecording
    from orientd.fleet.session import open_session
    from orientd.fleet.together import Together, move_together

__getattr__ = lazily(
    __name__,
    {
        "orientd.fleet.access": ("address_of", "member_configuration", "router_configuration"),
        "orientd.fleet.client": ("Fleet", "Stopped", "connect_fleet", "daemon_address"),
        "orientd.fleet.clocks": ("ClockOffset",),
        "orientd.fleet.keys": ("PACKET_BYTES", "TIME_BYTES"),
        "orientd.fleet.overview": ("Overview",),
        "orientd.fleet.plan_file": ("FleetMotion", "read_plan"),
        "orientd.fleet.recording": ("FleetRecording",),
        "orientd.fleet.session": ("open_session",),
        "orientd.fleet.together": ("Together", "move_together"),
    },
)
