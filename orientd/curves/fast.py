"""When compiled kernels may be used: loaded in the background, NumPy serving until they are ready.

Numba (extra ``fast``) takes a third of a second to import and a few seconds to compile a kernel
for the first time on a machine; nothing waits for either unless it asks to.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping
from enum import Enum
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from orientd.prefetch import prefetch
from orientd.rotation import Floats

Indices = NDArray[np.intp]

Fill = Callable[[Floats, Floats, Floats, float, Floats], int]
"""Takes instants, breaks, table, slack and the buffer to fill; see ``orientd.curves.compiled``."""

FillProduct = Callable[
    [Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, float, Floats], int
]
"""The same for any number of factors; see ``orientd.curves.compiled_product``."""

FillBasis = Callable[[Indices, Floats, int, Floats, Floats, Floats], None]
"""Writes the coefficients of a B-spline basis; see ``orientd.curves.compiled_basis``."""

NUMBERS_FROM = (
    "planner/bridge_search.py",
    "planner/differences.py",
    "planner/plain_path.py",
    "planner/survey.py",
    "planner/timing.py",
)
"""Modules of the package that kernels take numbers from."""

_PACKAGE = Path(__file__).parents[1]

START_AFTER = 10_000
"""Samples worked out by NumPy in this process before the compiled kernel is sent for."""


class Status(Enum):
    """How far compiled kernels are."""

    NOT_STARTED = "not started"
    LOADING = "loading"
    READY = "ready"
    MISSING = "missing"
    FAILED = "failed"


class Background:
    """Compiled kernels of this process, loaded once, in a thread of their own.

    Each is in use as soon as it has been loaded itself.

    Attributes:
        status: how far they are.  ``MISSING`` means that Numba is not installed, ``FAILED`` that it
            is, but does not work here.
        error: what went wrong, if the status is ``FAILED``.
        after_each: called after each kernel, in the thread that loads them.
    """

    after_each: Callable[[], object] | None = None

    def __init__(self, homes: Mapping[str, str]) -> None:
        """Take the names of the kernels' attributes, each with ``module:function``."""
        self.status = Status.NOT_STARTED
        self.error: Exception | None = None
        self._homes = homes
        self._lock = threading.Lock()
        self._done = threading.Event()

    def start(self) -> None:
        """Start loading in the background, unless that has been done before."""
        with self._lock:
            if self.status is not Status.NOT_STARTED:
                return
            if find_spec("numba") is None:
                self.status = Status.MISSING
                self._done.set()
                return
            self.status = Status.LOADING
        threading.Thread(target=self._load, name="orientd-fast-kernel", daemon=True).start()

    def wait_ready(self, timeout: float | None = None) -> bool:
        """Wait until loading has ended, starting it if need be.

        Args:
            timeout: how long to wait, in seconds; without it as long as it takes.

        Returns:
            Whether the kernels are ready.
        """
        self.start()
        self._done.wait(timeout)
        return self.status is Status.READY

    def _load(self) -> None:
        try:
            forget_stale(_PACKAGE)
            prefetch("llvmlite", "numba")
            for attribute, home in self._homes.items():
                module, _, function = home.partition(":")
                setattr(self, attribute, getattr(import_module(module), function))
                if self.after_each is not None:
                    self.after_each()
        except Exception as error:  # noqa: BLE001 - a compiler can fail in any way; NumPy serves on
            self.error = error
            self.status = Status.FAILED
        else:
            self.status = Status.READY
        self._done.set()


def forget_stale(package: Path) -> None:
    """Delete the compiled kernels beside the sources that are older than what they were made of.

    Numba compares each with the file of its own function alone, not with those of the functions
    and numbers that it calls and takes from elsewhere.

    Args:
        package: the folder whose subfolders hold the kernels.
    """
    sources = [*package.glob("*/compiled*.py"), *(package / name for name in NUMBERS_FROM)]
    changed = max((source.stat().st_mtime_ns for source in sources), default=0)
    for index in package.glob("*/__pycache__/compiled*.nbi"):
        with contextlib.suppress(OSError):
            if index.stat().st_mtime_ns < changed:
                index.unlink()


class FastKernel(Background):
    """The compiled kernels of the curves.

    Attributes:
        fill: samples a cubic cumulative product; nothing as long as it is not ready.
        fill_product: samples any other cumulative product, likewise.
        fill_basis: writes the coefficients of a B-spline basis, likewise.
    """

    def __init__(self) -> None:
        super().__init__(
            {
                "fill": "orientd.curves.compiled:fill",
                "fill_basis": "orientd.curves.compiled_basis:fill",
                "fill_product": "orientd.curves.compiled_product:fill",
            }
        )
        self.fill: Fill | None = None
        self.fill_product: FillProduct | None = None
        self.fill_basis: FillBasis | None = None
        self._samples = 0

    def count(self, samples: int) -> None:
        """Take note of samples worked out by NumPy, and start loading when they become many."""
        if self.status is Status.NOT_STARTED:
            self._samples += samples
            if self._samples > START_AFTER:
                self.start()


KERNEL = FastKernel()
"""The kernels of this process."""


def wait_ready(timeout: float | None = None) -> bool:
    """Wait until the compiled kernels are in use; see :meth:`Background.wait_ready`."""
    return KERNEL.wait_ready(timeout)
