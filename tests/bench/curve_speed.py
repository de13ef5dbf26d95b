"""Speed of the default curve, sampled, against SciPy's RotationSpline.

Times are thread CPU times.  Both take turns in the same run, under the same conditions, and each
result is a median.  Only the ratios carry over to another machine.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RotationSpline

from orientd.curves.interpolating import C2Cumulative
from orientd.rotation import Floats, exp, multiply, normalize, to_scipy

KEYFRAMES = 100
STEP = 0.6
"""Turn from each keyframe to the next, in rad."""

_ROUNDS = 11
_SLICE = 0.02
"""Approximate duration of each measurement, in seconds."""


@dataclass(frozen=True, slots=True)
class Sampling:
    """Orientation, velocity and acceleration, in ns per time.

    Attributes:
        instants: number of times in a call.
        sorted_ns: by :meth:`Curve.evaluate`, at increasing times.
        unsorted_ns: at the same times in a random order.
        scipy_ns: by SciPy's RotationSpline through the same keyframes, at increasing times.
    """

    instants: int
    sorted_ns: float
    unsorted_ns: float
    scipy_ns: float

    @property
    def ratio(self) -> float:
        """How many times as fast as scipy it is."""
        return self.scipy_ns / self.sorted_ns


def random_walk(count: int, step: float) -> Floats:
    """Return keyframes a turn of *step* rad apart, about random axes, shape ``(count, 4)``."""
    rng = np.random.default_rng(0)
    turns = rng.normal(size=(count - 1, 3))
    turns *= step / np.linalg.norm(turns, axis=1)[:, None]
    keys: Floats = np.zeros((count, 4))
    keys[0, 0] = 1.0
    keys[1:] = exp(turns)
    # Products of all leading keyframes, in a logarithmic number of passes.
    reach = 1
    while reach < count:
        keys[reach:] = normalize(multiply(keys[:-reach], keys[reach:]))
        reach *= 2
    return keys


def measure_sampling(count: int) -> Sampling:
    """Measure the sampling of the default curve at *count* times in a call; return the medians."""
    keys = random_walk(KEYFRAMES, STEP)
    times = np.cumsum(np.random.default_rng(1).uniform(0.7, 1.3, KEYFRAMES))
    at = np.linspace(times[0], times[-1], count + 2)[1:-1]
    shuffled = np.random.default_rng(2).permutation(at)
    curve = C2Cumulative(keys=keys, times=times)
    peer = RotationSpline(times, to_scipy(keys))
    # Many samples are written to existing memory, a single one to new memory, as users do.
    out: Floats | None = np.empty((10, count)) if count > 1 else None
    calls: dict[str, Callable[[], object]] = {
        "scipy": lambda: (peer(at).as_quat(), peer(at, 1), peer(at, 2)),
        "sorted": lambda: curve.evaluate(at, out=out),
        "unsorted": lambda: curve.evaluate(shuffled, out=out),
    }
    found = {name: value / count for name, value in _interleaved(calls).items()}
    return Sampling(count, found["sorted"], found["unsorted"], found["scipy"])


def _interleaved(calls: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Return the median thread CPU time of each call, in ns, taken in turns."""
    repeats = {}
    for name, call in calls.items():
        call()
        repeats[name] = max(1, round(_SLICE / max(_cpu_time(call, 1) * 1e-9, 1e-7)))
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(_ROUNDS):
        for name, call in calls.items():
            taken[name].append(_cpu_time(call, repeats[name]))
    return {name: statistics.median(values) for name, values in taken.items()}


def _cpu_time(call: Callable[[], object], repeats: int) -> float:
    began = time.thread_time_ns()
    for _ in range(repeats):
        call()
    return (time.thread_time_ns() - began) / repeats
