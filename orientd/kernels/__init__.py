"""The hot mathematics, compiled ahead of time from the C sources in ``c/``.

Importing it loads the build for this machine's processor, a library of some 100 kB, and nothing
else.  Kernels take C-contiguous arrays by position and write to arrays that they are given; what
calls them knows the shapes.
"""

from orientd.kernels.levels import check_sources, folder

__path__.insert(0, str(folder()))

from orientd.kernels.native import (  # noqa: E402
    LEVEL,
    SOURCES,
    euclidean_increments,
    find_increments,
    interpolate_c2,
    keyframe_errors,
    keyframe_step,
    linearise_effort,
    put_equations,
    put_steps,
    put_table,
    sample_cubic,
    solve_banded,
)

check_sources(SOURCES)

__all__ = [
    "LEVEL",
    "euclidean_increments",
    "find_increments",
    "interpolate_c2",
    "keyframe_errors",
    "keyframe_step",
    "linearise_effort",
    "put_equations",
    "put_steps",
    "put_table",
    "sample_cubic",
    "solve_banded",
]
