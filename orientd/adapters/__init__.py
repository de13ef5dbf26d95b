"""Adapters: servers through which programs of other protocols command a device of a daemon."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.adapters.alpaca import Alpaca
    from orientd.adapters.alpaca_mount import Mount, Rotator
    from orientd.adapters.alpaca_telescope import Telescope
    from orientd.adapters.bluesky import RotationAxis
    from orientd.adapters.bluesky_values import FlyScan, MotionStatus
    from orientd.adapters.equatorial import Place
    from orientd.adapters.mavlink import Mavlink
    from orientd.adapters.pointing import Direction, direction, orientation
    from orientd.adapters.rotctld import Ranges, Rotctld
    from orientd.adapters.served import Adapter, Served
    from orientd.adapters.sky import from_elements, from_table, observer_of

__getattr__ = lazily(
    __name__,
    {
        "orientd.adapters.alpaca": ("Alpaca",),
        "orientd.adapters.alpaca_mount": ("Mount", "Rotator"),
        "orientd.adapters.alpaca_telescope": ("Telescope",),
        "orientd.adapters.bluesky": ("RotationAxis",),
        "orientd.adapters.bluesky_values": ("FlyScan", "MotionStatus"),
        "orientd.adapters.equatorial": ("Place",),
        "orientd.adapters.mavlink": ("Mavlink",),
        "orientd.adapters.pointing": ("Direction", "direction", "orientation"),
        "orientd.adapters.rotctld": ("Ranges", "Rotctld"),
        "orientd.adapters.served": ("Adapter", "Served"),
        "orientd.adapters.sky": ("from_elements", "from_table", "observer_of"),
    },
)
