"""An emulated moving base: a ship or a vehicle, and the inertial measurement unit on it."""

from __future__ import annotations

from emulated_base.command import run
from emulated_base.imu import Imu, Sample
from emulated_base.motion import BASES, BaseMotion

__all__ = ["BASES", "BaseMotion", "Imu", "Sample", "run"]
