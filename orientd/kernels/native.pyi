"""What the compiled library offers; see the headers of each group in ``c/``."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

LEVEL: str
SOURCES: str

# interpolation.h
def euclidean_increments(
    steps: Floats,
    begun: Floats,
    heads: Floats,
    tails: Floats,
    start_ratio: float,
    end_ratio: float,
    unknown: Floats,
    /,
) -> bool: ...
def find_increments(
    steps: Floats,
    begun: Floats,
    heads: Floats,
    tails: Floats,
    start_ratio: float,
    end_ratio: float,
    unknown: Floats,
    /,
) -> bool: ...
def interpolate_c2(
    keyframes: Floats,
    is_aligned: bool,
    times: Floats,
    given: Floats,
    start_known: int,
    end_known: int,
    breaks: Floats,
    table: Floats,
    solved: Floats,
    /,
) -> bool: ...
def keyframe_errors(
    steps: Floats,
    begun: Floats,
    heads: Floats,
    tails: Floats,
    start_ratio: float,
    end_ratio: float,
    scale: float,
    unknown: Floats,
    rows: Indices,
    errors: Floats,
    /,
) -> None: ...
def keyframe_step(
    steps: Floats,
    begun: Floats,
    heads: Floats,
    tails: Floats,
    start_ratio: float,
    end_ratio: float,
    scale: float,
    unknown: Floats,
    rows: Indices,
    errors: Floats,
    correction: Floats,
    /,
) -> float: ...
def linearise_effort(
    increments: Floats,
    window: Indices,
    weights: Floats,
    roots: Floats,
    inertia: Floats,
    index: Indices,
    share: Floats,
    steps: Floats,
    gradient: Floats,
    squares: Floats,
    bound: Floats,
    missed: Floats,
    /,
) -> float: ...
def put_equations(
    times: Floats,
    given: Floats,
    start_known: int,
    end_known: int,
    breaks: Floats,
    begun: Floats,
    known: Floats,
    ratios: Floats,
    /,
) -> None: ...
def put_steps(keyframes: Floats, steps: Floats, /) -> None: ...
def put_table(
    keyframes: Floats, with_start: bool, breaks: Floats, solved: Floats, table: Floats, /
) -> bool: ...
def solve_banded(band: Floats, lower: int, upper: int, right: Floats, /) -> bool: ...

# sampling.h
def sample_cubic(
    times: Floats, breaks: Floats, table: Floats, slack: float, out: Floats, /
) -> int: ...
