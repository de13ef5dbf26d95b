"""The picture of a recording: what was planned, sent and measured over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from orientd import rotation
from orientd.errors import OrientdError
from orientd.plots.charts import MOST_POINTS
from orientd.plots.paper import AXES, INK, LIMIT, QUIET, check_format, new_figure, save, tidy
from orientd.rotation import Floats
from orientd.stream.records import CycleFlag

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLANNED = "#c4c4c4"
_LABELS = {
    "orientation": "rotation vector, rad",
    "velocity": "angular velocity, rad/s",
    "deviation": "deviation, mrad",
    "lateness": "lateness, ms",
}
"""Label of each chart, from the top down."""
_NAME_WIDTH = 0.012
"""Width of the name of an event, as a share of the chart's."""

_LEAST = 1e-6  # rad and ms; what is less is drawn as this much


def draw_recording(
    path: Path,
    cycles: NDArray[np.void],
    planned_q: Floats,
    *,
    period: float,
    marks: Sequence[tuple[int, str]],
    title: str,
) -> None:
    """Draw a recording to *path*: orientation, angular velocity, deviations, lateness.

    Planned is a broad grey line, sent a thin one in the colour of its axis, measured dots in that
    colour, at the times at which it was measured.  Orientations are rotation vectors from the first
    one sent, carried on past half a turn.

    Args:
        path: of the picture.
        cycles: of a device, with the columns of a recording, shape ``(n,)``.
        planned_q: orientations ``(w, x, y, z)``, NaN if no motion runs, shape ``(n, 4)``.
        period: of a cycle, s.
        marks: instants of events, ns on the clock of the cycles, and their names.
        title: above it.

    Raises:
        OrientdError: the file cannot be written, or its ending names no format of a picture.
    """
    check_format(path)
    figure = new_figure(12.0, 10.0, title)
    charts: dict[str, Axes] = figure.subplot_mosaic(
        [[name] for name in _LABELS], sharex=True, height_ratios=[1.5, 1.2, 0.9, 0.7]
    )
    for name, label in _LABELS.items():
        tidy(charts[name], label)
    begin = int(cycles["deadline_ns"][0]) if len(cycles) else 0
    times = (cycles["deadline_ns"] - begin) * 1e-9
    told = cycles[(cycles["flags"] & CycleFlag.FEEDBACK) != 0]
    measured_times = (told["feedback_time_ns"] - begin) * 1e-9
    origin = cycles["sent_q"][:1]
    sent = _unwound(_vectors(cycles["sent_q"], origin))
    # The same branch as what was sent, whatever the sign of a quaternion.
    later = np.clip(np.searchsorted(times, measured_times), 0, len(times) - 1)
    measured = _near(_vectors(told["measured_q"], origin), sent[later])
    _draw_planned(charts["orientation"], times, _near(_vectors(planned_q, origin), sent))
    _draw_components(charts["orientation"], times, sent, " sent")
    _draw_dots(charts["orientation"], measured_times, measured)
    _legend(charts["orientation"])
    _draw_components(charts["velocity"], times, cycles["sent_omega_body"])
    _draw_dots(charts["velocity"], measured_times, told["measured_omega_body"])
    _draw_deviation(charts["deviation"], times, cycles, planned_q, measured_times, told)
    _draw_lateness(charts["lateness"], times, cycles["lateness_ns"] * 1e-9, period)
    instants = [((time_ns - begin) * 1e-9, name) for time_ns, name in marks]
    for name, axes in charts.items():
        span = float(times[-1] - times[0]) if len(times) else 1.0
        _mark(axes, instants, span, is_named=name == "orientation")
    charts["lateness"].set_xlabel("time, s", fontsize=9)
    if len(times):
        charts["lateness"].set_xlim(times[0], times[-1])
    save(figure, path)


def draw_orientations(path: Path, times: Floats, q: Floats, *, title: str) -> None:
    """Draw orientations as they were recorded to *path*, and the angular velocity between them.

    Orientations are rotation vectors from the first one, carried on past half a turn.

    Args:
        path: of the picture.
        times: s, shape ``(n,)``; samples whose time is not a number are left out.
        q: orientations ``(w, x, y, z)``, shape ``(n, 4)``; as are those that are not numbers.
        title: above it.

    Raises:
        OrientdError: the file cannot be written, its ending names no format of a picture, or there
            are fewer than two samples to draw.
    """
    check_format(path)
    is_known = np.isfinite(times) & np.isfinite(q).all(axis=1)
    times, first = np.unique(times[is_known], return_index=True)
    q = rotation.align(q[is_known][first])
    if len(times) < 2:
        raise OrientdError(f"at least 2 samples are drawn, got {len(times)}")
    figure = new_figure(12.0, 6.0, title)
    charts: dict[str, Axes] = figure.subplot_mosaic(
        [["orientation"], ["velocity"]], sharex=True, height_ratios=[1.5, 1.2]
    )
    for name, axes in charts.items():
        tidy(axes, _LABELS[name])
    vectors = _unwound(_vectors(q, q[:1]))
    steps = rotation.log(rotation.multiply(rotation.conjugate(q[:-1]), q[1:]))
    rates, middles = steps / np.diff(times)[:, None], 0.5 * (times[:-1] + times[1:])
    _draw_components(charts["orientation"], times, vectors)
    _draw_components(charts["velocity"], middles, rates)
    _legend(charts["orientation"])
    charts["velocity"].set_xlabel("time, s", fontsize=9)
    charts["velocity"].set_xlim(times[0], times[-1])
    save(figure, path)


def _draw_planned(axes: Axes, times: Floats, vectors: Floats) -> None:
    every = _every(times)
    lines = axes.plot(
        times[every], vectors[every], color=PLANNED, linewidth=5.0, zorder=1.5,
        solid_capstyle="butt",
    )  # fmt: skip
    lines[0].set_label("planned")


def _draw_components(axes: Axes, times: Floats, vectors: Floats, what: str = "") -> None:
    every = _every(times)
    for k, axis in enumerate(AXES):
        axes.plot(
            times[every], vectors[every, k], color=axis.colour, linewidth=1.4,
            label=f"{axis.name}{what}", zorder=2.0,
        )  # fmt: skip


def _draw_dots(axes: Axes, times: Floats, vectors: Floats) -> None:
    step = max(1, len(times) // 150)
    for k, axis in enumerate(AXES):
        axes.plot(
            times[::step], vectors[::step, k], linestyle="none", marker="o", markersize=3.2,
            markerfacecolor="none", markeredgecolor=axis.colour, markeredgewidth=0.8,
            label=f"{axis.name} measured", zorder=2.5,
        )  # fmt: skip


def _draw_deviation(
    axes: Axes,
    times: Floats,
    cycles: NDArray[np.void],
    planned_q: Floats,
    measured_times: Floats,
    told: NDArray[np.void],
) -> None:
    off_plan = 1e3 * rotation.angle(planned_q, cycles["sent_q"])
    error = 1e3 * rotation.angle(told["sent_q"], told["measured_q"])
    every, few = _every(times), _every(measured_times)
    axes.plot(
        times[every], np.maximum(off_plan, 1e3 * _LEAST)[every], color=QUIET, linewidth=1.3,
        label="planned to sent",
    )  # fmt: skip
    axes.plot(
        measured_times[few], np.maximum(error, 1e3 * _LEAST)[few], color=INK, linewidth=1.0,
        label="sent to measured, of the same cycle",
    )  # fmt: skip
    axes.set_yscale("log")
    _legend(axes)


def _draw_lateness(axes: Axes, times: Floats, lateness: Floats, period: float) -> None:
    every = _every(times)
    late = np.maximum(1e3 * lateness, 1e-3)
    axes.scatter(times[every], late[every], s=2, color=AXES[2].colour, linewidth=0)
    axes.axhline(500.0 * period, color=LIMIT, linewidth=1.0, linestyle=":")
    axes.set_yscale("log")


def _mark(axes: Axes, marks: Sequence[tuple[float, str]], span: float, *, is_named: bool) -> None:
    written = -np.inf
    for time, name in marks:
        colour = LIMIT if name.isupper() else QUIET
        axes.axvline(time, color=colour, linewidth=0.8, linestyle=":")
        if is_named:
            # Names of one moment stand side by side; the last ones would be cut off at the right.
            written = max(time, written + _NAME_WIDTH * span)
            axes.annotate(
                name, (written, 0.99), xycoords=("data", "axes fraction"), xytext=(2, 0),
                textcoords="offset points", ha="left", va="top", fontsize=7.5, rotation=90,
                color=colour, annotation_clip=False,
            )  # fmt: skip


def _legend(axes: Axes) -> None:
    axes.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=7, frameon=False, fontsize=8.5,
        borderaxespad=0.1,
    )  # fmt: skip


def _every(times: Floats) -> slice:
    return slice(None, None, max(1, len(times) // MOST_POINTS))


def _vectors(q: Floats, origin: Floats) -> Floats:
    return rotation.log(rotation.multiply(rotation.conjugate(origin), q))


def _unwound(vectors: Floats) -> Floats:
    """Return rotation vectors without jumps: each one of those that mean the same turn."""
    result = vectors.copy()
    for k in range(1, len(result)):
        if np.sum((result[k] - result[k - 1]) ** 2) > 1.0:
            result[k] = _nearest(result[k], result[k - 1])
    return result


def _near(vectors: Floats, guides: Floats) -> Floats:
    result = vectors.copy()
    away = np.sum((vectors - guides) ** 2, axis=-1) > 1.0
    for k in np.flatnonzero(away):
        result[k] = _nearest(vectors[k], guides[k])
    return result


def _nearest(vector: Floats, guide: Floats) -> Floats:
    length = float(np.sqrt(np.sum(vector**2)))
    if length < 1e-9:
        return vector
    axis = vector / length
    turns = np.rint((float(axis @ guide) - length) / (2.0 * np.pi))
    nearest: Floats = vector + 2.0 * np.pi * turns * axis
    return nearest
