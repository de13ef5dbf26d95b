"""Directions that an axis of the tool keeps away from, and the shortest ways around them.

Planner and servo use the same values, so they hold plain floats.  Both import from ``tangents``.
"""

from orientd.keep_out.cone import MOST_CONES, KeepOut
