"""What keyframes mean once it is known where the device is."""

from __future__ import annotations

from orientd.planner.keyframes.half_turns import half_turn_notes
from orientd.planner.keyframes.placing import in_device_coordinates, report_frame, with_frames
from orientd.planner.keyframes.pointing import with_least_roll
from orientd.planner.keyframes.turning import at_rate
from orientd.planner.keyframes.winding import wound
