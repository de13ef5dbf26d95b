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
    fill_basis,
    sample_cubic,
    sample_product,
)

check_sources(SOURCES)

__all__ = [
    "LEVEL",
    "fill_basis",
    "sample_cubic",
    "sample_product",
]
