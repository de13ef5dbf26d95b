"""The hot mathematics, compiled ahead of time from the C sources in ``c/``.

Importing it loads the build for this machine's processor, a library of some 100 kB, and nothing
else.  Kernels take C-contiguous arrays by position and write to arrays that they are given; what
calls them knows the shapes.  Why they are written in C, and how to add one, is in ``DECISION.md``.
"""

from orientd.processor import library

__path__.insert(0, str(library().parent))

from orientd.kernels.native import *  # noqa: E402, F403 - the list is in native.pyi
