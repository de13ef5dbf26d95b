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
def sample_product(
    times: Floats, breaks: Floats, base: Floats, axes: Floats, lengths: Floats,
    values: Floats, rates: Floats, curvatures: Floats, slack: float, out: Floats, /,
) -> int: ...  # fmt: skip
def fill_basis(
    spans: Indices, knots: Floats, order: int,
    values: Floats, rates: Floats, curvatures: Floats, /,
) -> None: ...  # fmt: skip
