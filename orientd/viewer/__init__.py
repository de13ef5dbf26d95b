"""The live view: a device's setpoints, measurements and state in a browser.

The view is a client of the control socket like any other.  It streams cycles once for all open
pages, and not at all while none is open.  It needs the extra ``view``, the package `websockets`.

For other pages of devices: ``server`` (serves the page) and ``words`` (its texts).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.viewer.view import View

__getattr__ = lazily(
    __name__,
    {
        "orientd.viewer.view": ("View",),
    },
)
