"""Every family on the same keyframes: the curves, or why there is none, and their figures."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from orientd.curves.comparison.measure import Figures, measure
from orientd.curves.contract import METHODS, Curve
from orientd.curves.roles import CurveTask, make_curve
from orientd.errors import PlanError
from orientd.rotation import Floats

SAMPLES = 1000
"""Instants at once, by which sampling is timed."""

RUNS = 3
"""The shortest of so many counts."""

PATIENCE = 1.0
"""Seconds after which no further run is made, the first apart, which may load and compile."""

Timer = Callable[[], float]
Watch = Callable[[Sequence[str]], Iterable[str]]
Made = TypeVar("Made")


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A family on a task.

    Attributes:
        name: of the family.
        curve: what it made, on the clock of the task; ``None`` where it does not apply.
        figures: what was measured of it; ``None`` likewise.
        why_not: why it does not apply; empty where it does.
        build_time: s.
        sample_time: s for one instant, among a thousand at once.
    """

    name: str
    curve: Curve | None = None
    figures: Figures | None = None
    why_not: str = ""
    build_time: float = 0.0
    sample_time: float = 0.0


def compare(
    task: CurveTask,
    *,
    inertia: Floats | None = None,
    options: Mapping[str, Mapping[str, Any]] | None = None,
    families: Mapping[str, type[Curve]] = METHODS,
    timer: Timer = time.perf_counter,
    watch: Watch = iter,
) -> list[Candidate]:
    """Return every family on *task*, in the order of *families*.

    Args:
        task: keyframes, times and end velocities.
        inertia: principal moments about the body's axes, kg m^2, shape ``(3,)``.
        options: by family, further keyword arguments.
        families: which.
        timer: tells seconds.
        watch: passes the names on, each when the one before is done, to show how far it is.
    """
    return [
        _tried(name, families[name], task, inertia, (options or {}).get(name, {}), timer)
        for name in watch(list(families))
    ]


def _tried(
    name: str,
    family: type[Curve],
    task: CurveTask,
    inertia: Floats | None,
    options: Mapping[str, Any],
    timer: Timer,
) -> Candidate:
    try:
        curve, build_time = _timed(lambda: make_curve(family, task, options), timer)
    except (ValueError, PlanError) as error:
        return Candidate(name, why_not=str(error))
    figures = measure(curve, task, inertia=inertia)
    instants = np.linspace(*curve.domain, SAMPLES)
    sample_time = _timed(lambda: curve.evaluate(instants), timer)[1] / SAMPLES
    return Candidate(name, curve, figures, "", build_time, sample_time)


def _timed(run: Callable[[], Made], timer: Timer) -> tuple[Made, float]:
    """Return what *run* makes, and the shortest time it took."""
    took: list[float] = []
    while len(took) < 2 or (len(took) < RUNS and sum(took) <= PATIENCE):
        begin = timer()
        made = run()
        took.append(timer() - begin)
    return made, min(took)


Key = Callable[[Candidate, Figures], float]

COLUMNS: Mapping[str, Key] = {
    "effort": lambda _, figures: figures.effort,
    "torque": lambda _, figures: figures.torque_effort or 0.0,
    "acceleration": lambda _, figures: figures.peak_acceleration,
    "velocity": lambda _, figures: figures.peak_velocity,
    "length": lambda _, figures: figures.path_length,
    "continuity": lambda _, figures: -figures.continuity,
    "keyframes": lambda _, figures: figures.keyframe_error,
    "ends": lambda _, figures: figures.end_velocity_error or 0.0,
    "build": lambda candidate, _: candidate.build_time,
    "sample": lambda candidate, _: candidate.sample_time,
}
"""By what a comparison can be sorted, smallest first."""

_WITHOUT_JUMPS = ("effort", "torque", "acceleration")


def ranked(candidates: Sequence[Candidate], column: str = "effort") -> list[Candidate]:
    """Return *candidates* with the best of a column first.

    Curves that do the whole task come first, then those that miss a velocity wanted at an end, then
    those that only approach the keyframes (both have an easier life), last the families that do not
    apply.  For acceleration, effort and torque a curve whose velocity jumps, which takes an
    infinite acceleration, comes after those of its kind whose does not.

    Raises:
        ValueError: there is no such column.
    """
    if column != "name" and column not in COLUMNS:
        raise ValueError(f"column must be one of name, {', '.join(COLUMNS)}, got {column!r}")

    def order(candidate: Candidate) -> tuple[int, bool, float, str]:
        figures = candidate.figures
        if column == "name":
            return 0, False, 0.0, candidate.name
        if figures is None:
            return 3, False, 0.0, candidate.name
        is_infinite = column in _WITHOUT_JUMPS and figures.has_velocity_jumps
        value = COLUMNS[column](candidate, figures)
        kind = 2 if not figures.interpolates else int(not figures.meets_ends)
        return kind, is_infinite, value, candidate.name

    return sorted(candidates, key=order)
