"""The daemon's place in its cell: the gateway process, and the calls that come by it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.daemon.fleet.link import FleetLink

__getattr__ = lazily(__name__)
