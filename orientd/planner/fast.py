"""When the compiled kernels of the planner may be used: loaded in the background after the curves'.

As long as they are not there, and where Numba is not, NumPy serves; see
:mod:`orientd.curves.fast`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from orientd.curves import fast
from orientd.rotation import Floats

Booleans = np.ndarray[Any, np.dtype[np.bool_]]

Search = Callable[
    [Floats, Floats, Floats, bool, float, float, Floats, Floats, Floats, Floats, Floats], bool
]
"""Finds the shortest bridge; see ``orientd.planner.compiled_bridge``."""


PutJoins = Callable[
    [
        Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats,
        Floats, Floats,
    ],
    None,
]  # fmt: skip
"""Writes what joins are sampled from; see ``orientd.planner.compiled_join``."""


class PlannerKernels(fast.Background):
    """The compiled kernels of the planner; nothing each as long as they are not ready.

    Attributes:
        put_joins: writes what joins are sampled from.
        search: finds the shortest bridge.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "put_joins": "orientd.planner.compiled_join:put_joins",
                "search": "orientd.planner.compiled_bridge:search",
            }
        )
        self.put_joins: PutJoins | None = None
        self.search: Search | None = None


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
