"""What keyframes mean once it is known where the device is."""

from __future__ import annotations

from orientd.planner.keyframes.pointing import with_least_roll
from orientd.planner.keyframes.winding import wound

__all__ = ["with_least_roll", "wound"]
