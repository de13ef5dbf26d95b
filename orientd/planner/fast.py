"""When the compiled kernels of the planner may be used: loaded in the background after the curves'.

As long as they are not there, and where Numba is not, NumPy serves; see
:mod:`orientd.curves.fast`.
"""

from __future__ import annotations

from collections.abc import Callable

from orientd.curves import fast
from orientd.curves.basis import Indices
from orientd.rotation import Floats

Extremes = Callable[
    [
        Floats, int, bool, float, float, Floats, bool, Floats, Floats, Floats, Floats,
        float, float, float, float, Floats, Indices,
    ],
    tuple[float, int],
]  # fmt: skip
"""Takes all a certificate needs of some setpoints; see ``orientd.planner.compiled_certificate``."""

LeastRate = Callable[
    [Floats, Floats, Floats, float, float, Floats, Floats, Floats, float, float, float],
    tuple[float, int],
]
"""Finds the least brake rate of a path; see ``orientd.planner.compiled_certificate``."""

SurveyOf = Callable[[Floats, Floats, float, float, float, Floats, bool, Floats], tuple[float, int]]
"""Surveys a core; see ``orientd.planner.compiled_survey``."""

LookAt = Callable[[Floats, int, Floats, Floats, float, float, float, Floats, bool, bool], float]
"""Looks at records of a core; see ``orientd.planner.compiled_survey``."""

QuickCore = Callable[
    [Floats, Floats, float, int, Floats, Floats, Floats, Floats, Floats], tuple[int, float]
]
"""Finds the quickest default curve; see ``orientd.planner.compiled_quick_core``."""


SamplePath = Callable[[Floats, Floats, Floats], None]
"""Samples a path; see ``orientd.planner.compiled_path``."""

FarthestFrom = Callable[[Floats, Floats, Floats], float]
"""Holds a path against orientations; see ``orientd.planner.compiled_path``."""

PathExtremes = Callable[
    [
        Floats, int, float, Floats, bool, Floats, Floats, Floats, Floats, Floats,
        float, float, float, Floats, Indices,
    ],
    tuple[float, int],
]  # fmt: skip
"""Takes all a certificate needs of a path; see ``orientd.planner.compiled_path``."""


class PlannerKernels(fast.Background):
    """The compiled kernels of the planner; nothing each as long as they are not ready.

    Attributes:
        survey: surveys a core.
        look: looks at records of a core.
        quick_core: finds the default curve through keyframes without times.
        extremes: the largest backward differences of setpoints, and the least brake rate.
        sample_path: samples a path.
        farthest_from: how far a path is from some orientations.
        path_extremes: the same as *extremes* of all records of a path.
        least_rate: the least brake rate of a path.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "extremes": "orientd.planner.compiled_certificate:extremes",
                "sample_path": "orientd.planner.compiled_path:sample_path",
                "farthest_from": "orientd.planner.compiled_path:farthest_from",
                "path_extremes": "orientd.planner.compiled_path:path_extremes",
                "least_rate": "orientd.planner.compiled_certificate:least_rate",
                "survey": "orientd.planner.compiled_survey:survey",
                "look": "orientd.planner.compiled_survey:look",
                "quick_core": "orientd.planner.compiled_quick_core:quick_core",
            }
        )
        self.survey: SurveyOf | None = None
        self.look: LookAt | None = None
        self.quick_core: QuickCore | None = None
        self.extremes: Extremes | None = None
        self.sample_path: SamplePath | None = None
        self.farthest_from: FarthestFrom | None = None
        self.path_extremes: PathExtremes | None = None
        self.least_rate: LeastRate | None = None


KERNELS = PlannerKernels()
"""The planner's kernels of this process."""


def kernels() -> PlannerKernels:
    """Return the planner's kernels, and send for them once those of the curves are in use."""
    if KERNELS.status is fast.Status.NOT_STARTED and fast.KERNEL.status is fast.Status.READY:
        KERNELS.start()
    return KERNELS


def wait_ready(timeout: float | None = None) -> bool:
    """Wait until the kernels of the curves and of the planner are in use, starting both.

    Args:
        timeout: how long to wait for each, in seconds; without it as long as it takes.

    Returns:
        Whether all are ready.
    """
    return fast.wait_ready(timeout) and KERNELS.wait_ready(timeout)
