"""Cells of daemons over Zenoh: presence, calls, telemetry, one stop for all, one start together."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.fleet.access import nested, router_configuration, zenoh_configuration
    from orientd.fleet.channel import FleetChannel
    from orientd.fleet.client import Fleet, FleetMember, Heard, Stopped, connect_fleet
    from orientd.fleet.clocks import ClockOffset
    from orientd.fleet.frames import LENGTHS, Header, write_frame
    from orientd.fleet.overview import Overview
    from orientd.fleet.plan_file import FleetMotion, read_plan
    from orientd.fleet.recording import FleetRecording
    from orientd.fleet.session import open_session
    from orientd.fleet.together import Together, move_together

__getattr__ = lazily(
    __name__,
    {
        "orientd.fleet.access": (
            "nested",
            "router_configuration",
            "zenoh_configuration",
        ),
        "orientd.fleet.channel": ("FleetChannel",),
        "orientd.fleet.client": (
            "Fleet",
            "FleetMember",
            "Heard",
            "Stopped",
            "connect_fleet",
        ),
        "orientd.fleet.clocks": ("ClockOffset",),
        "orientd.fleet.frames": (
            "LENGTHS",
            "Header",
            "write_frame",
        ),
        "orientd.fleet.overview": ("Overview",),
        "orientd.fleet.plan_file": (
            "FleetMotion",
            "read_plan",
        ),
        "orientd.fleet.recording": ("FleetRecording",),
        "orientd.fleet.session": ("open_session",),
        "orientd.fleet.together": (
            "Together",
            "move_together",
        ),
    },
)
