"""Cells of daemons over Zenoh: presence, states, one stop for all, one start together.

For programs that use a cell: ``client`` and ``together``.  For those that read the table
``[fleet]``: ``settings``.  For those that join a cell: ``access``.
"""

from orientd.lazy import lazily

TYPE_CHECKING = False  # of typing, without loading it
if TYPE_CHECKING:
    from orientd_fleet.client import Fleet, Stopped, connect_fleet, daemon_address
    from orientd_fleet.together import FleetMotion, Together, move_together, read_plan

__getattr__ = lazily(__name__)
