"""Cells of daemons over Zenoh: presence, states, one stop for all, one start together.

For programs that use a cell: ``client`` and ``together``.  For those that read the table
``[fleet]``: ``settings``.  For those that join a cell: ``access``.
"""
