"""Stops that take a way of their own, which nothing else of the daemon can block."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.daemon.stops.way import StopWay

__getattr__ = lazily(__name__)
