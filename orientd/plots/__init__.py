"""Pictures of curves and motions, by Matplotlib (extra ``plot``), as PNG, SVG or PDF."""

from orientd.plots.charts import Traces
from orientd.plots.motion import draw_motion, draw_sent, draw_traces
from orientd.plots.paper import check_format, is_available
from orientd.plots.punctuality import Timing
from orientd.plots.sheet import draw_sheet

__all__ = [
    "Timing",
    "Traces",
    "check_format",
    "draw_motion",
    "draw_sent",
    "draw_sheet",
    "draw_traces",
    "is_available",
]
