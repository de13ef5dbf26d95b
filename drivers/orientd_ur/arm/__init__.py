"""Which arm it is: the published models, and what a controller says of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from orientd.lazy import lazily

if TYPE_CHECKING:
    from orientd_ur.arm.identification import Arm, ask, published
    from orientd_ur.arm.models import MODELS, ArmModel

__getattr__ = lazily(__name__)
