"""Compare all families on the same keyframes: curves, figures, and why a family does not apply.

:func:`measure` computes the figures of a curve: errors, jumps, peaks, effort, length.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

import numpy as np

from orientd.curves.contract import METHODS, Curve
from orientd.curves.roles import CurveTask, make_curve
from orientd.errors import PlanError
from orientd.rotation import Floats, angle

SAMPLES = 1000
"""Times per call when sampling is timed."""

RUNS, PATIENCE = 3, 1.0
"""Number of timed runs, of which the shortest counts; seconds after which no new run starts.

The second run is always made, because the first may load and compile.
"""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)

PARTS = 16
"""Parts of every piece of a curve; the length needs them, because curves may reverse."""

MET = 1e-9
"""Tolerance of a keyframe or a velocity, rad or rad/s."""

JUMP = 1e-6
"""Share of the peak velocity below which a jump is rounding."""

Timer = Callable[[], float]
Watch = Callable[[Sequence[str]], Iterable[str]]
Made = TypeVar("Made")


@dataclass(frozen=True, slots=True)
class Figures:
    """Figures of a curve; integrals leave out jumps of the velocity.

    Attributes:
        keyframe_error: largest angle to a keyframe at its time, rad.
        continuity: continuity of the curve at its knots: 0, 1 or 2.
        velocity_jump: largest jump of the angular velocity at a knot, rad/s.
        acceleration_jump: largest jump of the angular acceleration at a knot, rad/s^2.
        end_velocity_error: largest difference from a requested end velocity, rad/s; ``None`` if
            none is requested.
        peak_velocity: rad/s.
        peak_acceleration: rad/s^2, between the knots.
        effort: integral of the squared angular acceleration, rad^2/s^3.
        torque_effort: integral of the squared torque, N^2 m^2 s; ``None`` without an inertia.
        path_length: integral of the angular velocity, rad.
    """

    keyframe_error: float
    continuity: int
    velocity_jump: float
    acceleration_jump: float
    end_velocity_error: float | None
    peak_velocity: float
    peak_acceleration: float
    effort: float
    torque_effort: float | None
    path_length: float

    @property
    def interpolates(self) -> bool:
        """Whether every keyframe is met."""
        return self.keyframe_error <= MET

    @property
    def has_velocity_jumps(self) -> bool:
        """Whether the velocity jumps at a knot, which would take an infinite acceleration."""
        return self.velocity_jump > JUMP * self.peak_velocity

    @property
    def meets_ends(self) -> bool:
        """Whether every requested end velocity is met; true if none is requested."""
        error = self.end_velocity_error
        return error is None or error <= MET * max(1.0, self.peak_velocity)


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """The result of a family on a task.

    Attributes:
        name: name of the family.
        curve: its curve, on the clock of the task; ``None`` if the family does not apply.
        figures: figures of the curve; ``None`` if the family does not apply.
        why_not: why it does not apply; empty if it does.
        build_time: s.
        sample_time: s for one time among a thousand in one call.
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
    """Return the result of every family on *task*, in the order of *families*.

    Args:
        task: keyframes, times and end velocities.
        inertia: principal moments about the body's axes, kg m^2, shape ``(3,)``.
        options: by family, further keyword arguments.
        families: names of the families.
        timer: returns seconds.
        watch: yields the names in order, each after the previous one is done, to show progress.
    """
    found = []
    for name in watch(list(families)):
        try:
            given = (options or {}).get(name, {})
            curve, build_time = _timed(partial(make_curve, families[name], task, given), timer)
        except (ValueError, PlanError) as error:
            found.append(Candidate(name, why_not=str(error)))
            continue
        figures = measure(curve, task, inertia=inertia)
        instants = np.linspace(*curve.domain, SAMPLES)
        sample_time = _timed(partial(curve.evaluate, instants), timer)[1] / SAMPLES
        found.append(Candidate(name, curve, figures, "", build_time, sample_time))
    return found


def _timed(run: Callable[[], Made], timer: Timer) -> tuple[Made, float]:
    """Return the result of *run*, and the shortest time that it took."""
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
"""Columns by which a comparison can be sorted, smallest first."""

_WITHOUT_JUMPS = ("effort", "torque", "acceleration")


def ranked(candidates: Sequence[Candidate], column: str = "effort") -> list[Candidate]:
    """Return *candidates* with the best of a column first.

    Curves that fulfil the whole task come first.  Next come those that miss a requested end
    velocity, then those that only approximate the keyframes, since both have an easier task.  Last
    are the families that do not apply.  For acceleration, effort and torque, curves with velocity
    jumps, which take an infinite acceleration, come last in their group.

    Raises:
        ValueError: the column does not exist.
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


def measure(curve: Curve, task: CurveTask, *, inertia: Floats | None = None) -> Figures:
    """Return the figures of a curve for a task.

    Integrals use Gauss's rule with ten nodes on each part of a piece of the curve's table.  If a
    derivative jumps at a knot, both sides count.

    Args:
        curve: on the clock of the task.
        task: the task of the curve.
        inertia: principal moments about the body's axes, kg m^2, shape ``(3,)``.
    """
    knots = curve.knots
    inner = knots[1:-1]
    right = curve.evaluate(inner)
    left = curve.evaluate(np.nextafter(inner, -np.inf))
    ends = curve.evaluate(np.array(curve.domain))[1]
    errors = [
        float(np.linalg.norm(found - wanted))
        for found, wanted in zip(ends, task.wanted, strict=True)
        if wanted is not None
    ]
    times, integrals = _integrated(curve, inertia)
    sides = np.concatenate([knots, np.nextafter(inner, -np.inf), times])
    return Figures(
        keyframe_error=float(angle(curve.evaluate(task.times)[0], task.keys).max()),
        continuity=curve.continuity,
        velocity_jump=_largest(right[1] - left[1]),
        acceleration_jump=_largest(right[2] - left[2]),
        end_velocity_error=max(errors) if errors else None,
        peak_velocity=_peak(lambda t: curve.evaluate(t)[1], sides),
        peak_acceleration=_peak(lambda t: curve.evaluate(t)[2], sides),
        path_length=float(integrals[0]),
        effort=float(integrals[1]),
        torque_effort=None if inertia is None else float(integrals[2]),
    )


def _largest(vectors: Floats) -> float:
    return float(np.linalg.norm(vectors, axis=-1).max(initial=0.0))


def _integrated(curve: Curve, inertia: Floats | None) -> tuple[Floats, Floats]:
    """Return the times of the quadrature, and length, effort and squared torque."""
    breaks = curve.trajectory.breaks
    parts = np.repeat(np.diff(breaks) / PARTS, PARTS)[:, None]
    begins = (
        np.repeat(breaks[:-1], PARTS)[:, None]
        + parts * np.tile(np.arange(PARTS), len(breaks) - 1)[:, None]
    )
    times, weights = begins + parts * (0.5 * NODES + 0.5), 0.5 * parts * WEIGHTS
    _, omega, alpha = curve.evaluate(times.ravel())
    moments = np.zeros(3) if inertia is None else inertia
    torque = moments * alpha + np.cross(omega, moments * omega)
    integrands = np.linalg.norm([omega, alpha, torque], axis=-1)
    integrands[1:] **= 2
    return times.ravel(), integrands @ weights.ravel()


def _peak(vectors: Callable[[Floats], Floats], times: Floats) -> float:
    """Return the largest length of *vectors*, refined around the largest sample."""
    ordered = np.unique(times)
    lengths = np.linalg.norm(vectors(ordered), axis=-1)
    place = int(np.argmax(lengths))
    around = ordered[[max(place - 1, 0), min(place + 1, len(ordered) - 1)]]
    closer = np.linspace(around[0], around[1], 257)
    return float(max(lengths[place], np.linalg.norm(vectors(closer), axis=-1).max()))
