"""Who commands which device, for how long, and what becomes of their motions when that changes."""

from __future__ import annotations

from orientd.daemon.leases.lease import Lease, LeaseTable
from orientd.daemon.leases.lease_manager import LeaseManager
