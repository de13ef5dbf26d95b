"""The live view: what a device was told and what it does, in a browser.

A client of the control socket like any other: one stream of cycles for however many pages are
open, and none while there are none.  Needs the extra ``view``: ``viser``, which draws the pages.
"""
