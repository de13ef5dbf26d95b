"""Pictures of curves and motions, by Matplotlib (extra ``plot``), as PNG, SVG or PDF."""

from orientd.plots.charts import Traces
from orientd.plots.figures import FIGURES, draw_figure
from orientd.plots.gallery import draw_family, draw_gallery
from orientd.plots.motion import draw_motion, draw_sent, draw_traces
from orientd.plots.notebook import draw_alone, png_of
from orientd.plots.paper import check_format, is_available
from orientd.plots.parts import draw_bodies_alone, draw_rates_alone, draw_triads_alone
from orientd.plots.punctuality import Timing
from orientd.plots.recording import Strands, draw_recording
from orientd.plots.sampling import traces_of
from orientd.plots.sheet import draw_sheet

__all__ = [
    "FIGURES",
    "Strands",
    "Timing",
    "Traces",
    "check_format",
    "draw_alone",
    "draw_bodies_alone",
    "draw_family",
    "draw_figure",
    "draw_gallery",
    "draw_motion",
    "draw_rates_alone",
    "draw_recording",
    "draw_sent",
    "draw_sheet",
    "draw_traces",
    "draw_triads_alone",
    "is_available",
    "png_of",
    "traces_of",
]
