"""When the compiled kernel may be used: loaded in the background, NumPy serving until it is ready.

Numba (extra ``fast``) takes a third of a second to import and a few seconds to compile the kernel
for the first time on a machine; nothing waits for either unless it asks to.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from enum import Enum
from importlib import import_module
from importlib.util import find_spec
from typing import cast

from orientd.rotation import Floats

Fill = Callable[[Floats, Floats, Floats, float, Floats], int]
"""Takes instants, breaks, table, slack and the buffer to fill; see ``orientd.curves.compiled``."""

START_AFTER = 10_000
"""Samples worked out by NumPy in this process before the compiled kernel is sent for."""


class Status(Enum):
    """How far the compiled kernel is."""

    NOT_STARTED = "not started"
    LOADING = "loading"
    READY = "ready"
    MISSING = "missing"
    FAILED = "failed"


class FastKernel:
    """The compiled kernel of this process, loaded once, in a thread of its own.

    Attributes:
        fill: the kernel, or nothing as long as it is not ready.
        status: how far it is.  ``MISSING`` means that Numba is not installed, ``FAILED`` that it
            is, but does not work here.
        error: what went wrong, if the status is ``FAILED``.
    """

    def __init__(self) -> None:
        self.fill: Fill | None = None
        self.status = Status.NOT_STARTED
        self.error: Exception | None = None
        self._lock = threading.Lock()
        self._done = threading.Event()
        self._samples = 0

    def count(self, samples: int) -> None:
        """Take note of samples worked out by NumPy, and start loading when they become many."""
        if self.status is Status.NOT_STARTED:
            self._samples += samples
            if self._samples > START_AFTER:
                self.start()

    def start(self) -> None:
        """Start loading the kernel in the background, unless that has been done before."""
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
        """Wait until the kernel has been loaded, starting that if need be.

        Args:
            timeout: how long to wait, in seconds; without it as long as it takes.

        Returns:
            Whether the kernel is ready.
        """
        self.start()
        self._done.wait(timeout)
        return self.status is Status.READY

    def _load(self) -> None:
        try:
            self.fill = cast(Fill, import_module("orientd.curves.compiled").fill)
        except Exception as error:  # noqa: BLE001 - a compiler can fail in any way; NumPy serves on
            self.error = error
            self.status = Status.FAILED
        else:
            self.status = Status.READY
        self._done.set()


KERNEL = FastKernel()
"""The kernel of this process."""


def wait_ready(timeout: float | None = None) -> bool:
    """Wait until the compiled kernel is in use; see :meth:`FastKernel.wait_ready`."""
    return KERNEL.wait_ready(timeout)
