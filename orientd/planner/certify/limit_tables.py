"""The angular limits as numbers in a table, for what works on arrays."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from orientd.planner.limits import ANGULAR, Limits
from orientd.rotation import Floats


# A plan asks for the same few again and again.
@lru_cache(maxsize=64)
def limit_table(limits: Limits) -> Floats:
    """Return limits of velocity, acceleration and jerk: of the norm and of the components.

    Returns:
        Read only, shape ``(3, 4)``, in rad and s.
    """
    table: Floats = np.array([(getattr(limits, name), *limits.axes(name)) for name in ANGULAR])
    table.setflags(write=False)
    return table
