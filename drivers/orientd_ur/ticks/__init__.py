"""The controller's clock and cycle in terms of ours: when its packages come, when to send."""

from __future__ import annotations

from orientd_ur.ticks.controller_clock import ControllerClock
from orientd_ur.ticks.tick_listener import TickListener
from orientd_ur.ticks.tick_phase import TickPhase, tick_ns
from orientd_ur.ticks.write_silence import WriteSilence
