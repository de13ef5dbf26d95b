"""A MAVLink gimbal, device and manager, over UDP."""

from __future__ import annotations

from orientd.adapters.mavlink.server import Mavlink
