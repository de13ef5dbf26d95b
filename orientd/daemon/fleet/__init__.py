"""The daemon's place in its cell: the gateway process, and the calls that come by it."""

from __future__ import annotations

from orientd.daemon.fleet.link import FleetLink
