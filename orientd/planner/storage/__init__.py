"""Motions kept: saved to a file, read back, and replayed from what was recorded."""

from __future__ import annotations

from orientd.planner.storage.replay import plan_as_recorded, replay_request
from orientd.planner.storage.saved import load_motion
