"""Which arm it is: the published models, and what a controller says of its own."""

from __future__ import annotations

from orientd_ur.arm.identification import Arm, ask, published
from orientd_ur.arm.models import MODELS, ArmModel
