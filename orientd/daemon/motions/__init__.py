"""The motions of a device: queued, fed to the servo, measured, and reported until they arrive."""

from __future__ import annotations

from orientd.daemon.motions.active_motions import ActiveMotion, ActiveMotions
from orientd.daemon.motions.motions import Motions
from orientd.daemon.motions.options import AT_ONCE, ArrivalCondition, MoveOptions, Prepared
from orientd.daemon.motions.plan_store import PlanStore
