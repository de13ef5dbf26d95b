"""What the compiled library offers; see the headers of each group in ``c/``."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

LEVEL: str
SOURCES: str

# sampling.h
def sample_cubic(
    times: Floats, breaks: Floats, table: Floats, slack: float, out: Floats, /
) -> int: ...

# connectors.h
def put_joins(
    q: Floats, w: Floats, breaks: Floats, base: Floats, axes: Floats, lengths: Floats,
    values: Floats, rates: Floats, curvatures: Floats, at_ends: Floats, /,
) -> None: ...  # fmt: skip
def try_joins(
    first: Floats, last: Floats, durations: Floats, around: Floats, limits: Floats, w: Floats,
    kept: Indices, /,
) -> None: ...  # fmt: skip
def ramps_of_stop(
    state: Floats, limits: Floats, period: float, ends: Floats, w: Floats, durations: Floats, /
) -> int: ...
def find_connector(
    start: Floats, end: Floats, limits: Floats, period: float, least: float, q: Floats, w: Floats,
    times: Floats, /,
) -> bool: ...  # fmt: skip
