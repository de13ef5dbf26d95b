"""Keep-out cones: certify the clearance of motions, and lead motions around."""

from __future__ import annotations

from orientd.planner.keep_out.around import Around, Planning
from orientd.planner.keep_out.clearance import Cones
