"""What the compiled library offers; see the headers of each group in ``c/``."""

from array import array

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Vector = tuple[float, float, float]
Rows = Floats | memoryview[float] | array[float]

LEVEL: str
SOURCES: str

# interpolation.h
def interpolate(
    keys: Floats, steps: Floats, times: Floats, order: int, given: Floats,
    start_known: int, end_known: int, is_near: bool,
    breaks: Floats, base: Floats, increments: Floats, values: Floats, /,
) -> bool: ...  # fmt: skip
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
def solve_banded(band: Floats, lower: int, upper: int, right: Floats, /) -> bool: ...

# trajectory.h, quintic.h
def fit_trajectory(orientations: Floats, pieces: Floats, quality: Floats, /) -> None: ...
def product_trajectory(
    breaks: Floats, base: Floats, first: Indices, increments: Floats, values: Floats,
    given: Floats, cuts: int, ends: Floats, pieces: Floats, /,
) -> int: ...  # fmt: skip
def put_quintics(intervals: Rows, ends: Rows, coefficients: Rows, /) -> None: ...
def quintic_at(coefficients: Rows, u: float, /) -> tuple[Vector, Vector, Vector, Vector]: ...
def retime_trajectory(
    breaks: Floats, pieces: Floats, times: Floats, places: Floats, values: Floats, slopes: Floats,
    leaves: Floats, ends: Floats, out: Floats, /,
) -> int: ...  # fmt: skip
def sample_moves(times: Floats, breaks: Floats, moves: Floats, out: Floats, /) -> None: ...
def sample_trajectory(
    times: Floats, breaks: Floats, pieces: Floats, slack: float, out: Floats, /
) -> int: ...

# connectors.h
def connect(
    start: Floats, end: Floats, limits: Floats, own: Floats, period: float, least: float,
    longest: float, most_turn: float, more: float, breaks: Floats, pieces: Floats, /,
) -> int: ...  # fmt: skip
def stop(
    state: Floats, limits: Floats, period: float, longest: float, breaks: Floats,
    pieces: Floats, /,
) -> int: ...  # fmt: skip
def fill_basis(
    spans: Indices, knots: Floats, order: int,
    values: Floats, rates: Floats, curvatures: Floats, /,
) -> None: ...  # fmt: skip

# between.h
def between(
    here: Floats, there: Floats, periods: Floats, shares: Floats, out: Floats, /
) -> None: ...

# certify.h
def certify(
    is_turn: bool, breaks: Floats, pieces: Floats, rows: Floats, before: Floats,
    count: int, held: int, rests_before: bool, rests_behind: bool, period: float,
    limits: Floats, first: int, end: int, tolerance: float,
    nodes: Floats, worst: Floats, numbers: Floats, found: Floats, /,
) -> None: ...  # fmt: skip

# clock.h, profile.h
def time_map(
    times: Floats,
    places: Floats,
    values: Floats,
    slopes: Floats,
    leaves: Floats,
    instants: Floats,
    out: Floats,
    /,
) -> None: ...
def time_quickest(
    breaks: Floats,
    pieces: Floats,
    knots: Floats,
    edges: Floats,
    is_at_rest: bool,
    move_breaks: Floats,
    moves: Floats,
    limits: Floats,
    move_limits: Floats,
    period: float,
    axis_breaks: Floats,
    axis_pieces: Floats,
    axis_limits: Floats,
    /,
) -> tuple[bytes, bytes] | bool: ...

# double_s.h
def double_s(
    way: float, velocity: float, acceleration: float, jerk: float, /
) -> tuple[float, float, float]: ...
def first_change(total: float, step: float, /) -> float: ...
def stop_along(
    speed: float, rate: float, acceleration: float, jerk: float, /
) -> tuple[float, float]: ...

# arms.h; rows as NumPy's arrays or as memory views, which the servo has
def follow_arm(arm: Rows, tool: Rows, poses: Rows, near: Rows, joints: Rows, /) -> int: ...
def place_arm(arm: Rows, is_own: bool, joints: Rows, poses: Rows, /) -> None: ...
def reserve_arm(arm: Rows, joints: Rows, reserves: Rows, /) -> None: ...
def solve_arm(arm: Rows, tool: Rows, pose: Rows, joints: Rows, /) -> int: ...

# vector.h
def halt_vector(
    limits: Rows, period: float, state: Rows, aside: Rows, acceleration: Rows, /
) -> None: ...
def pursue_vector(
    limits: Rows,
    period: float,
    state: Rows,
    reference: Rows,
    following: Rows,
    taken: Rows,
    acceleration: Rows,
    /,
) -> bool: ...
def stop_clearance(limits: Rows, period: float, state: Rows, cones: Rows, /) -> float: ...

# fit.h
def fit_samples(samples: Rows, trust: float, fits: Rows, /) -> None: ...
def mix_fits(fits: Rows, scores: Rows, mean: Rows, /) -> None: ...
def read_fit(polynomial: Rows, t: float, forecast: Rows, /) -> None: ...
def score_fits(fits: Rows, t: float, value: Rows, learning: float, scores: Rows, /) -> None: ...

# chain.h
def brakes_outside(
    chain: Rows, axes: Rows, joints: Rows, period: float, cones: Rows, /
) -> bool: ...
def pursue_joints(
    chain: Rows,
    axes: Rows,
    tool: Rows,
    period: float,
    joints: Rows,
    reference: Rows,
    is_way: bool,
    following: Rows,
    taken: Rows,
    goal: Rows,
    accelerations: Rows,
    /,
) -> None: ...
def roll_stop(
    chain: Rows,
    axes: Rows,
    tool: Rows,
    period: float,
    joints: Rows,
    differences: Rows,
    cones: Rows,
    share: float,
    drift: float,
    accelerations: Rows,
    stop: Rows,
    strain: Rows,
    /,
) -> int: ...
