"""Adapters: servers through which programs of other protocols command a device of a daemon."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.adapters.bluesky import FlyScan, MotionStatus, RotationAxis
    from orientd.adapters.mavlink import Mavlink
    from orientd.adapters.pointing import Direction, direction, orientation
    from orientd.adapters.rotctld import Ranges, Rotctld
    from orientd.adapters.served import Adapter, Served
    from orientd.adapters.sky import from_elements, from_table, observer_of

__getattr__ = lazily(
    __name__,
    {
        "orientd.adapters.bluesky": ("FlyScan", "MotionStatus", "RotationAxis"),
        "orientd.adapters.mavlink": ("Mavlink",),
        "orientd.adapters.pointing": ("Direction", "direction", "orientation"),
        "orientd.adapters.rotctld": ("Ranges", "Rotctld"),
        "orientd.adapters.served": ("Adapter", "Served"),
        "orientd.adapters.sky": ("from_elements", "from_table", "observer_of"),
    },
)
