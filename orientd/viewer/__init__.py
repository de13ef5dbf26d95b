"""The live view: a device's setpoints, measurements and state in a browser.

The view is a client of the control socket like any other.  It streams cycles once for all open
pages, and not at all while none is open.  It needs the extra ``view``, the package `websockets`.

Other packages import from ``view``, ``server`` (serves the page) and ``words`` (its texts).
"""
