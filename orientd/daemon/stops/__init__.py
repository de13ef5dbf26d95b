"""Stops that take a way of their own, which nothing else of the daemon can block."""

from __future__ import annotations

from orientd.daemon.stops.way import StopWay
