"""Pictures of a curve or a motion by itself: to a file, or into a notebook."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from orientd.curves import Curve, CurveTask, check_keys, resolve_times
from orientd.errors import OrientdError
from orientd.plots.charts import Traces
from orientd.plots.motion import draw_traces, figure_of, traces_of_motion
from orientd.plots.paper import write_png
from orientd.plots.sampling import traces_of
from orientd.rotation import align

if TYPE_CHECKING:
    from orientd.planner import Motion

_DPI = 80


def draw_alone(path: str | Path, shown: Curve | Motion, *, title: str = "") -> None:
    """Draw a curve, or a motion, to *path*, whose ending names the format.

    Raises:
        OrientdError: the file cannot be written, its ending names no format of a picture, or
            Matplotlib is not installed.
    """
    draw_traces(Path(path), _traces(shown), title=title or _title(shown))


def png_of(shown: Curve | Motion) -> bytes | None:
    """Return the picture for a notebook; ``None`` where Matplotlib is not installed."""
    try:
        figure = figure_of(_traces(shown), title=_title(shown))
    except OrientdError:
        return None
    picture = BytesIO()
    write_png(figure, picture, dpi=_DPI)
    return picture.getvalue()


def _traces(shown: Curve | Motion) -> Traces:
    if isinstance(shown, Curve):
        return traces_of(shown, _task(shown))
    return traces_of_motion(shown)


def _title(shown: Curve | Motion) -> str:
    if isinstance(shown, Curve):
        return getattr(shown, "name", type(shown).__name__)
    return f"{shown.request.method}: motion {shown.id}"


def _task(curve: Curve) -> CurveTask:
    """Return the keyframes that a curve was made of, or its ends where it knows none."""
    made = curve.made_of
    if "keys" in made:
        keys = check_keys(made["keys"])
        if made.get("align", True):
            keys = align(keys)
        return CurveTask(keys, resolve_times(made.get("times"), keys, made.get("turns")))
    if "control" in made:
        keys = check_keys(made["control"])
        return CurveTask(keys, np.linspace(*curve.domain, len(keys)))
    ends = np.array(curve.domain)
    return CurveTask(curve.evaluate(ends)[0], ends)
