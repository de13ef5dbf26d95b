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

def sample_product(
    times: Floats, breaks: Floats, base: Floats, axes: Floats, lengths: Floats,
    values: Floats, rates: Floats, curvatures: Floats, slack: float, out: Floats, /,
) -> int: ...  # fmt: skip
def fill_basis(
    spans: Indices, knots: Floats, order: int,
    values: Floats, rates: Floats, curvatures: Floats, /,
) -> None: ...  # fmt: skip

# certify.h
def least_rate(
    velocity: Floats,
    acceleration: Floats,
    jerk: Floats,
    most: float,
    most_jerk: float,
    nodes: Floats,
    worst: Floats,
    most_change: float,
    fastest: float,
    margin: float,
    /,
) -> tuple[float, int]: ...
def setpoint_extremes(
    q: Floats,
    past: int,
    with_axes: bool,
    period: float,
    start: float,
    rough: Floats,
    with_rate: bool,
    most: Floats,
    nodes: Floats,
    worst: Floats,
    most_change: float,
    fastest: float,
    margin: float,
    squares: Floats,
    places: Indices,
    /,
) -> tuple[float, int]: ...
def sample_path(path: Floats, times: Floats, out: Floats, /) -> None: ...
def farthest_from_path(path: Floats, times: Floats, keys: Floats, /) -> float: ...
def path_extremes(
    path: Floats,
    records: int,
    period: float,
    before: Floats,
    with_axes: bool,
    rough: Floats,
    most: Floats,
    nodes: Floats,
    worst: Floats,
    most_change: float,
    fastest: float,
    margin: float,
    squares: Floats,
    places: Indices,
    /,
) -> tuple[float, int]: ...
def put_instants(
    breaks: Floats, duration: float, pieces: int, shares: Floats, instants: Floats, /
) -> int: ...
def put_factors(
    instants: Floats,
    omega: Floats,
    alpha: Floats,
    period: float,
    limits: Floats,
    step: float,
    factors: Floats,
    /,
) -> None: ...
def put_spots(
    instants: Floats, factors: Floats, hot: float, ends: Floats, spots: Floats, /
) -> int: ...
def look_at(
    ranges: Indices,
    curve: Floats,
    rate: float,
    duration: float,
    period: float,
    is_held_before: bool,
    is_held_after: bool,
    limits: Floats,
    bends: float,
    twists: float,
    is_smooth: bool,
    /,
) -> float: ...
