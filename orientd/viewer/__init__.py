"""The live view: what a device was told and what it does, in a browser.

A client of the control socket like any other: one stream of cycles for however many pages are
open, and none while there are none.  Needs the extra ``view``: ``viser``, which draws the pages.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd.viewer.cell import Member
    from orientd.viewer.cell_page import CellPage
    from orientd.viewer.own_page import is_loopback
    from orientd.viewer.page import Page

__getattr__ = lazily(
    __name__,
    {
        "orientd.viewer.cell": ("Member",),
        "orientd.viewer.cell_page": ("CellPage",),
        "orientd.viewer.own_page": ("is_loopback",),
        "orientd.viewer.page": ("Page",),
    },
)
