"""Pictures of curves and motions, by Matplotlib (extra ``plot``), as PNG, SVG or PDF.

Start with :func:`draw`.  Programs that draw charts of their own also use the modules ``paper``,
``view``, ``triads``, ``bodies`` and ``sampling``.
"""

from __future__ import annotations

from orientd.plots.charts import Traces
from orientd.plots.motion import Picture, draw, draw_sent, draw_traces, picture
from orientd.plots.paper import check_format, is_available
from orientd.plots.parts import draw_part
from orientd.plots.punctuality import Timing
from orientd.plots.recording import draw_orientations, draw_recording
from orientd.plots.sampling import traces_of
from orientd.plots.sheet import draw_sheet
